"""Belt controllers: the interface, and constant speed for open-loop runs."""

from typing import Protocol, runtime_checkable

from treadline.core.signals import HeadingEstimate, MotionPlan, TrackCommand


@runtime_checkable
class Driver(Protocol):
    """Belt controller: computes a proposal from the heading estimate once per ``period_s``."""

    @property
    def period_s(self) -> float:
        """Control period [s]."""

    @property
    def follows_plan(self) -> bool:
        """Whether ``step`` applies the plan's speed and heading: the condition for a full traversal, and for the slip monitor."""

    def step(self, estimate: HeadingEstimate | None, t_s: float, plan: MotionPlan) -> TrackCommand:
        """Return the proposed belt speeds at ``t_s``; the plan gives speed and heading."""


class ConstantSpeed:
    """Open loop: both belts at the climb speed, whatever the heading (Fig. 9, open loop)."""

    follows_plan = False

    def __init__(self, speed_m_s: float, period_s: float) -> None:
        self._speed_m_s = speed_m_s
        self._period_s = period_s

    @property
    def period_s(self) -> float:
        """Time between calls."""
        return self._period_s

    def step(self, estimate: HeadingEstimate | None, t_s: float, plan: MotionPlan) -> TrackCommand:
        """Return the climb speed on both belts."""
        del estimate, plan
        return TrackCommand(t_s=t_s, left_m_s=self._speed_m_s, right_m_s=self._speed_m_s)
