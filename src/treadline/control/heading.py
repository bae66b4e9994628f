"""The heading controller: the estimate in, belt speeds out, once per period.

Paper: Section V, Eq. (11). ``HeadingEstimate -> TrackCommand``.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.control.allocate import BeltLimits, climb_safe, clipped
from treadline.control.observer import Observer
from treadline.control.reconstruct import static_reconstruction
from treadline.control.tune import BELT_DIFFERENCE
from treadline.errors import PeriodMismatch
from treadline.models import ControllerDesign
from treadline.signals import HeadingEstimate, TrackCommand


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerConfig:
    """How a design is driven."""

    climb_speed_m_s: float = 0.2
    max_speed_m_s: float = 1.0
    allocation: Literal["climb-safe", "paper"] = "climb-safe"
    reconstruct: Literal["observer", "static"] = "observer"
    period_s: float = 0.25


class HeadingController:
    """u = u₀ - K x̂ on both belts, within their limits.

    Raises:
        PeriodMismatch: If the design was made for another period.
        NotInvertible: If static reconstruction is asked of a model that does not allow it.
    """

    def __init__(self, design: ControllerDesign, config: ControllerConfig) -> None:
        if abs(design.period_s - config.period_s) > 1e-9 or abs(design.model.dt_s - design.period_s) > 1e-9:
            raise PeriodMismatch(
                f"the controller runs at {config.period_s:g} s, its design at {design.period_s:g} s and its model at "
                f"{design.model.dt_s:g} s; tune it again with --period {config.period_s:g}"
            )
        self._design = design
        self._config = config
        self._limits = BeltLimits(climb_speed_m_s=config.climb_speed_m_s, max_speed_m_s=config.max_speed_m_s)
        self._inverse = static_reconstruction(design.model.C, design.model.D, design.K) if config.reconstruct == "static" else None
        disturbance_gain = np.zeros(2) if design.disturbance_gain is None else design.disturbance_gain
        self._observer = Observer(design.model, design.observer_gain, BELT_DIFFERENCE, disturbance_gain)
        self._correction = np.linalg.pinv(design.model.A) @ design.observer_gain
        self._last: tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"], bool] | None = None

    @property
    def period_s(self) -> float:
        """Time between calls."""
        return self._config.period_s

    def step(self, estimate: HeadingEstimate | None, t_s: float) -> TrackCommand:
        """Answer one estimate; without one, stand still."""
        if estimate is None or not (math.isfinite(estimate.heading_rad) and math.isfinite(estimate.heading_rate_rad_s)):
            self._last = None
            return TrackCommand.stop(t_s)
        y = np.array([estimate.heading_rad, estimate.heading_rate_rad_s])
        asked = self._asked(y)
        given = (climb_safe if self._config.allocation == "climb-safe" else clipped)(asked, self._limits)
        limited = abs((given[1] - given[0]) - (asked[1] - asked[0])) > 1e-9
        self._last = (given, y, limited)
        return TrackCommand(t_s=t_s, left_m_s=float(given[0]), right_m_s=float(given[1]))

    def _asked(self, y: Float[np.ndarray, " 2"]) -> Float[np.ndarray, " 2"]:
        model = self._design.model
        # The climb speed is the operator's, not that of the day the model was identified.
        centre = np.full(model.B.shape[1], self._config.climb_speed_m_s)
        if self._inverse is not None:
            return np.asarray(centre - self._design.K @ (self._inverse @ (y - model.output_offset)))
        if self._last is None:
            self._observer.start(y)
        else:
            given, before, limited = self._last
            self._observer.update(given - centre + model.input_offset, before, learn=not limited)
        seen = y - model.output_offset - model.C @ self._observer.state
        x = self._observer.state + self._correction @ seen
        return np.asarray(centre - self._design.K @ x - self._observer.disturbance * BELT_DIFFERENCE)
