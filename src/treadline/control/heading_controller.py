"""Heading controller: estimate and plan in, belt speeds out, once per period.

Paper: Section V, Eq. (11). ``HeadingEstimate, MotionPlan -> TrackCommand``. The plan gives speed (negative when backing down)
and target heading; without a plan the configured climb speed and zero heading apply.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.control._observer import Observer
from treadline.control.belt_allocation import CRUISE_M_S, INNER_RATIO_CLIMBING, BeltLimits, back_safe, climb_safe, clipped
from treadline.control.lqr import closed_loop_poles, static_inverse
from treadline.control.tune import BELT_DIFFERENCE, RADIUS_LIMIT, SIGMA_Y
from treadline.core.errors import NotStabilisable, PeriodMismatch, ShapeMismatch
from treadline.core.models import ControllerDesign, Reconstruct
from treadline.core.signals import PERIOD_ROUNDING_S, HeadingEstimate, MotionPlan, TrackCommand

_, YAW_RATE_SIGMA_RAD_S = SIGMA_Y
"""Standard deviation of the estimated yaw rate [rad/s]."""
FASTEST_TURN_RAD_S = 35.0
"""Gyro full scale, 2000 °/s [rad/s]: ten times the capability of the tracks (Table I: 3.07 rad/s)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerConfig:
    """Limits, allocation and period of the controller."""

    climb_speed_m_s: float = CRUISE_M_S
    max_speed_m_s: float = 1.0
    allocation: Literal["climb-safe", "paper"] = "climb-safe"
    reconstruct: Reconstruct | None = None
    """State reconstruction; None for the design's choice."""
    period_s: float = 0.25


class HeadingController:
    """State feedback u = u₀ - K x̂ on both belts, within their limits; x̂ is the state when the belts will answer.

    Raises:
        PeriodMismatch: If the design was made for another period.
        ShapeMismatch: If its model does not map two belts to heading and yaw rate.
        NotStabilisable: If the closed loop is unstable or too slow.
        NotDetectable: If the observer does not converge.
        NotInvertible: If static reconstruction is requested but impossible for the model.
    """

    follows_plan = True

    def __init__(self, design: ControllerDesign, config: ControllerConfig) -> None:
        _check_design(design, config.period_s)
        model = design.model
        self._design = design
        self._config = config
        self.period_s = config.period_s
        self._observer = Observer(model, design.observer_gain, BELT_DIFFERENCE, design.disturbance_gain)
        self._inverse = None
        if (config.reconstruct or design.reconstruct) == "static":
            self._inverse = static_inverse(design)
        else:
            self._observer.check()
        self._correction = np.linalg.pinv(model.A) @ design.observer_gain
        self._yaw_gain_ratio = 1.0
        self._last: Float[np.ndarray, " 2"] | None = None
        self._limited = [False] * (max(model.input_delay) + 1)

    def step(self, estimate: HeadingEstimate | None, t_s: float, plan: MotionPlan | None = None) -> TrackCommand:
        """Return the command for one estimate; stop without an estimate, or with implausible numbers.

        While the plan turns the chair itself or suspends steering, the command is also stop, and the estimated disturbance is
        reset.
        """
        if plan is not None and plan.turn_m_s is not None:
            self._last, self._yaw_gain_ratio = None, 1.0
            self._observer.forget()
            self._limited = [False] * len(self._limited)
            return TrackCommand.stop(t_s)
        speed = self._config.climb_speed_m_s if plan is None else plan.speed_m_s
        target, share = 0.0 if plan is None else plan.heading_rad, inner_ratio_of(plan)
        # NaN fails every comparison.
        sane = abs(speed) <= self._config.max_speed_m_s and abs(target) <= math.pi and abs(share) <= 1.0
        if estimate is None or not usable(estimate) or not sane:
            # The state is observed again within one period; the belt mismatch took many, so it is kept.
            self._last = None
            self._send(np.zeros(2), limited=False)
            return TrackCommand.stop(t_s)
        y = np.array([estimate.heading_rad - target, estimate.heading_rate_rad_s])
        asked = self._asked(y, speed)
        given = self._allocated(asked, speed, share)
        self._send(given - speed, limited=bool(abs((given[1] - given[0]) - (asked[1] - asked[0])) > 1e-9))
        self._last = y
        return TrackCommand(t_s=t_s, left_m_s=float(given[0]), right_m_s=float(given[1]))

    def _send(self, steering: Float[np.ndarray, " 2"], *, limited: bool) -> None:
        """Put a command, the belt speeds less the planned speed, into the queue of those under way."""
        self._observer.send(steering)
        self._limited = [limited, *self._limited[:-1]]

    def _allocated(self, asked: Float[np.ndarray, " 2"], speed_m_s: float, share: float) -> Float[np.ndarray, " 2"]:
        limits = BeltLimits(
            climb_speed_m_s=abs(speed_m_s),
            max_speed_m_s=self._config.max_speed_m_s,
            min_inner_speed_ratio=share,
            yaw_gain_ratio=self._yaw_gain_ratio,
        )
        if speed_m_s < 0.0:
            return back_safe(asked, limits)
        return (climb_safe if self._config.allocation == "climb-safe" else clipped)(asked, limits)

    def _asked(self, y: Float[np.ndarray, " 2"], speed_m_s: float) -> Float[np.ndarray, " 2"]:
        model = self._design.model
        # The speed is the plan's, not the speed during identification.
        centre = np.full(model.B.shape[1], speed_m_s)
        if self._inverse is not None:
            return np.asarray(centre - self._design.K @ (self._inverse @ (y - model.output_offset)))
        limited = any(self._limited[delay] for delay in model.input_delay)
        if self._last is None:
            self._observer.start(y)
        else:
            sticks = _in_dead_zone(float(self._observer.predicted()[1]), float(self._last[1]))
            self._observer.update(self._last, learn=not (limited or sticks))
        expected = self._observer.expected()
        if self._last is not None and limited:
            self._yaw_gain_ratio = _yaw_gain_ratio(float(expected[1]), float(y[1]))
        x = self._observer.state + self._correction @ (y - expected)
        return np.asarray(centre + self._observer.answer(self._design.K, x) - self._observer.disturbance * BELT_DIFFERENCE)


