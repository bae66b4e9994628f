"""Interface of the planners, and the planner of a single flight.

``ImuSample, TrackReading, FlipperReading, StairMap, OperatorInput, HeadingEstimate -> MotionPlan``. ``traversal`` climbs and
descends; it ends in phase ``arrived``, in phase ``refused``, or in a plan with a reason to hold.
"""

from typing import Protocol, runtime_checkable

from treadline.core.signals import (
    FlipperReading,
    FreeGround,
    HeadingEstimate,
    ImuSample,
    MotionPlan,
    OperatorInput,
    StairMap,
    TrackReading,
)

PlannerInput = ImuSample | TrackReading | FlipperReading | StairMap | FreeGround | OperatorInput
"""Signals that a planner receives."""


@runtime_checkable
class Planner(Protocol):
    """State machine that sets phase and motion; ``step`` is called at each tick, after the tick's readings."""

    def update(self, signal: PlannerInput) -> None:
        """Update with one signal."""

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Return the plan of this tick; ``estimate`` is None before the first heading."""

    @property
    def to_go_m(self) -> float | None:
        """Distance along the belts from mid-track to the last nosing of the flight [m]; None while its end is not known."""


class Cruise:
    """Planner of a single flight: constant speed, steered by the belt controller."""

    def __init__(self, speed_m_s: float) -> None:
        self._speed_m_s = speed_m_s

    def update(self, signal: PlannerInput) -> None:
        """Ignore the signal."""

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Return the plan ``drive`` at the configured speed."""
        del estimate
        return MotionPlan(t_s=t_s, phase="drive", speed_m_s=self._speed_m_s)

    @property
    def to_go_m(self) -> float | None:
        """None: the end of the flight is not looked for."""
        return None
