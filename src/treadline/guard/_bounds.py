"""Physical bounds of what a message says, from the chair file and the sensors: ``reading, message -> fault``.

A value that is no number, or that no chair and no sensor can have, is an error of the sender: the message is rejected.
"""

import math
from collections.abc import Callable
from typing import Any, get_args

from treadline.core.angles import DEG
from treadline.core.signals import (
    ROUNDING_S,
    FlipperCommand,
    FlipperReading,
    FrameQuality,
    FreeGround,
    HeadingEstimate,
    HeadingHealth,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    Phase,
    PlantState,
    SeatCommand,
    SeatReading,
    StairMap,
    TrackCommand,
    TrackReading,
)
from treadline.guard._guard_config import GuardConfig

NORM_SPARE = 0.01
"""Largest error of an attitude quaternion's norm; the error of the attitude is then at most 2 %. 14-bit quaternions have 1e-4."""
GYRO_RAD_S = 2000.0 * DEG
"""Largest angular rate that the gyro can measure [rad/s]: full scale of the MPU-6050 and the BNO055, data sheets."""

SEEN_M = 65.535
"""Largest distance that a depth image of 16-bit millimetres can hold [m]: no camera measures a place beyond."""

MOST_NOSINGS = 100
"""Largest number of nosings in a map, and of ends of a landing's sides: more than a camera sees. Each costs time in a tick."""


def finite(*values: float) -> bool:
    """Return whether every value is finite."""
    return all(map(math.isfinite, values))


def fault_of(message: object, limits: GuardConfig) -> str:
    """Return why the content of a message is not physical; empty if it is, and for messages of other types."""
    check = CHECKS.get(type(message))
    return "" if check is None else check(message, limits)


def _number_fault(*values: float) -> str:
    return "" if finite(*values) else "holds a value that is no number"


def _angle_fault(name: str, angle_rad: float) -> str:
    return "" if abs(angle_rad) <= math.pi else f"has a {name} of {angle_rad / DEG:g}°"


def _size_fault(text: str, limit: float, *values: float) -> str:
    """Return the text with the first value beyond a limit, or that is no number; empty if there is none."""
    return next((text.format(value) for value in values if not abs(value) <= limit), "")


def _imu_fault(sample: ImuSample, _: GuardConfig) -> str:
    norm = math.hypot(*sample.orientation)
    if not abs(norm - 1.0) <= NORM_SPARE:
        return f"has a quaternion of norm {norm:.2g}"
    if not all(abs(rate) <= GYRO_RAD_S for rate in sample.angular_velocity_rad_s):
        return f"has a rate of {max(sample.angular_velocity_rad_s, key=abs) / DEG:g} °/s"
    return _number_fault(*sample.linear_acceleration_m_s2)


def _heading_fault(measurement: HeadingMeasurement, _: GuardConfig) -> str:
    if not 0.0 < measurement.sigma_rad < math.inf:
        return f"has a standard deviation of {measurement.sigma_rad:g}"
    return _angle_fault("heading", measurement.heading_rad) or _angle_fault("correction", measurement.correction_rad)


def _frame_fault(quality: FrameQuality, _: GuardConfig) -> str:
    shares = (quality.brightness, quality.contrast, quality.valid_share)
    sound = all(0.0 <= share <= 1.0 for share in shares) and (quality.obstacle_m is None or finite(quality.obstacle_m))
    return "" if sound else "is no image"


def _map_fault(stair: StairMap, _: GuardConfig) -> str:
    if len(stair.nosings_B) > MOST_NOSINGS:
        return f"holds {len(stair.nosings_B)} nosings"
    if stair.direction not in ("up", "down"):
        return f"leads {stair.direction!r}, neither up nor down"
    sides = (stair.left_wall_m, stair.right_wall_m, stair.left_edge_m, stair.right_edge_m, stair.left_seen_m, stair.right_seen_m)
    places = [value for place in stair.nosings_B for value in place]
    distances_m = [stair.rise_m, stair.run_m, *places, *(value for value in (stair.obstacle_m, *sides) if value is not None)]
    turn = _angle_fault("turn", stair.turn_rad or 0.0)
    return turn or _number_fault(stair.slope_rad) or _size_fault("holds a distance that no camera measures", SEEN_M, *distances_m)


