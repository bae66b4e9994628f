"""Results of a linear model's methods: time and frequency responses, which print briefly, unpack and draw themselves."""

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Complex, Float

from treadline.core.printing import Brief

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure_of(kind: str, item: object) -> "Figure":
    """Return the figure of a result.

    ``treadline.report`` draws, and stands above this package: its module is named by text, and loaded at the first figure.

    Args:
        kind: Function of ``treadline.report.model_plots``.
        item: Argument of the function.
    """
    figure: Figure = getattr(import_module("treadline.report.model_plots"), kind)(item)
    return figure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class TimeResponse(Brief):
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

    def plot(self) -> "Figure":
        """Return the matplotlib figure, one panel per pair of input and output."""
        return figure_of("time_response", self)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class FrequencyResponse(Brief):
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

    def plot(self) -> "Figure":
        """Return the matplotlib figure: magnitude and phase over frequency, one panel each per pair of input and output."""
        return figure_of("bode", self)


def unwrapped_phase(response: Complex[np.ndarray, "w ..."]) -> Float[np.ndarray, "w ..."]:
    """Return the phase [rad] without jumps of a turn; NaN where the response is not finite or zero."""
    known = np.isfinite(response) & (response != 0.0)
    angle = np.angle(np.where(known, response, 1.0))
    return np.where(known, np.unwrap(angle, axis=0), np.nan)
