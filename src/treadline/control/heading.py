"""The heading controller: the estimate and the plan in, belt speeds out, once per period.

Paper: Section V, Eq. (11). ``HeadingEstimate, MotionPlan -> TrackCommand``. The plan says how fast (backing down is negative) and
which heading; without one it is the configured climb speed and zero.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.control.allocate import SLOWEST_CLIMBING, BeltLimits, back_safe, climb_safe, clipped
from treadline.control.lqr import closed_loop_poles
from treadline.control.observer import Observer
from treadline.control.reconstruct import static_reconstruction
from treadline.control.tune import BELT_DIFFERENCE, RADIUS_LIMIT, SIGMA_Y
from treadline.errors import NotStabilisable, PeriodMismatch, ShapeMismatch
from treadline.models import ControllerDesign, Reconstruct
from treadline.signals import PERIOD_ROUNDING_S, HeadingEstimate, MotionPlan, TrackCommand

YAW_RATE_SIGMA_RAD_S = SIGMA_Y[1]
"""Standard deviation of the yaw rate as the estimator delivers it."""
FASTEST_TURN_RAD_S = 35.0
"""Full scale of the gyro, 2000 °/s: ten times what the tracks can do (Table I: 3.07 rad/s)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerConfig:
    """How a design is driven."""

    climb_speed_m_s: float = 0.2
    max_speed_m_s: float = 1.0
    allocation: Literal["climb-safe", "paper"] = "climb-safe"
    reconstruct: Reconstruct | None = None
    """None: as the design says."""
    period_s: float = 0.25


class HeadingController:
    """u = u₀ - K x̂ on both belts, within their limits.

    Raises:
        PeriodMismatch: If the design was made for another period.
        ShapeMismatch: If its model does not go from two belts to heading and yaw rate.
        NotStabilisable: If the loop it closes is too slow, or unstable.
        NotDetectable: If its observer does not converge.
        NotInvertible: If static reconstruction is asked of a model that does not allow it.
    """

    follows_plan = True

    def __init__(self, design: ControllerDesign, config: ControllerConfig) -> None:
        check_design(design, config.period_s)
        model = design.model
        self._design = design
        self._config = config
        self._observer = Observer(model, design.observer_gain, BELT_DIFFERENCE, design.disturbance_gain)
        self._inverse = None
        if (config.reconstruct or design.reconstruct) == "static":
            self._inverse = static_reconstruction(model.C, model.D, design.K)
        else:
            self._observer.check()
        self._correction = np.linalg.pinv(model.A) @ design.observer_gain
        self._last: tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"], bool] | None = None

    @property
    def period_s(self) -> float:
        """Time between calls."""
        return self._config.period_s

    def step(self, estimate: HeadingEstimate | None, t_s: float, plan: MotionPlan | None = None) -> TrackCommand:
        """Answer one estimate; without one, or with numbers that no chair and no plan can have, stand still.

        Where the plan turns the chair itself, or lets it alone because it does not turn as it steers, it stands still too, and what
        it has learned of the belts is void.
        """
        if plan is not None and plan.turn_m_s is not None:
            self._last = None
            self._observer.forget()
            return TrackCommand.stop(t_s)
        speed = self._config.climb_speed_m_s if plan is None else plan.speed_m_s
        target, share = 0.0 if plan is None else plan.heading_rad, share_kept(plan)
        # NaN fails every comparison.
        sane = abs(speed) <= self._config.max_speed_m_s and abs(target) <= math.pi and abs(share) <= 1.0
        if estimate is None or not usable(estimate) or not sane:
            # The state is seen again in one period; what the belts' mismatch is took many.
            self._last = None
            return TrackCommand.stop(t_s)
        y = np.array([estimate.heading_rad - target, estimate.heading_rate_rad_s])
        asked = self._asked(y, speed)
        given = self._allocated(asked, speed, share)
        limited = abs((given[1] - given[0]) - (asked[1] - asked[0])) > 1e-9
        self._last = (given, y, limited)
        return TrackCommand(t_s=t_s, left_m_s=float(given[0]), right_m_s=float(given[1]))

    def _allocated(self, asked: Float[np.ndarray, " 2"], speed_m_s: float, share: float) -> Float[np.ndarray, " 2"]:
        limits = BeltLimits(climb_speed_m_s=abs(speed_m_s), max_speed_m_s=self._config.max_speed_m_s, min_inner_speed_ratio=share)
        if speed_m_s < 0.0:
            return back_safe(asked, limits)
        return (climb_safe if self._config.allocation == "climb-safe" else clipped)(asked, limits)

    def _asked(self, y: Float[np.ndarray, " 2"], speed_m_s: float) -> Float[np.ndarray, " 2"]:
        model = self._design.model
        # The speed is the plan's, not that of the day the model was identified.
        centre = np.full(model.B.shape[1], speed_m_s)
        if self._inverse is not None:
            return np.asarray(centre - self._design.K @ (self._inverse @ (y - model.output_offset)))
        if self._last is None:
            self._observer.start(y)
        else:
            given, before, limited = self._last
            u = given - centre + model.input_offset
            sticks = in_dead_zone(float(self._observer.predicted(u)[1]), float(before[1]))
            self._observer.update(u, before, learn=not (limited or sticks))
        seen = y - model.output_offset - model.C @ self._observer.state
        x = self._observer.state + self._correction @ seen
        return np.asarray(centre - self._design.K @ x - self._observer.disturbance * BELT_DIFFERENCE)


