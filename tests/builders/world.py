"""The simulated world of unit tests: signals with defaults, a straight flight, and a chair that does what its plan says.

Loop, planners and guard are tested with these signals. Nothing here is computed by the code under test, except rotations.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np

from treadline.core.angles import DEG
from treadline.core.ports import Truth
from treadline.core.rotations import quaternion_of, rotation_x, rotation_y, rotation_z
from treadline.core.signals import (
    FlipperReading,
    FrameQuality,
    HeadingEstimate,
    HeadingHealth,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    StairMap,
    TrackReading,
)
from treadline.guard import GuardConfig
from treadline.mission.mission_config import MissionConfig
from treadline.scenario.chair import read_chair

TICK_S, G_M_S2 = 0.01, 9.81
RISE_M, RUN_M = 0.16, 0.30
SLOPE_RAD, PITCH_M = math.atan2(RISE_M, RUN_M), math.hypot(RISE_M, RUN_M)
CHAIR = read_chair("wheelchair")
CONFIG = MissionConfig(chair=CHAIR, payload_kg=50.0, climb_speed_m_s=0.2)
PIVOT_M = 0.5 * CHAIR.tracks.flat_run_m
"""Distance of each pulley from mid-track."""


def imu(
    t_s: float,
    pitch_rad: float = 0.0,
    *,
    roll_rad: float = 0.0,
    yaw_rad: float = 0.0,
    rates_rad_s: Sequence[float] = (0.0, 0.0, 0.0),
    speeds_up_m_s2: float = 0.0,
) -> ImuSample:
    """Return the sample of a perfect IMU; pitch is positive with the front up, ``speeds_up_m_s2`` along the chair."""
    R_WB = rotation_z(yaw_rad) @ rotation_y(-pitch_rad) @ rotation_x(roll_rad)
    return imu_at(t_s, R_WB, rates_rad_s, speeds_up_m_s2)


def imu_at(t_s: float, R_WB: np.ndarray, rates_rad_s: Sequence[float] = (0.0, 0.0, 0.0), speeds_up_m_s2: float = 0.0) -> ImuSample:
    """Return the sample of a perfect IMU in an attitude."""
    return ImuSample(
        t_s=t_s,
        orientation=quaternion_of(R_WB),
        angular_velocity_rad_s=np.array(rates_rad_s, dtype=float),
        linear_acceleration_m_s2=R_WB.T @ np.array([0.0, 0.0, G_M_S2]) + np.array([speeds_up_m_s2, 0.0, 0.0]),
    )


def belts(t_s: float, left: float = 0.2, right: float = 0.2, *, brake_on: bool = False) -> TrackReading:
    """Return a reading of both belts [m/s]."""
    return TrackReading(t_s=t_s, left_m_s=left, right_m_s=right, brake_on=brake_on)


def heading(t_s: float, heading_deg: float = 0.0) -> HeadingMeasurement:
    """Return a heading that vision measured."""
    return HeadingMeasurement(t_s=t_s, heading_rad=heading_deg * DEG, sigma_rad=0.004, edge_count=5)


def estimate(t_s: float = 0.0, heading_rad: float = 0.0, rate_rad_s: float = 0.0) -> HeadingEstimate:
    """Return an estimate of the heading filter that rests on vision."""
    return HeadingEstimate(t_s=t_s, heading_rad=heading_rad, heading_rate_rad_s=rate_rad_s, sigma_rad=0.01, source="vision")


def flipper(t_s: float, angle_rad: float, torque_n_m: float = 0.0) -> FlipperReading:
    """Return a reading of the flipper."""
    return FlipperReading(t_s=t_s, angle_rad=angle_rad, torque_n_m=torque_n_m)


def health(t_s: float, fault: Any = None, since_s: float | None = None, cause: str | None = None) -> HeadingHealth:
    """Return the state of the heading filter's fault detection."""
    return HeadingHealth(
        t_s=t_s,
        fault=fault,
        since_s=since_s,
        cause=cause,
        disagreement_rad=0.0,
        unseen_s=0.0,
        bias_rad_s=0.0,
        scale=1.0,
        walk_rad_rts=0.0,
    )