def _in_dead_zone(predicted_rad_s: float, measured_rad_s: float) -> bool:
    """Whether the inner belt sticks, so that a belt speed difference does not turn the chair.

    The predicted yaw rate is significant at three standard deviations, but the measured one is not. A sticking chair contains no
    information about belt mismatch, and the disturbance estimate would wind up (anti-windup).
    """
    return abs(predicted_rad_s) > 3.0 * YAW_RATE_SIGMA_RAD_S and abs(measured_rad_s) < YAW_RATE_SIGMA_RAD_S


def _yaw_gain_ratio(predicted_rad_s: float, measured_rad_s: float) -> float:
    """Return the measured yaw rate over the model's after a period at the largest belt speed difference, at least 1."""
    is_turning = abs(predicted_rad_s) > 3.0 * YAW_RATE_SIGMA_RAD_S
    return max(1.0, measured_rad_s / predicted_rad_s) if is_turning else 1.0


def inner_ratio_of(plan: MotionPlan | None) -> float:
    """Return the inner belt speed ratio of a plan."""
    return INNER_RATIO_CLIMBING if plan is None or plan.min_inner_speed_ratio is None else plan.min_inner_speed_ratio


def usable(estimate: HeadingEstimate) -> bool:
    """Whether an estimate is plausible; NaN and Inf are not."""
    return abs(estimate.heading_rad) <= math.pi and abs(estimate.heading_rate_rad_s) <= FASTEST_TURN_RAD_S


def _check_design(design: ControllerDesign, period_s: float) -> None:
    """Check that a design, possibly from a file, fits the chair.

    Raises:
        PeriodMismatch: If the design was made for another period.
        ShapeMismatch: If its model does not map two belts to heading and yaw rate.
        NotStabilisable: If the closed loop is unstable or too slow.
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
            f"the design's closed loop has spectral radius {radius:.3f}, the limit is {RADIUS_LIMIT}: its gain does not match "
            "its model; tune it again"
        )
