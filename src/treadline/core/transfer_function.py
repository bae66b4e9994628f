"""Transfer function of a linear model ``G(z) = (C (zI - A)^-1 B + D) z^-d``: poles, zeros, static gain, responses.

Models may be unstable: an overflow or a point on a pole gives infinity, never an error.
"""

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.linalg import schur, solve_sylvester

from treadline.core.arrays import spectral_radius
from treadline.core.errors import ModelError
from treadline.core.linear_systems import impulse_response
from treadline.core.printing import Brief, Plottable
from treadline.core.state_space import StateSpaceModel, channel_names

GROWTH_MOST = 1e3
"""Growth up to which responses of an unstable model are computed, and a mode does not dominate a free run."""
STEPS_LEAST, STEPS_MOST = 20, 400
"""Smallest and largest length of a time response [samples]: a shorter panel looks empty; in a longer one single samples are not
visible."""
TAIL = 1e-4
"""Share of the energy of an impulse response after its end: one per cent in amplitude."""
Reduced = tuple[Float[np.ndarray, "k k"], Float[np.ndarray, "k m"], Float[np.ndarray, "q k"], Float[np.ndarray, "q m"]]
"""A, B, C, D with fewer states and outputs."""
ROOT_EPS = math.sqrt(np.finfo(float).eps)
"""Rounding error of a double eigenvalue: the square root of the machine precision."""


def poles(model: StateSpaceModel) -> Complex[np.ndarray, " n"]:
    """Return the poles, the eigenvalues of A, the slowest first; the dead time is not among them."""
    values = np.linalg.eigvals(model.A).astype(complex)
    return np.asarray(values[np.argsort(-np.abs(values), kind="stable")])


def is_unstable(model: StateSpaceModel) -> bool:
    """Whether a pole lies outside the unit circle by more than rounding."""
    return spectral_radius(model.A) > 1.0 + 1e-6


def zeros(model: StateSpaceModel) -> Complex[np.ndarray, " k"]:
    """Return the finite transmission zeros: values of z at which ``[A - zI, B; C, D]`` loses rank.

    The system is reduced to one with an invertible D (Emami-Naeini and Van Dooren, Automatica 18, 1982), first by its outputs,
    then by its inputs; the zeros are the eigenvalues of ``A - B D^-1 C`` that remain. Models with more inputs than outputs, or
    the reverse, seldom have any.
    """
    A, B, C, D = model.A, model.B, model.C, model.D
    # Channels of unit size, so that one tolerance serves inputs and outputs in different units.
    outputs = np.maximum(np.linalg.norm(np.hstack([C, D]), axis=1), 1e-300)
    C, D = C / outputs[:, None], D / outputs[:, None]
    inputs = np.maximum(np.linalg.norm(np.vstack([B, D]), axis=0), 1e-300)
    B, D = B / inputs, D / inputs
    A, B, C, D = _full_row_rank(A, B, C, D)
    A, C, B, D = (item.T for item in _full_row_rank(A.T, C.T, B.T, D.T))
    if not A.size:
        return np.zeros(0, dtype=complex)
    if not D.size:
        return np.linalg.eigvals(A).astype(complex)
    return np.linalg.eigvals(A - B @ np.linalg.solve(D, C)).astype(complex)


def _full_row_rank(
    A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n m"], C: Float[np.ndarray, "p n"], D: Float[np.ndarray, "p m"]
) -> Reduced:
    """Return a system with the same finite zeros whose D has full row rank.

    Outputs without feedthrough hold the states they see at zero; these states leave, and their equations become outputs.
    """
    limit = ROOT_EPS * max(1.0, float(np.linalg.norm(A)))
    while True:
        U, s, _ = np.linalg.svd(D)
        rank = int(np.count_nonzero(s > limit))
        C, D = U.T @ C, (U.T @ D)[:rank]
        _, seen, Vt = np.linalg.svd(C[rank:])
        held = int(np.count_nonzero(seen > limit))
        if held == 0:
            return A, B, C[:rank], D
        V = np.roll(Vt.T, -held, axis=1)  # the states that are seen become the last
        free = len(A) - held
        A, B, C = V.T @ A @ V, V.T @ B, C[:rank] @ V
        A, B, C, D = A[:free, :free], B[:free], np.vstack([A[free:, :free], C[:, :free]]), np.vstack([B[free:], D])


