"""Gain and phase margin of a loop gain, from its frequency response."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from treadline.core.state_space import StateSpaceModel
from treadline.core.transfer_function import frequency_grid, frequency_response


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopMargins:
    """Stability margins of a loop gain L(z) that is closed by negative feedback.

    Examples:
        >>> import numpy as np
        >>> import treadline as tl
        >>> one, none = np.eye(1), np.zeros(1)
        >>> lag = tl.LinearModel(A=0.5 * one, B=one, C=one, D=0 * one, dt_s=0.1, input_offset=none, output_offset=none)
        >>> round(lag.margins().gain, 3), round(lag.margins().gain_frequency_hz, 3)
        (1.5, 5.0)
    """

    gain: float
    """Factor on L, nearest to 1, that puts a pole on the unit circle; infinite if none does."""
    gain_frequency_hz: float
    """Frequency of that pole [Hz]; NaN without one."""
    phase_rad: float
    """Phase lag of L, nearest to 0, that puts a pole on the unit circle, negative for a lead [rad]; infinite if none does."""
    phase_frequency_hz: float
    """Frequency of that pole [Hz]; NaN without one."""


def margins(model: StateSpaceModel) -> LoopMargins:
    """Return the stability margins of the first input and output, as ``LinearModel.margins`` states."""
    # A dead time of hundreds of samples turns the phase between the points of a logarithmic grid.
    grid = np.union1d(frequency_grid(model, 1000), np.linspace(0.0, math.pi, 4001))

    def loop(omega_rad: Any) -> Any:
        return frequency_response(model, np.atleast_1d(omega_rad))[:, 0, 0]

    def crossings(of: Callable[[Any], Any]) -> list[float]:
        values = of(loop(grid))
        at = np.flatnonzero(np.isfinite(values[:-1] + values[1:]) & (np.sign(values[:-1]) != np.sign(values[1:])))
        return [float(brentq(lambda omega: of(loop(omega))[0], grid[k], grid[k + 1])) for k in at]

    # At both ends the response is real.
    turned = [(float(-1.0 / L.real), omega) for omega in {0.0, math.pi, *crossings(np.imag)} for L in loop(omega) if L.real < 0.0]
    unit = [(float(np.angle(-L)), omega) for omega in crossings(lambda L: np.abs(L) - 1.0) for L in loop(omega)]
    gain, gain_at = min(turned, key=lambda item: abs(math.log(item[0])), default=(math.inf, math.nan))
    phase, phase_at = min(unit, key=lambda item: abs(item[0]), default=(math.inf, math.nan))
    turns = 2.0 * math.pi * model.dt_s
    return LoopMargins(gain=gain, gain_frequency_hz=gain_at / turns, phase_rad=phase, phase_frequency_hz=phase_at / turns)
