"""A model with its constants: the form in which fitting happens, in units of each channel's deviation.

x⁺ = Ax + B [u; 1] + Ke, y = Cx + D [u; 1] + e. The last columns of B and D are the constants.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Num

from treadline.identification.gram import Units
from treadline.models import LinearModel, Provenance

FREE = 1e4
"""How far the state may move for the operating point, in deviations: freely."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Affine:
    """A linear model and its constants; K is None where none is known."""

    A: Float[np.ndarray, "n n"]
    B: Float[np.ndarray, "n m1"]
    C: Float[np.ndarray, "p n"]
    D: Float[np.ndarray, "p m1"]
    K: Float[np.ndarray, "n p"] | None = None

    @property
    def order(self) -> int:
        """Number of states."""
        return int(self.A.shape[0])

    @cached_property
    def eigen(self) -> tuple[Num[np.ndarray, " n"], Num[np.ndarray, "n n"]]:
        """Poles and their directions; conjugates stand side by side, the one above first."""
        poles, V = np.linalg.eig(self.A)
        return poles, V

    @property
    def radius(self) -> float:
        """Largest modulus of the poles."""
        return float(np.abs(self.eigen[0]).max())

    def predictor(self) -> "Affine":
        """Return the system from [u; 1; y] to the predicted output: A - KC, [B - KD, K], C, [D, 0]."""
        p = len(self.C)
        K = np.zeros((self.order, p)) if self.K is None else self.K
        return Affine(
            A=self.A - K @ self.C,
            B=np.hstack([self.B - K @ self.D, K]),
            C=self.C,
            D=np.hstack([self.D, np.zeros((p, p))]),
        )

    @classmethod
    def of_predictor(cls, predictor: "Affine") -> "Affine":
        """Return the model whose predictor this is."""
        p = len(predictor.C)
        K, D = predictor.B[:, -p:], predictor.D[:, :-p]
        return cls(A=predictor.A + K @ predictor.C, B=predictor.B[:, :-p] + K @ D, C=predictor.C, D=D, K=K)


def to_model(
    fitted: Affine, units: Units, dt_s: float, names: tuple[str, ...], provenance: Provenance | None = None
) -> LinearModel:
    """Return the model in the record's units, about an operating point near the data's means.

    Any (s, u₀, y₀) with (A - I)s - B u₀ = b and y₀ + Cs - D u₀ = c will do: the nearest is taken, distances in
    deviations, an input's three times. Where an integrator leaves y₀ open, it is u₀ that yields: a chair whose right belt
    runs fast stands still at unequal belts.
    """
    n, m, p = fitted.order, units.input_count, len(fitted.C)
    B, D = fitted.B[:, :m], fitted.D[:, :m]
    equations = np.zeros((n + p, n + m + p))
    equations[:n, :n] = (fitted.A - np.eye(n)) * FREE
    equations[n:, :n] = fitted.C * FREE
    equations[:n, n : n + m], equations[n:, n : n + m] = B / -3.0, D / -3.0
    equations[n:, n + m :] = np.eye(p)
    rest = np.linalg.lstsq(equations, np.concatenate([fitted.B[:, m], fitted.D[:, m]]), rcond=1e-12)[0]
    into, out = units.input_scale, units.output_scale
    return LinearModel(
        A=fitted.A.copy(),
        B=B / into,
        C=fitted.C * out[:, None],
        D=D * out[:, None] / into,
        dt_s=dt_s,
        input_offset=units.shift[:m] + rest[n : n + m] / 3.0 * into,
        output_offset=units.shift[m:] + rest[n + m :] * out,
        observer_gain=None if fitted.K is None else fitted.K / out,
        input_names=names[:m],
        output_names=names[m:],
        provenance=provenance or {},
    )