def static_gain(model: StateSpaceModel) -> Float[np.ndarray, "p m"]:
    """Return ``G(1)``: the steady change of each output per unit of each input; ±infinity through an integrator.

    Poles at 1 are split off, so that the gain of an output that does not see the integrator is finite.
    """
    first: Any = lambda pole: abs(pole - 1.0) > ROOT_EPS  # noqa: E731 - the stubs know real eigenvalues only
    T, Z, rest = schur(model.A.astype(complex), output="complex", sort=first)
    B, C, ones = Z.conj().T @ model.B, model.C @ Z, slice(rest, None)
    # T = [T11 T12; 0 T22] becomes block diagonal with the solution X of T11 X - X T22 = -T12.
    X = solve_sylvester(T[:rest, :rest], -T[ones, ones], -T[:rest, ones]) if 0 < rest < model.order else np.zeros((rest, 0))
    B1, C2 = B[:rest] - X @ B[ones] if X.size else B[:rest], C[:, ones] + (C[:, :rest] @ X if X.size else 0.0)
    gain = (model.D + C[:, :rest] @ np.linalg.solve(np.eye(rest) - T[:rest, :rest], B1)).real
    size = float(np.linalg.norm(model.C) * np.linalg.norm(model.B))
    for _ in range(model.order - rest):
        ramp = (C2 @ B[ones]).real
        gain = np.where(np.abs(ramp) > ROOT_EPS * size, np.copysign(np.inf, ramp), gain)
        C2 = C2 @ (T[ones, ones] - np.eye(model.order - rest))
    return np.asarray(gain)


def frequency_grid(model: StateSpaceModel, samples: int) -> Float[np.ndarray, " w"]:
    """Return frequencies [rad per sample] up to Nyquist, closer together at the resonances.

    Args:
        samples: Length of the record whose lowest frequency is the first of the grid.
    """
    lowest = max(2.0 * math.pi / max(samples, 20), 1e-4 * math.pi)  # four decades fit an axis
    grid = np.geomspace(lowest, math.pi, 160)
    values = np.linalg.eigvals(model.A)
    rates = np.log(values[np.abs(values) > 0.5].astype(complex))
    offsets = np.array([-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0])
    near = (np.abs(rates.imag)[:, None] + np.abs(rates.real)[:, None] * offsets).ravel()
    return np.unique(np.concatenate([grid, near[(near > lowest) & (near < math.pi)]]))


def frequency_response(model: StateSpaceModel, omega_rad: Float[np.ndarray, " w"]) -> Complex[np.ndarray, "w p m"]:
    """Return ``G(exp(jω))``, each input's after its dead time; infinite where a pole lies on the point.

    Args:
        omega_rad: Frequencies [rad per sample].
    """
    late = np.exp(-1j * omega_rad[:, None, None] * np.array(model.input_delay))
    values, vectors = np.linalg.eig(model.A)
    if np.linalg.cond(vectors) < 1e8:
        gaps = np.exp(1j * omega_rad)[:, None] - values
        with np.errstate(divide="ignore", invalid="ignore"):
            weighted = (model.C @ vectors) / gaps[:, None, :]
            return np.asarray((weighted @ np.linalg.solve(vectors, model.B.astype(complex)) + model.D) * late)
    # Defective: solve at every frequency, an integrator moved by rounding off the circle.
    shifted = np.exp(1j * omega_rad)[:, None, None] * (1.0 + 1e-12) * np.eye(model.order) - model.A
    moved = np.linalg.solve(shifted, np.broadcast_to(model.B, (len(omega_rad), *model.B.shape)))
    return np.asarray((model.C @ moved + model.D) * late)


def warn_of_growth(model: StateSpaceModel, samples: int) -> None:
    """Warn of a free run that an unstable model makes meaningless."""
    radius = spectral_radius(model.A)
    if is_unstable(model) and samples * math.log(radius) > math.log(GROWTH_MOST):
        warnings.warn(
            f"the model is unstable (spectral radius {radius:.4g}): over {samples} samples any error grows more than "
            f"{GROWTH_MOST:.0f}-fold; predict, or simulate its stable companion (identify with stable)",
            stacklevel=3,
        )