def in_dead_zone(predicted_rad_s: float, measured_rad_s: float) -> bool:
    """Say whether the inner belt sticks, so that a belt difference does not turn the chair.

    The model predicts a yaw rate that is significant at three standard deviations, and none is measured. Such a chair tells nothing
    about a mismatch of its belts: a disturbance estimate that went on would wind up.
    """
    return abs(predicted_rad_s) > 3.0 * YAW_RATE_SIGMA_RAD_S and abs(measured_rad_s) < YAW_RATE_SIGMA_RAD_S


def share_kept(plan: MotionPlan | None) -> float:
    """Return the share of the climb speed that the slower belt keeps."""
    return SLOWEST_CLIMBING if plan is None or plan.min_inner_speed_ratio is None else plan.min_inner_speed_ratio


def usable(estimate: HeadingEstimate) -> bool:
    """Say whether an estimate is a number that a chair can have; NaN and Inf are not."""
    return abs(estimate.heading_rad) <= math.pi and abs(estimate.heading_rate_rad_s) <= FASTEST_TURN_RAD_S


def check_design(design: ControllerDesign, period_s: float) -> None:
    """Check that a design, perhaps from a file, fits the chair's loop.

    Raises:
        PeriodMismatch: If it was made for another period.
        ShapeMismatch: If its model does not go from two belts to heading and yaw rate.
        NotStabilisable: If the loop it closes is too slow, or unstable.
    """
    model = design.model
    if abs(design.period_s - period_s) > PERIOD_ROUNDING_S or abs(model.dt_s - design.period_s) > PERIOD_ROUNDING_S:
        raise PeriodMismatch(
            f"the controller runs at {period_s:g} s, its design at {design.period_s:g} s and its model at "
            f"{model.dt_s:g} s; tune it again with --period {period_s:g}"
        )
    if model.D.shape != (2, 2):
        raise ShapeMismatch(
            f"the design's model has {model.D.shape[1]} inputs and {model.D.shape[0]} outputs; the chair needs two belts in, "
            "heading and yaw rate out"
        )
    radius = float(np.abs(closed_loop_poles(design)).max())
    if not radius < RADIUS_LIMIT:
        raise NotStabilisable(
            f"the design's closed loop has spectral radius {radius:.3f}, the limit is {RADIUS_LIMIT}: its gain does not belong "
            "to its model; tune it again"
        )
