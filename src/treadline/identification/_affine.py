"""Affine state-space model, the form used while fitting.

In units of each channel's standard deviation: x⁺ = Ax + B [u; 1] + Ke, y = Cx + D [u; 1] + e. The last columns of B and D are
constant offsets.
"""

import cmath
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Num
from scipy.linalg import schur

from treadline.core.arrays import store_contiguous
from treadline.core.model_scores import GROWTH
from treadline.core.models import LinearModel
from treadline.core.state_space import Provenance
from treadline.identification._gram import Units

FREE = 1e4
"""Weight of the state equations against the operating point's distance: large enough to leave the state free."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Affine:
    """Linear model with constant offsets; K is None for a model without an innovation gain."""

    A: Float[np.ndarray, "n n"]
    B: Float[np.ndarray, "n m1"]
    C: Float[np.ndarray, "p n"]
    D: Float[np.ndarray, "p m1"]
    K: Float[np.ndarray, "n p"] | None = None

    def __post_init__(self) -> None:
        store_contiguous(self)

    @property
    def order(self) -> int:
        """Number of states."""
        return int(self.A.shape[0])

    @property
    def block(self) -> Float[np.ndarray, "n_and_p n_and_m1"]:
        """System matrix [[A, B], [C, D]]."""
        return np.block([[self.A, self.B], [self.C, self.D]])

    def with_block(self, block: Float[np.ndarray, "n_and_p n_and_m1"]) -> "Affine":
        """Return the model with another system matrix, its innovation gain kept."""
        n = self.order
        return replace(self, A=block[:n, :n], B=block[:n, n:], C=block[n:, :n], D=block[n:, n:])

    @cached_property
    def eigen(self) -> tuple[Num[np.ndarray, " n"], Num[np.ndarray, "n n"]]:
        """Poles and eigenvectors; conjugate poles are adjacent, positive imaginary part first."""
        poles, V = np.linalg.eig(self.A)
        return poles, V

    @property
    def radius(self) -> float:
        """Spectral radius of A."""
        return float(np.abs(self.eigen[0]).max())

    def predictor(self) -> "Affine":
        """Return the one-step predictor from [u; 1; y] to the predicted output: A - KC, [B - KD, K], C, [D, 0]."""
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
        """Return the model with the given one-step predictor (inverse of ``predictor``)."""
        p = len(predictor.C)
        K, D = predictor.B[:, -p:], predictor.D[:, :-p]
        return cls(A=predictor.A + K @ predictor.C, B=predictor.B[:, :-p] + K @ D, C=predictor.C, D=D, K=K)


def to_model(
    fitted: Affine, units: Units, dt_s: float, names: tuple[str, ...], provenance: Provenance | None = None
) -> LinearModel:
    """Return the model in the record's units, about an operating point near the data's means.

    Every (s, u₀, y₀) with (A - I)s - B u₀ = b and y₀ + Cs - D u₀ = c is an operating point. The nearest solution is
    taken; distances count in standard deviations, an input's three times. If an integrator leaves y₀ undetermined, u₀
    absorbs the offset: a chair with a fast right belt stands still at unequal belt speeds.
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


def of_model(model: LinearModel, units: Units) -> Affine:
    """Return a model in standard deviations (inverse of ``to_model``), its dead time left out."""
    into, out = units.input_scale, units.output_scale
    u0, y0 = model.input_offset - units.shift[: units.input_count], model.output_offset - units.shift[units.input_count :]
    return Affine(
        A=model.A.copy(),
        B=np.column_stack([model.B * into, -model.B @ u0]),
        C=model.C / out[:, None],
        D=np.column_stack([model.D * into / out[:, None], (y0 - model.D @ u0) / out]),
    )


ON_CIRCLE = 1e-9
"""Distance of a pole's modulus from 1 that counts as rounding."""
INSIDE = 1.0 - 1e-6
"""Largest modulus of a pole after reflection into the unit circle: an integrator that is estimated just outside stays one."""


def stabilised(system: Affine, *, samples: float = math.inf) -> Affine:
    """Return the system with poles outside the unit circle reflected, and slow poles bounded.

    The reflection 1/λ* preserves the magnitude of the frequency response. Only the diagonal of the real Schur form changes,
    so that equal poles stay coupled. A mode that neither decays to a twentieth nor turns once within a third of the record looks
    like drift, of which measured data are full; its modulus is at most 1 - 3/samples. A mode that turns is seen many times, and
    keeps its damping.

    Args:
        system: Model.
        samples: Length of the record; infinite to leave slow poles as they are.
    """
    slowest = 1.0 - GROWTH / max(samples, 2.0 * GROWTH)
    if system.radius <= min(slowest, 1.0 - ON_CIRCLE):
        return system
    T, Q = schur(system.A, output="real")
    at = 0
    while at < len(T):
        size = 2 if at + 1 < len(T) and T[at + 1, at] != 0.0 else 1
        block = slice(at, at + size)
        pole = complex(np.linalg.eigvals(T[block, block])[0])
        modulus, drifts = abs(pole), math.isfinite(samples) and abs(cmath.phase(pole)) * samples < 2.0 * math.pi * GROWTH
        if modulus >= 1.0 - ON_CIRCLE:
            T[block, block] *= min(1.0 / modulus, slowest if drifts else INSIDE) / modulus
        elif drifts and modulus > slowest:
            T[block, block] *= slowest / modulus
        at += size
    return replace(system, A=np.asarray(Q @ T @ Q.T))
