"""The driver node that stands until it has a goal: one traversal for each goal, with its progress and its outcome.

``StairGoal, readings -> MotionPlan, TrackCommand, TraversalProgress, Outcome, Traversed``. The action of ROS 2 is made of it.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Literal, NamedTuple

from treadline.core.errors import SettingsError
from treadline.core.ports import Transport
from treadline.core.rotations import Vector3, rotation_of
from treadline.core.signals import MEMORY_S, ImuSample, MotionPlan, Phase, StairMap
from treadline.guard import GuardConfig
from treadline.mission import DriverBlock
from treadline.mission.belt_controllers import Driver
from treadline.mission.mission_blocks import build_blocks
from treadline.mission.mission_config import MissionConfig
from treadline.mission.odometry import Odometry
from treadline.mission.planner import Planner, PlannerInput
from treadline.ros import channels as on
from treadline.ros.block_nodes import DriverNode
from treadline.ros.stair_goal import StairGoal, Traversed, foot_in_odom, mismatch, traversed
from treadline.vehicle.loading import Loading, centre_of_mass_level
from treadline.vehicle.rest_poses import rest_chair
from treadline.vehicle.tip_over_margin import sideways_margins


class TraversalProgress(NamedTuple):
    """Progress of a traversal; NaN while a value is not known."""

    phase: Phase
    heading_rad: float
    distance_to_go_m: float
    """Distance along the belts from mid-track to the last nosing of the flight [m]."""
    stability_margin_rad: float
    """Smallest tip-over margin at the measured attitude, with the entered payload and level seat [rad]."""
    remaining_s: float
    """Time to the last nosing at the present speed [s]."""


class Outcome(NamedTuple):
    """End of a traversal."""

    verdict: Literal["arrived", "refused", "held", "time_up", "cancelled", "lease_over"]
    cause: str


BEFORE_ENTRY: tuple[Phase, ...] = ("search", "align", "approach")
"""Phases in which the stair in view is compared with that of the goal."""


class GoalDriverNode(DriverNode):
    """Driver that plans while it has a goal; without one the belts stand.

    Args:
        config: Mission configuration of each goal.
        limits: Limits of the admission of readings.
    """

    def __init__(self, config: MissionConfig, limits: GuardConfig) -> None:
        self._config = config
        self._loading = Loading(chair=config.chair, payload_kg=config.payload_kg)
        self._chair = rest_chair(config.chair, config.payload_kg)
        super().__init__(*_planner_and_driver(config), limits)
        self._newest: dict[type, PlannerInput] = {}
        self._t_s = self._until_s = 0.0
        self._phase: Phase = "arrived"
        self._speed_m_s = self._heard_s = 0.0
        self._goal = StairGoal()
        self._foot_O: Vector3 | None = None
        self.odometry: Odometry | None = None
        """Newest pose of the chair."""
        self._begun: Odometry | None = None
        self._rise_m: float | None = None
        self.traversed = Traversed()
        """What the last traversal was by the odometry."""
        self._fastest_m_s = min(config.chair.drives.max_speed_m_s, limits.cruise_limit_m_s)
        self._cancelled: str | None = None
        self._hold: str | None = None
        """Why the chair is to be held after a goal, until the guard reports that it holds."""
        self.on_end: Callable[[Outcome], object] | None = None
        """Receives the outcome of the present goal; None without a goal."""

    def listen(self, transport: Transport) -> None:
        """Subscribe to the odometry, too."""
        super().listen(transport)
        transport.subscribe(on.ODOM, partial(setattr, self, "odometry"))

    def begin(self, goal: StairGoal, on_end: Callable[[Outcome], object]) -> None:
        """Begin a traversal.

        Args:
            goal: The stair, and how it is to be traversed.
            on_end: Receives the outcome.

        Raises:
            SettingsError: If it cannot begin.
        """
        self._check(goal)
        foot_O = foot_in_odom(goal, self.odometry)
        stair = self._stair_in_view()
        other = None if stair is None else mismatch(goal, foot_O, stair, self.odometry)
        if other is not None:
            raise SettingsError(other)
        config = self._config
        self._block = DriverBlock(*_planner_and_driver(replace(config, climb_speed_m_s=goal.speed_m_s or config.climb_speed_m_s)))
        for signal in self._newest.values():
            self._block.update(signal)
        self._goal, self._foot_O, self._begun, self._rise_m = goal, foot_O, self.odometry, None
        self._until_s, self._heard_s = self._t_s + (goal.limit_s or math.inf), self._t_s
        self._cancelled = None
        self.on_end = on_end

    def _check(self, goal: StairGoal) -> None:
        config, fastest, held = self._config, self._fastest_m_s, self._holding or self._hold
        if self.on_end is not None:
            raise SettingsError("a traversal is under way; cancel it first")
        if held is not None:
            raise SettingsError(f"the guard holds the chair: {held}; re-arm it first")
        if goal.direction not in (None, config.direction):
            remedy = f"start one whose scenario has drive.direction = '{goal.direction}'"
            raise SettingsError(f"this graph goes {config.direction}; {remedy}")
        if not 0.0 <= goal.speed_m_s <= fastest or not goal.limit_s >= 0.0:
            seen = f"a speed of {goal.speed_m_s:g} m/s, a limit of {goal.limit_s:g} s"
            raise SettingsError(f"{seen}; give 0 to {fastest:g} m/s, and a positive time")
        if not (goal.lease_s >= 0.0 and goal.step_rise_m >= 0.0):
            raise SettingsError(f"a lease of {goal.lease_s:g} s, a rise of {goal.step_rise_m:g} m; give positive numbers")

    def renew(self) -> None:
        """Take a sign of the client: its lease begins anew."""
        self._heard_s = self._t_s

    def cancel(self, cause: str) -> None:
        """Hold the chair and end the traversal at the next tick."""
        self._cancelled = cause

    def abandon(self, cause: str) -> None:
        """End the traversal without a further tick, as the node stops."""
        on_end, self.on_end = self.on_end, None
        if on_end is not None:
            on_end(Outcome("held", cause))

    @property
    def progress(self) -> TraversalProgress:
        """Progress of the traversal."""
        heading_rad = math.nan if self._estimate is None else self._estimate.heading_rad
        to_go_m = math.nan if self._block.to_go_m is None else self._block.to_go_m
        speed_m_s = abs(self._speed_m_s)
        remaining_s = to_go_m / speed_m_s if speed_m_s else math.nan
        return TraversalProgress(self._phase, heading_rad, to_go_m, self._margin_rad(), remaining_s)

    def _plan(self, t_s: float) -> MotionPlan:
        self._t_s = t_s
        if self.on_end is None:
            self._hold = None if self._holding is not None else self._hold
            still = MotionPlan(t_s=t_s, phase="arrived", speed_m_s=0.0, turn_m_s=0.0, needs_stair=False, cause="no goal")
            return replace(still, hold=self._hold)
        plan = super()._plan(t_s)
        self._phase, self._speed_m_s = plan.phase, plan.speed_m_s
        outcome = self._outcome(plan)
        if outcome is None:
            return plan
        on_end, self.on_end = self.on_end, None
        self.traversed = traversed(self._begun, self.odometry, self._rise_m, self._estimate)
        on_end(outcome)
        stands = replace(plan, speed_m_s=0.0, turn_m_s=0.0, needs_stair=False)
        if outcome.verdict in ("cancelled", "time_up", "lease_over"):
            self._hold = outcome.cause
            return replace(stands, hold=outcome.cause)
        return stands if outcome.verdict == "refused" else plan

    def _outcome(self, plan: MotionPlan) -> Outcome | None:
        if self._cancelled is not None:
            return Outcome("cancelled", self._cancelled)
        held = self._holding or plan.hold
        if held is not None:
            return Outcome("held", held)
        if plan.phase in ("arrived", "refused"):
            return Outcome("arrived" if plan.phase == "arrived" else "refused", plan.cause)
        other = self._other_stair(plan.phase)
        if other is not None:
            return Outcome("refused", other)
        lease_s = self._goal.lease_s
        if lease_s and plan.t_s - self._heard_s > lease_s:
            return Outcome("lease_over", f"the client of the goal is silent for {lease_s:g} s")
        if plan.t_s >= self._until_s:
            return Outcome("time_up", f"the time limit of the goal is over at {plan.t_s:.1f} s")
        return None

    def _other_stair(self, phase: Phase) -> str | None:
        """Return how the stair in view differs from that of the goal, before the chair enters it."""
        stair = self._stair_in_view()
        if stair is None:
            return None
        self._rise_m = stair.rise_m
        return mismatch(self._goal, self._foot_O, stair, self.odometry) if phase in BEFORE_ENTRY else None

    def _stair_in_view(self) -> StairMap | None:
        stair = self._newest.get(StairMap)
        return stair if isinstance(stair, StairMap) and self._t_s - stair.t_s <= MEMORY_S else None

    def _update(self, signal: PlannerInput) -> None:
        super()._update(signal)
        self._newest[type(signal)] = signal

    def _margin_rad(self) -> float:
        """Return the margin as if on the stair seen last, on the flat without one; NaN before the first attitude."""
        imu, stair = self._newest.get(ImuSample), self._newest.get(StairMap)
        if not isinstance(imu, ImuSample):
            return math.nan
        rise_m, run_m = (stair.rise_m, stair.run_m) if isinstance(stair, StairMap) else (0.0, 1.0)
        front_rad, rear_rad = self._chair.least_margins(rise_m, run_m, (0.0,))
        leans_rad = imu.pitch_rad - math.atan2(rise_m, run_m)
        ux, uy, uz = rotation_of(imu.orientation)[2].tolist()
        x_m, z_m = centre_of_mass_level(self._loading, imu.pitch_rad)
        sideways = sideways_margins(self._config.chair.tracks, (x_m, 0.0, z_m), (ux, uy, uz))
        return min(front_rad + leans_rad, rear_rad - leans_rad, *sideways)


def _planner_and_driver(config: MissionConfig) -> tuple[Planner, Driver]:
    blocks = build_blocks(config)
    return blocks.planner, blocks.driver
