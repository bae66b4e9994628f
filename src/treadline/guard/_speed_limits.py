"""Limits of the belt speeds: by heading, by phase, and by speed restrictions (rows 12 and 18)."""

from dataclasses import replace

from treadline.core.signals import HeadingEstimate, MotionPlan, TrackCommand
from treadline.guard._guard_config import ENDS, FLIGHT, PITCHING, GuardConfig


def stands(plan: MotionPlan) -> bool:
    """Return whether the plan requires belts at rest, whatever the last proposal."""
    return plan.phase in ENDS or (plan.speed_m_s == 0.0 and plan.turn_m_s == 0.0)


def mean_limit(config: GuardConfig, estimate: HeadingEstimate | None, plan: MotionPlan | None, *, restricted: bool) -> float:
    """Return the largest mean belt speed [m/s].

    Args:
        config: Limits.
        estimate: Heading estimate; None counts as a large heading error.
        plan: Latest plan, if any.
        restricted: Whether a speed restriction applies.
    """
    turning = estimate is None or abs(estimate.heading_rad) > config.square_rad
    limit = config.turn_limit_m_s if turning else config.cruise_limit_m_s
    if plan is not None:
        pitching = plan.phase in PITCHING
        if pitching or not (turning or plan.phase in FLIGHT):
            limit = min(limit, (1.0 + config.plan_margin) * abs(plan.speed_m_s) + config.plan_spare_m_s)
        if pitching:
            limit = min(limit, config.slow_limit_m_s)
    return min(limit, config.slow_limit_m_s) if restricted else limit


def limited(command: TrackCommand, t_s: float, mean_limit_m_s: float, belt_limit_m_s: float, share: float) -> TrackCommand:
    """Return the command within its limits.

    The belt speed difference has precedence over the mean.

    Args:
        command: Proposed belt speeds.
        t_s: Time of the tick.
        mean_limit_m_s: Largest mean belt speed.
        belt_limit_m_s: Largest speed of one belt.
        share: Factor on both belts, 0 to 1.
    """
    left, right = 0.5 * command.left_m_s, 0.5 * command.right_m_s
    turn = min(max(right - left, -belt_limit_m_s), belt_limit_m_s)
    limit = min(mean_limit_m_s, belt_limit_m_s - abs(turn))
    mean = min(max(left + right, -limit), limit)
    if (mean, turn, share) == (left + right, right - left, 1.0):
        return replace(command, t_s=t_s)
    return TrackCommand(t_s=t_s, left_m_s=share * (mean - turn), right_m_s=share * (mean + turn), brake=command.brake)