def stair(t_s: float, nosings_B: Sequence[Any], **changes: Any) -> StairMap:
    """Return the map of a flight; a nosing is a place (x, y, z) in B, or its distance alone."""
    places = [place if np.ndim(place) else (place, 0.0, 0.0) for place in nosings_B]
    values: dict[str, Any] = {
        "direction": "up",
        "rise_m": RISE_M,
        "run_m": RUN_M,
        "slope_rad": SLOPE_RAD,
        "ends": False,
        "left_wall_m": None,
        "right_wall_m": None,
        "obstacle_m": None,
    }
    return StairMap(t_s=t_s, nosings_B=np.array(places, dtype=float).reshape(-1, 3), **{**values, **changes})


def limits(**changes: Any) -> GuardConfig:
    """Return the guard's limits for the wheelchair, from literals of its chair file and 4 Hz control; no planner is awaited."""
    values: dict[str, Any] = {
        "belt_limit_m_s": 1.0,
        "drive_lag_s": 0.15,
        "drive_acceleration_m_s2": 4.0,
        "seat_rate_m_s": 0.06,
        "flipper_rate_rad_s": 30.0 * DEG,
        "front_m": 0.995,
        "rear_m": 0.55,
        "gauge_m": 0.65,
        "track_span_m": 0.95,
        "level_turn_share": 0.789,
        "normal_slip": 0.3,
        "driver_timeout_s": 0.75,
        "has_planner": False,
    }
    return GuardConfig(**{**values, **changes})


def truth(t_s: float, **values: float) -> Truth:
    """Return a ground truth that is zero but for what is given."""
    return Truth(**(dict.fromkeys(Truth.__slots__, 0.0) | values | {"t_s": t_s}))


def frame(t_s: float, **changes: Any) -> FrameQuality:
    """Return the quality of a good frame, new with each time."""
    values: dict[str, Any] = {"fingerprint": round(t_s * 1e4), "brightness": 0.4, "contrast": 0.1, "valid_share": 0.8}
    return FrameQuality(t_s=t_s, **{**values, **changes})


@dataclass(kw_only=True)
class Place:
    """Pose of a chair at a flight; x and z of mid-track in W."""

    heading_rad: float = 0.0
    pitch_rad: float = 0.0
    x_m: float = 0.0
    z_m: float = 0.0
    first_m: float = 0.0
    """Place of the first nosing."""

    def nosing_B(self, k: int) -> list[float]:
        """Return where the chair's middle plane meets nosing k."""
        c, s = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        along = (self.first_m + k * RUN_M - self.x_m) / math.cos(self.heading_rad)
        up = (k + 1) * RISE_M - self.z_m
        return [along * c + up * s, 0.0, up * c - along * s]


