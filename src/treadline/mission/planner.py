"""What a traversal is about from moment to moment: the interface of its planners, and the one that only drives on.

``ImuSample, TrackReading, FlipperReading, StairMap, HeadingEstimate -> MotionPlan``. ``ascent`` goes up, ``descent`` comes down;
both end in ``arrived``, in ``refused`` after backing off, or in a plan that asks the guard to hold.
"""

from typing import Protocol, runtime_checkable

from treadline.signals import FlipperReading, HeadingEstimate, ImuSample, MotionPlan, StairMap, TrackReading

PlannerInput = ImuSample | TrackReading | FlipperReading | StairMap
"""What a planner listens to."""


@runtime_checkable
class Planner(Protocol):
    """Decides the phase; called at each tick, after what was read."""

    def update(self, signal: PlannerInput) -> None:
        """Take one signal."""

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Return what to do now."""


class Cruise:
    """On the flight and nowhere else: the heading controller, or an experiment's own driver, at one speed."""

    def __init__(self, speed_m_s: float) -> None:
        self._speed_m_s = speed_m_s

    def update(self, signal: PlannerInput) -> None:
        """Need nothing."""

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Return the same plan again."""
        del estimate
        return MotionPlan(t_s=t_s, phase="drive", speed_m_s=self._speed_m_s)
