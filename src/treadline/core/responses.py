"""Time and frequency responses of a linear model, which print briefly, unpack and draw themselves."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

from treadline.core.errors import ModelError
from treadline.core.linear_systems import impulse_response
from treadline.core.printing import Brief, Plottable
from treadline.core.state_space import StateSpaceModel, channel_names
from treadline.core.transfer_function import frequency_grid, frequency_response, response_steps


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