def response_steps(model: StateSpaceModel) -> int:
    """Return the number of samples after which an impulse response has died out, or as far as it can be shown."""
    if is_unstable(model):
        grown = int(math.log(GROWTH_MOST) / math.log(spectral_radius(model.A)))
        return max(STEPS_LEAST // 2, min(STEPS_MOST, grown)) + max(model.input_delay)
    response = impulse_response(model, 5 * STEPS_MOST)
    # The response of an integrator stays: its change has to die out.
    ends = [_died_out(response), _died_out(np.diff(response, axis=0))]
    return max(STEPS_LEAST, next((end for end in ends if end <= STEPS_MOST), STEPS_MOST))


def _died_out(response: Float[np.ndarray, "steps p m"]) -> int:
    """Return the step from which on each pair has only ``TAIL`` of its energy left."""
    left = np.cumsum(response[::-1] ** 2, axis=0)[::-1]
    return int(np.count_nonzero((left > TAIL * left[0]).any(axis=(1, 2))))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class TimeResponse(Brief, Plottable):
    """Outputs of a model after a step or an impulse of each input, as deviations from the offsets; unpacks as ``t_s, y``.

    Examples:
        >>> import numpy as np
        >>> import treadline as tl
        >>> one, none = np.eye(1), np.zeros(1)
        >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
        >>> t_s, y = lag.step(4)
        >>> y[:, 0, 0]
        array([0.  , 1.  , 1.5 , 1.75])
    """

    t_s: Float[np.ndarray, " steps"]
    """Time after the step or the impulse [s]."""
    y: Float[np.ndarray, "steps p m"]
    """Output p after a step or impulse of one unit of input m."""
    kind: str
    """``step`` or ``impulse``."""
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]

    def __iter__(self) -> Iterator[np.ndarray]:
        return iter((self.t_s, self.y))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class FrequencyResponse(Brief, Plottable):
    """Frequency response of a model; unpacks as ``frequency_hz, response``.

    Examples:
        >>> import numpy as np
        >>> import treadline as tl
        >>> one, none = np.eye(1), np.zeros(1)
        >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
        >>> lag.bode([0.001]).magnitude.round(3)
        array([[[2.]]])
    """

    frequency_hz: Float[np.ndarray, " w"]
    response: Complex[np.ndarray, "w p m"]
    """Gain ``G(exp(2πj f dt))`` from input m to output p."""
    dt_s: float
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]

    def __iter__(self) -> Iterator[np.ndarray]:
        return iter((self.frequency_hz, self.response))

    @property
    def magnitude(self) -> Float[np.ndarray, "w p m"]:
        """Magnitude |G|, not in decibels."""
        return np.abs(self.response)

    @property
    def phase_rad(self) -> Float[np.ndarray, "w p m"]:
        """Phase [rad], continuous over the frequencies; NaN where the gain is not finite."""
        return unwrapped_phase(self.response)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class StabilisationDiagram(Brief, Plottable):
    """Poles of every order in one list, each complex pair once."""

    order: Int[np.ndarray, " k"]
    frequency_hz: Float[np.ndarray, " k"]
    """Natural frequency ``|ln λ| / (2π T)`` [Hz]; the corner frequency for a real pole."""
    damping: Float[np.ndarray, " k"]
    """Damping ratio ``-Re ln λ / |ln λ|``: 1 for a decaying real pole, negative for a growing pole."""
    frequency_stable: Bool[np.ndarray, " k"]
    """Whether the next lower order has a pole within 1 % in frequency."""
    damping_stable: Bool[np.ndarray, " k"]
    """Whether such a pole is also within 5 % in damping."""
    nyquist_hz: float
    chosen: int
    """Order of the model; 0 without one."""


def time_response(model: StateSpaceModel, kind: Literal["step", "impulse"], steps: int | None) -> TimeResponse:
    """Return the response to a step, the cumulated impulse response, or to an impulse; as long as it changes without ``steps``."""
    y = impulse_response(model, response_steps(model) if steps is None else steps)
    inputs, outputs = channel_names(model)
    y = np.cumsum(y, axis=0) if kind == "step" else y
    return TimeResponse(t_s=np.arange(len(y)) * model.dt_s, y=y, kind=kind, input_names=inputs, output_names=outputs)


def bode(model: StateSpaceModel, frequency_hz: Sequence[float] | Float[np.ndarray, " w"] | None) -> FrequencyResponse:
    """Return the frequency response at the frequencies, or on a grid that is denser at the resonances.

    Raises:
        ModelError: If a frequency lies above the Nyquist frequency.
    """
    turns = 2.0 * np.pi * model.dt_s
    omega = frequency_grid(model, 1000) if frequency_hz is None else turns * np.asarray(frequency_hz, dtype=float)
    if omega.max(initial=0.0) > np.pi * (1.0 + 1e-9):
        raise ModelError(f"{omega.max() / turns:g} Hz lies above the Nyquist frequency of {0.5 / model.dt_s:g} Hz")
    inputs, outputs = channel_names(model)
    return FrequencyResponse(
        frequency_hz=omega / turns,
        response=frequency_response(model, omega),
        dt_s=model.dt_s,
        input_names=inputs,
        output_names=outputs,
    )


def unwrapped_phase(response: Complex[np.ndarray, "w ..."]) -> Float[np.ndarray, "w ..."]:
    """Return the phase [rad] without jumps of a turn; NaN where the response is not finite or zero."""
    known = np.isfinite(response) & (response != 0.0)
    angle = np.angle(np.where(known, response, 1.0))
    return np.where(known, np.unwrap(angle, axis=0), np.nan)