@dataclass(kw_only=True)
class World(Place):
    """A chair without dynamics at a flight, its planner, and a camera; a subclass moves the chair and frames the view."""

    DIRECTION: ClassVar[Literal["up", "down"]]

    planner: Any
    steps: int = 8
    knows: bool = True
    """Whether the filter has a heading."""
    flipper_rad: float = 0.7
    flipper_moves: bool = True
    tip_n_m: float = 0.0
    """Torque that the flipper's motor reports."""
    brake_on: bool = False
    spoil: Callable[[StairMap], StairMap | None] = lambda seen: seen
    """What the camera makes of a map."""

    def __post_init__(self) -> None:
        self.t_s = self.turned = self.belts_m_s = self.speeds_up_m_s2 = 0.0
        self.maps = 0
        self.plans: list[MotionPlan] = []

    def move(self, plan: MotionPlan) -> None:
        """Do what the last plan says: pose, belt speed, flipper."""
        raise NotImplementedError

    def in_view(self, x_m: float) -> bool:
        """Return whether the camera sees a nosing at this distance ahead of mid-track."""
        raise NotImplementedError

    def ends(self, nosings: list[tuple[int, list[float]]]) -> bool:
        """Return whether the end of the flight is in view."""
        raise NotImplementedError

    def run(self, *until: str, limit_s: float = 60.0) -> MotionPlan:
        """Tick until a phase has begun, or for the time given."""
        end_s = self.t_s + limit_s
        while self.t_s < end_s:
            plan = self.tick()
            if plan.phase in until:
                return plan
        assert not until, f"still in {plan.phase}: {plan.cause}"
        return plan

    def until_held(self, limit_s: float = 60.0) -> str:
        """Tick until the plan asks for a hold, and return its cause."""
        end_s = self.t_s + limit_s
        while (cause := self.tick().hold) is None:
            assert self.t_s < end_s, f"not held, {self.plans[-1].phase}: {self.plans[-1].cause}"
        return cause

    def flipper_rate(self, angle_rad: float, torque_n_m: float = 0.0) -> float:
        """Return the rate that the planner asks of a flipper, now and square to the stair."""
        self.planner.update(flipper(self.t_s, angle_rad, torque_n_m))
        asked = self.planner.step(self.t_s, estimate(self.t_s)).flipper
        return float(asked.rate_rad_s)

    def tick(self) -> MotionPlan:
        self.move(self.plans[-1] if self.plans else MotionPlan(t_s=0.0, phase="search", speed_m_s=0.0))
        for signal in self.senses():
            self.planner.update(signal)
        plan: MotionPlan = self.planner.step(self.t_s, estimate(self.t_s, self.heading_rad) if self.knows else None)
        self.plans.append(plan)
        self.t_s += TICK_S
        return plan

    def senses(self) -> list[Any]:
        signals: list[Any] = [
            belts(self.t_s, self.belts_m_s, self.belts_m_s, brake_on=self.brake_on),
            flipper(self.t_s, self.flipper_rad, self.tip_n_m),
            imu(self.t_s, self.pitch_rad, rates_rad_s=(0.0, 0.0, self.turned), speeds_up_m_s2=self.speeds_up_m_s2),
        ]
        if round(self.t_s / TICK_S) % 10 == 0:
            self.maps += 1
            seen = self.spoil(self.camera())
            signals += [] if seen is None or len(seen.nosings_B) < min(2, self.steps) else [seen]
        return signals

    def camera(self) -> StairMap:
        """Return the map of the nosings in view, the nearest first."""
        order = range(self.steps) if self.DIRECTION == "up" else reversed(range(self.steps))
        nosings = [(k, place) for k in order if self.in_view((place := self.nosing_B(k))[0])]
        return stair(
            self.t_s,
            [place for _, place in nosings],
            direction=self.DIRECTION,
            ends=bool(nosings) and self.ends(nosings),
            left_seen_m=1.0,
            right_seen_m=1.0,
        )

    def turn(self, half_difference_m_s: float) -> None:
        """Turn the chair by the belts: a slip ratio that makes it turn at 1/1.6 of the belts' kinematic rate."""
        self.turned = 2.0 * half_difference_m_s / CHAIR.tracks.gauge_m / 1.6
        self.heading_rad += self.turned * TICK_S

    @property
    def phases(self) -> list[str]:
        return [plan.phase for k, plan in enumerate(self.plans) if k == 0 or plan.phase != self.plans[k - 1].phase]


def steeper(seen: StairMap) -> StairMap:
    """Return the map of a flight with rise 0.20 m and run 0.27 m in the place of another one, for a chair on the level."""
    nosings = np.array(seen.nosings_B)
    nosings[:, 0] = nosings[0, 0] + (nosings[:, 0] - nosings[0, 0]) * 0.27 / RUN_M
    nosings[:, 2] *= 0.20 / RISE_M
    return replace(seen, nosings_B=nosings, rise_m=0.20, run_m=0.27, slope_rad=math.atan2(0.20, 0.27))
