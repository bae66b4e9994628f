"""Walker: the mission's planner drives a chair that rests on the ground at every instant, without a simulator of motion.

``Scenario, MissionConfig -> Walk``. The planner receives what an errorless camera, IMU and drives would report and moves belts and
flipper; the chair follows its rest pose (``vehicle.rest_poses``), or falls where that vanishes. What a drive does slowly, and that
is all that it is meant to do, a walk shows in a fraction of a second: pitch, margins, torque and friction on the whole way. It
knows no lateral motion and no slip.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.core.rotations import rotation_y
from treadline.core.signals import (
    FlipperReading,
    HeadingEstimate,
    ImuSample,
    MotionPlan,
    StairMap,
    TrackReading,
)
from treadline.mission.mission_blocks import planner_of
from treadline.mission.mission_config import MissionConfig
from treadline.mission.planner import Planner
from treadline.plant.sensors.statistical_camera import StatisticalCamera
from treadline.scenario.chair import GRAVITY_M_S2, ChairDescription
from treadline.scenario.scenario import Scenario
from treadline.vehicle.ground_profile import ground_profile
from treadline.vehicle.rest_poses import Fall, RestPose, fall_to, rest_chair
from treadline.vehicle.staircase import Staircase, as_designed
from treadline.vehicle.start_pose import standing
from treadline.vehicle.walk import Stride, Walk

STEP_S, STILL_RAD_S = 0.05, 1.0 * DEG
"""Time between two poses while the chair turns [s]: 0.45° of pitch at the fastest that the planner turns it; twice as long, 2 cm of
belts, below this pitch rate [rad/s]."""
ROCKS_S = 0.2
"""Time over which a pitch rate counts [s]: a chair that rocks by a degree takes so long by its inertia, at rest it takes none."""
LOOK_S = 0.2
"""Time between two maps [s]."""
ARRIVES = ("arrived", "end_of_flight", "time_up")
"""Ends of a walk that are no reason to refuse."""
YIELD_RAD = 0.5 * DEG
"""Step by which a flipper yields whose motor is overloaded [rad]."""


def walk(scenario: Scenario, chair: ChairDescription, mission: MissionConfig, *, until_rad_s: float = math.inf) -> Walk:
    """Return the walk of a scenario: chair and planner with the load that the operator entered.

    A walk does not turn. A stair that turns is walked from one turn to the next, and the walk that ends worst is returned.

    Args:
        until_rad_s: Pitch rate at which the walk ends.

    Raises:
        MechanicsError: If the chair cannot stand where it starts.
    """
    staircase = as_designed(scenario.stair, scenario.step, scenario.sill)
    if staircase.winders is not None:
        return _Walker(scenario, staircase, chair, mission).walk(until_rad_s)
    walks = []
    for flights, start in _courses(scenario, staircase):
        sills = tuple(sill._replace(flight=sill.flight - flights.start) for sill in mission.sills if sill.flight in flights)
        straight = replace(mission, flights=len(flights), sills=sills, landings=None)
        course = _on_the_floor(staircase.alone(staircase.course_of(flights.start)))
        walks.append(_Walker(scenario.changed(start=start), course, chair, straight).walk(until_rad_s))
        if walks[-1].end not in ARRIVES or walks[-1].fastest.rate_rad_s >= until_rad_s:
            return walks[-1]
    return max(walks, key=lambda walked: walked.fastest.rate_rad_s)


def _courses(scenario: Scenario, staircase: Staircase) -> Iterator[tuple[range, dict[str, Any]]]:
    """Yield the flights of each course that the chair drives over, and its start there in place of the scenario's."""
    place, is_up = scenario.start.place, scenario.drive.direction == "up"
    starts_on = staircase.course_of(scenario.stair.flight_of(scenario.start.step)) if place == "flight" else None
    for number, flights in enumerate(staircase.courses):
        if number == starts_on:
            yield flights, {"step": scenario.start.step - staircase.flights[flights.start][0].index}
        elif starts_on is None or (number > starts_on) == is_up:
            yield flights, {} if len(staircase.courses) == 1 else {"place": "floor" if is_up else "landing"}


def _on_the_floor(course: Staircase) -> Staircase:
    """Return a course that begins on the floor, in place of a landing."""
    landing_m = course.steps[0].z_m - course.steps[0].rise_m
    steps = tuple(replace(step, z_m=step.z_m - landing_m) for step in course.steps)
    return replace(course, steps=steps) if landing_m else course


