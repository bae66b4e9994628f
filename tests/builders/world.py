"""Signals with defaults, for tests of loop, planners and guard, and the nosings of a straight flight as a chair sees them.

Nothing here is computed by the code under test, except rotations.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

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
    StairMap,
    TrackCommand,
    TrackReading,
)
from treadline.guard import GuardConfig
from treadline.guard._belt_travel import BeltTravel
from treadline.guard._frame_monitor import FrameMonitor
from treadline.guard._known import Known
from treadline.mission.mission_config import MissionConfig
from treadline.scenario.chair import read_chair

TICK_S, G_M_S2 = 0.01, 9.81
RISE_M, RUN_M = 0.16, 0.30
SLOPE_RAD, PITCH_M = math.atan2(RISE_M, RUN_M), math.hypot(RISE_M, RUN_M)
CHAIR = read_chair("wheelchair")
CONFIG = MissionConfig(chair=CHAIR, payload_kg=50.0, climb_speed_m_s=0.2)


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
        "track_on_stair_m": 1.4,
        "level_turn_share": 0.789,
        "normal_slip": 0.3,
        "driver_timeout_s": 0.75,
        "has_planner": False,
    }
    return GuardConfig(**{**values, **changes})


def known(config: GuardConfig, *, speed_m_s: float = 0.0, travel_m: float = 0.0, **values: Any) -> Known:
    """Return what a guard knows at a tick, of a chair that is asked for a speed after a way."""
    travel = BeltTravel(config.silence_s)
    travel.travel_m = travel_m
    asked: dict[str, Any] = {"passed": TrackCommand(t_s=0.0, left_m_s=speed_m_s, right_m_s=speed_m_s)}
    clock = dict.fromkeys(("t_s", "passed_s", "commanded_s"), 0.0)
    return Known(frames=FrameMonitor(config), travel=travel, report=lambda *_: None, **asked | clock | values)


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
        return self.in_B(self.first_m + k * RUN_M, (k + 1) * RISE_M)

    def in_B(self, x_m: float, z_m: float) -> list[float]:
        """Return where the chair's middle plane meets a nosing at a place and height."""
        c, s = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        along, up = (x_m - self.x_m) / math.cos(self.heading_rad), z_m - self.z_m
        return [along * c + up * s, 0.0, up * c - along * s]
