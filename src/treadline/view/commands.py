"""What a person does to a running simulation: faults, conditions, handset, each at a tick, so that a run can be repeated.

The same scenario, seed and script (``orders``) give the same run to the bit.
"""

from dataclasses import replace

from treadline.core.ports import Reading, Truth
from treadline.core.signals import TICK_S, FlipperCommand, HeadingEstimate, MotionPlan, OperatorInput, SeatCommand, TrackCommand
from treadline.mission.planner import Planner, PlannerInput
from treadline.plant.faults import FaultyPlant
from treadline.scenario.operator_actions import REPORT_S
from treadline.view.orders import Handset

REPORT_TICKS = round(REPORT_S / TICK_S)
"""Report period of the handset [ticks]."""


class Operator:
    """Handset of a live run: ``plant`` reports its state to the mission, ``planner`` drives by it."""

    def __init__(self) -> None:
        self.state: Handset | None = None
        """State, None before the first use: an unused handset does not report."""


class AttendedPlant:
    """Plant whose readings include the reports of the handset in the browser."""

    def __init__(self, plant: FaultyPlant, operator: Operator) -> None:
        self._plant, self._operator = plant, operator
        self._tick = 0

    def start(self) -> None:
        """Put the chair at its start pose."""
        self._plant.start()
        self._tick = 0

    def advance(self, until_s: float) -> None:
        """Advance to ``until_s``."""
        self._plant.advance(until_s)
        self._tick = round(until_s / TICK_S)

    def read(self) -> list[Reading]:
        """Return the readings of the plant, and ten times a second the state of a handset in use."""
        readings = list(self._plant.read())
        state = self._operator.state
        if state is not None and self._tick % REPORT_TICKS == 0:
            report = OperatorInput(t_s=self._tick * TICK_S, dead_man=state.dead_man, stop=state.stop, rearm=state.rearm)
            readings.append(report)
        return readings

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        """Send commands."""
        self._plant.write(tracks, seat, flipper)

    def truth(self) -> list[Truth]:
        """Return the ground truth of each tick since the last call."""
        return list(self._plant.truth())

    def close(self) -> None:
        """Release the plant."""
        self._plant.close()


class AttendedPlanner:
    """Planner whose speeds a person replaces while steering; the phases go on by what the chair does."""

    def __init__(self, planner: Planner, operator: Operator) -> None:
        self._planner, self._operator = planner, operator

    def update(self, signal: PlannerInput) -> None:
        """Update the planner."""
        self._planner.update(signal)

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Return the plan of this tick, with a person's speeds where a person steers."""
        plan = self._planner.step(t_s, estimate)
        state = self._operator.state
        if state is None or not state.manual:
            return plan
        return replace(plan, speed_m_s=state.speed_m_s, turn_m_s=state.turn_m_s, min_inner_speed_ratio=None)
