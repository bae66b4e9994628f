"""Driver block: ``ImuSample, TrackReading, FlipperReading, StairMap, HeadingEstimate -> MotionPlan, TrackCommand``."""

from treadline.core.signals import HeadingEstimate, MotionPlan, TrackCommand
from treadline.mission._proposals import Proposals
from treadline.mission.belt_controllers import Driver
from treadline.mission.planner import Planner, PlannerInput
from treadline.mission.rates import Rate


class DriverBlock:
    """Planner at each tick, belt controller at its own period."""

    def __init__(self, planner: Planner, driver: Driver) -> None:
        self._planner = planner
        self._proposals = Proposals(driver)
        self._rate = Rate(driver.period_s)
        self.is_due = False
        """Whether a control period began at the last call of ``propose``."""

    def update(self, signal: PlannerInput) -> None:
        """Update the planner with a reading or a stair map."""
        self._planner.update(signal)

    def plan(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Return the plan of a tick."""
        return self._planner.step(t_s, estimate)

    def propose(self, plan: MotionPlan, estimate: HeadingEstimate | None, *, held: bool) -> TrackCommand | None:
        """Return the proposed belt speeds of a tick; None leaves the last proposal in force.

        Args:
            plan: The plan of this tick.
            estimate: The newest heading.
            held: Whether the guard holds the chair.
        """
        self.is_due = self._rate.due(plan.t_s)
        return self._proposals.step(plan, estimate, held=held, due=self.is_due)