class _Walker:
    """State of a walk."""

    def __init__(self, scenario: Scenario, staircase: Staircase, chair: ChairDescription, mission: MissionConfig) -> None:
        self._scenario, self._flipper = scenario, chair.flipper
        load = scenario.chair.entered
        self._chair = rest_chair(
            chair, load.payload_kg, offset_m=chair.in_chair(load.payload_offset_m), seat_shift_m=load.seat_shift_m
        )
        self._ground = ground_profile(staircase)
        self._end_x_m = staircase.flights[0][-1].x_m - 0.5 * chair.tracks.flat_run_m * math.cos(staircase.slope_rad)
        self._planner: Planner = planner_of(mission)
        camera = chair.camera_at(rear=mission.direction == "down")
        self._camera = StatisticalCamera(staircase, camera, np.random.default_rng(0), exact=True)
        start = standing(staircase, chair.tracks, scenario.start)
        pitch = math.atan2(float(start.R_WB[2, 0]), float(start.R_WB[0, 0]))
        angles = (chair.tracks.approach_angle_deg * DEG,)
        self._pose = self._chair.at(self._ground, float(start.p_WB[0]), angles, pitch)
        self._lag_s = chair.drives.lag_s
        self._speed_m_s = self._faster_m_s2 = self._rate_rad_s = 0.0
        self._t_s, self._looked_s = 0.0, -math.inf
        self._is_stalled = False
        """Whether the flipper's motor pushes with all of its torque."""

    def walk(self, until_rad_s: float) -> Walk:
        """Walk to the end, or until the chair turns so fast."""
        strides = [Stride(t_s=0.0, phase="search", pose=self._pose, rate_rad_s=0.0, fall=None)]
        while True:
            plan = self._plan()
            if (end := self._end(plan)) is not None:
                return self._walked(strides, end, plan.hold or plan.cause)
            try:
                fall = self._move(plan)
            except MechanicsError as error:
                return self._walked(strides, "tipped", str(error))
            rate = max(abs(self._rate_rad_s), 0.0 if fall is None else fall.rate_rad_s)
            strides.append(Stride(t_s=self._t_s, phase=plan.phase, pose=self._pose, rate_rad_s=rate, fall=fall))
            if rate >= until_rad_s:
                return self._walked(strides, "unquiet", plan.cause)

    def _end(self, plan: MotionPlan) -> str | None:
        """Return how the walk ends at a plan; None while it goes on."""
        if plan.phase in ("arrived", "refused"):
            return plan.phase
        if plan.hold is not None:
            return "held"
        if plan.phase == "drive" and self._pose.x_m >= self._end_x_m:
            return "end_of_flight"
        return "time_up" if self._t_s >= self._scenario.drive.duration_s else None

    def _walked(self, strides: list[Stride], end: str, cause: str) -> Walk:
        return Walk(ground=self._ground, chair=self._chair, strides=tuple(strides), end=end, cause=cause)

    def _plan(self) -> MotionPlan:
        """Return the plan of an instant from what the sensors would report."""
        t_s, pitch = self._t_s, self._pose.pitch_rad
        force = (GRAVITY_M_S2 * math.sin(pitch) + self._faster_m_s2, 0.0, GRAVITY_M_S2 * math.cos(pitch))
        turned = (math.cos(0.5 * pitch), 0.0, -math.sin(0.5 * pitch), 0.0)
        rates = (0.0, 0.0, 0.0)  # the feed-forward against tipping is for motion that a walk does not have
        self._planner.update(ImuSample(t_s=t_s, orientation=turned, angular_velocity_rad_s=rates, linear_acceleration_m_s2=force))
        self._planner.update(TrackReading(t_s=t_s, left_m_s=self._speed_m_s, right_m_s=self._speed_m_s, brake_on=False))
        if self._flipper is not None:
            self._planner.update(FlipperReading(t_s=t_s, angle_rad=self._pose.angles_rad[0], torque_n_m=self._torque()))
        estimate = self._look()
        return self._planner.step(t_s, estimate)

    def _look(self) -> HeadingEstimate:
        """Give the planner a map, if one is due, and return the heading: a walk is square to the stair."""
        if self._t_s - self._looked_s >= LOOK_S - 1e-9:
            self._looked_s = self._t_s
            p_WB = np.array([self._pose.x_m, 0.0, self._pose.height_m])
            for seen in self._camera.look(self._t_s, rotation_y(-self._pose.pitch_rad), p_WB):
                if isinstance(seen, StairMap):
                    self._planner.update(seen)
        return HeadingEstimate(t_s=self._t_s, heading_rad=0.0, heading_rate_rad_s=0.0, sigma_rad=0.01 * DEG, source="vision")

    def _torque(self) -> float:
        """Return the torque that the flipper's motor reads: its own weight raised, less what the ground turns up [N m]."""
        part, pose = self._chair.parts[1], self._pose
        level = 0.5 * float(part[2]) * math.cos(pose.pitch_rad + pose.angles_rad[0])
        borne = float(self._chair.torques_n_m[0]) if self._is_stalled else pose.torques_n_m[0]
        return float(self._chair.masses[1, 0]) * GRAVITY_M_S2 * level - borne

    def _move(self, plan: MotionPlan) -> Fall | None:
        """Move belts and flipper for one step; return the fall on the way, if any."""
        before, step_s = self._pose, STEP_S if abs(self._rate_rad_s) > STILL_RAD_S else 2.0 * STEP_S
        faster = (plan.speed_m_s - self._speed_m_s) * (1.0 - math.exp(-step_s / self._lag_s))
        self._speed_m_s, self._faster_m_s2 = self._speed_m_s + faster, faster / step_s
        angle = before.angles_rad[0]
        if plan.flipper is not None and self._flipper is not None:
            low_deg, high_deg = self._flipper.range_deg
            angle = min(max(angle + plan.flipper.rate_rad_s * step_s, low_deg * DEG), high_deg * DEG)
        along_m = self._speed_m_s * step_s
        x_m = before.x_m + along_m * math.cos(before.pitch_rad)
        after, fall = self._chair.moved(self._ground, before, x_m, (angle,))
        after, fall = self._without_slip(before, after, fall, along_m)
        turned = after.pitch_rad - before.pitch_rad
        self._pose, fall = self._yielded(after, fall)
        kept = 0.0 if fall is not None else math.exp(-step_s / ROCKS_S)
        self._rate_rad_s = kept * self._rate_rad_s + (1.0 - kept) * (turned if fall is None else 0.0) / step_s
        self._t_s = round(self._t_s + step_s, 6)
        return fall

    def _without_slip(self, before: RestPose, after: RestPose, fall: Fall | None, along_m: float) -> tuple[RestPose, Fall | None]:
        """Return the pose with the belts where they were on the ground: a chair that turns about a nosing moves over it."""
        (px, pz), turned = before.pivot_m, after.pitch_rad - before.pitch_rad
        slope = before.slopes[0] if before.front_share > 0.5 else before.slopes[1]
        ahead, above = before.x_m - px, before.height_m - pz
        x_m = px + along_m / math.hypot(1.0, slope) + ahead * math.cos(turned) - above * math.sin(turned)
        if abs(x_m - after.x_m) < 1e-4:
            return after, fall
        moved, further = self._chair.moved(self._ground, after, x_m, after.angles_rad)
        return moved, _larger(fall, further)

    def _yielded(self, pose: RestPose, fall: Fall | None) -> tuple[RestPose, Fall | None]:
        """Return the pose after a flipper has yielded that carries more than its motor can: it pushes with all it has."""
        limit, bears = float(self._chair.torques_n_m[0]), pose
        self._is_stalled = self._flipper is not None and pose.torques_n_m[0] > limit
        highest_rad = math.inf if self._flipper is None else self._flipper.range_deg[1] * DEG
        while self._is_stalled and pose.torques_n_m[0] > limit and pose.angles_rad[0] < highest_rad:
            pose, _ = self._chair.moved(self._ground, pose, pose.x_m, (pose.angles_rad[0] + YIELD_RAD,))
        if not self._is_stalled:
            return pose, fall
        # What the motor takes up does not speed the chair up.
        taken_m = limit * (pose.angles_rad[0] - bears.angles_rad[0]) / self._chair.weight_n
        sunk_m = max(bears.com_m[1] - pose.com_m[1] - taken_m, 0.0)
        return pose, _larger(fall, fall_to(pose, abs(pose.pitch_rad - bears.pitch_rad), sunk_m))


def _larger(one: Fall | None, other: Fall | None) -> Fall | None:
    """Return the fall that ends faster."""
    return max((fall for fall in (one, other) if fall is not None), key=lambda fall: fall.rate_rad_s, default=None)