def _ground_fault(ground: FreeGround, _: GuardConfig) -> str:
    end_m, sigma_m = ground.seen_m if ground.end_m is None else ground.end_m, ground.end_sigma_m or 0.0
    if not (0.0 <= ground.blind_m <= end_m <= ground.seen_m < math.inf and 0.0 <= sigma_m < math.inf):
        return f"shows ground from {ground.blind_m:g} to {ground.seen_m:g} m that ends at {end_m:g} ± {sigma_m:g} m"
    if not 0.0 <= (ground.drop_m or 0.0) < math.inf:
        return f"shows a drop of {ground.drop_m:g} m"
    if len(ground.sides_B) % 2 or len(ground.sides_B) > MOST_NOSINGS:
        return f"holds {len(ground.sides_B)} ends of sides"
    far = _size_fault("holds a side {:g} m away", SEEN_M, *(value for end in ground.sides_B for value in end))
    direction = _angle_fault("direction", ground.direction_rad or 0.0)
    return far or direction or _number_fault(ground.direction_sigma_rad or 0.0)


def _plan_fault(plan: MotionPlan, limits: GuardConfig) -> str:
    if plan.phase not in get_args(Phase):
        return f"has an unknown phase {plan.phase!r}"
    speeds = (plan.speed_m_s, plan.turn_m_s or 0.0, plan.pitch_feedforward_m_s)
    fault = _size_fault("has a speed of {:g} m/s", limits.belt_limit_m_s, *speeds)
    rate_rad_s = 0.0 if plan.flipper is None else plan.flipper.rate_rad_s
    return fault or _angle_fault("heading", plan.heading_rad) or _number_fault(plan.min_inner_speed_ratio or 0.0, rate_rad_s)


def _limit_fault(limit: float, *values: float) -> str:
    return _size_fault(f"asks for {{:g}}, beyond the chair's limit of {limit:g}", limit * (1.0 + ROUNDING_S), *values)


CHECKS: dict[type, Callable[[Any, GuardConfig], str]] = {
    ImuSample: _imu_fault,
    TrackReading: lambda reading, limits: _size_fault(
        "has a belt speed of {:g} m/s", 2.0 * limits.belt_limit_m_s, reading.left_m_s, reading.right_m_s
    ),
    SeatReading: lambda reading, _: _angle_fault("pitch", reading.pitch_rad) or _number_fault(reading.stroke_m),
    FlipperReading: lambda reading, _: _angle_fault("angle", reading.angle_rad) or _number_fault(reading.torque_n_m),
    HeadingMeasurement: _heading_fault,
    HeadingEstimate: lambda estimate, _: _number_fault(estimate.heading_rad, estimate.heading_rate_rad_s),
    HeadingHealth: lambda health, _: _number_fault(health.since_s or 0.0),
    PlantState: lambda state, _: _number_fault(state.battery_v or 0.0),
    FrameQuality: _frame_fault,
    StairMap: _map_fault,
    FreeGround: _ground_fault,
    MotionPlan: _plan_fault,
    TrackCommand: lambda command, limits: _limit_fault(limits.belt_limit_m_s, command.left_m_s, command.right_m_s),
    SeatCommand: lambda command, limits: _limit_fault(limits.seat_rate_m_s or 0.0, command.rate_m_s),
    FlipperCommand: lambda command, limits: _limit_fault(limits.flipper_rate_rad_s or 0.0, command.rate_rad_s),
}
"""Check of each type of message; images are judged by their quality."""
