"""Observations of a policy: named numbers in SI units, from ground truth or from the chair's own estimates."""

import math

import numpy as np
from jaxtyping import Float

from treadline.core.angles import tilt_of
from treadline.core.ports import Reading, Truth
from treadline.core.signals import (
    FlipperReading,
    HeadingEstimate,
    HeadingMeasurement,
    ImuSample,
    SeatReading,
    StairMap,
    TrackReading,
)
from treadline.estimation import HeadingFilter
from treadline.estimation.known_nosings import KnownNosings
from treadline.estimation.stair_tracker import StairTracker
from treadline.plant.mujoco import ChairState

AHEAD_M = np.linspace(-0.3, 1.4, 12)
"""Distances from mid-track in the direction of travel at which the ground's height is observed [m]: from the middle of the belts
to four steps ahead."""
OBSERVATION = {
    "pitch_rad": math.pi,
    "roll_rad": math.pi,
    "heading_rad": math.pi,
    "pitch_rate_rad_s": 20.0,
    "heading_rate_rad_s": 20.0,
    "left_m_s": 2.0,
    "right_m_s": 2.0,
    "flipper_rad": math.pi,
    "flipper_torque_n_m": 1000.0,
    "seat_pitch_rad": math.pi,
    "direction": 1.0,
    **{f"height_{number}_m": 10.0 for number in range(len(AHEAD_M))},
}
"""Names of the numbers of an observation, and the magnitude to which each is limited.

Signs are those of ``core.signals``; ``direction`` is 1 up and -1 down; heights are those of the ground at ``AHEAD_M`` above
mid-track. What a vehicle lacks is 0."""
LIMITS = np.array(list(OBSERVATION.values()))


class Oracle:
    """Observer of the ground truth.

    Args:
        ground: Place and height of the vertices of the ground [m], see ``ground_profile``.
        sign: 1 up, -1 down.
    """

    def __init__(self, ground: Float[np.ndarray, "n 3"], sign: float) -> None:
        self._x_m, self._z_m, self._sign = ground[:, 0].copy(), ground[:, 1].copy(), sign

    def update(self, reading: Reading) -> None:
        """Ignore a reading."""

    def observe(self, state: ChairState, truth: Truth) -> Float[np.ndarray, " n"]:
        """Return the observation at an instant."""
        x_m = truth.chassis_x_m + (self._sign * math.cos(truth.yaw_rad)) * AHEAD_M
        seat_rad = 0.0 if math.isnan(truth.seat_pitch_rad) else truth.seat_pitch_rad
        attitude = truth.pitch_rad, truth.roll_rad, truth.heading_rad, truth.pitch_rate_rad_s, truth.heading_rate_rad_s
        body = truth.left_m_s, truth.right_m_s, state.flipper_rad, state.flipper_torque_n_m, seat_rad, self._sign
        return np.concatenate([attitude, body, np.interp(x_m, self._x_m, self._z_m) - truth.chassis_z_m])


class Tracker:
    """Observer of what the chair knows: heading filter and stair tracker of the mission, and its other sensors.

    Heading and heights are 0 before the first stair map.

    Args:
        sign: 1 up, -1 down.
        half_m: Half of the belts' flat run.
    """

    def __init__(self, sign: float, half_m: float) -> None:
        self._sign, self._half_m = sign, half_m
        self._filter, self._stair = HeadingFilter(), StairTracker()
        self._estimate: HeadingEstimate | None = None
        self._numbers = dict.fromkeys(list(OBSERVATION)[: -len(AHEAD_M)], 0.0) | {"direction": sign}

    def update(self, reading: Reading) -> None:
        """Take a reading of the chair's sensors."""
        match reading:
            case ImuSample():
                pitch, roll = tilt_of(reading.orientation)
                self._numbers |= {"pitch_rad": pitch, "roll_rad": roll, "pitch_rate_rad_s": -reading.angular_velocity_rad_s[1]}
            case TrackReading():
                self._numbers |= {"left_m_s": reading.left_m_s, "right_m_s": reading.right_m_s}
            case FlipperReading():
                self._numbers |= {"flipper_rad": reading.angle_rad, "flipper_torque_n_m": reading.torque_n_m}
            case SeatReading():
                self._numbers["seat_pitch_rad"] = reading.pitch_rad
        if isinstance(reading, ImuSample | TrackReading | HeadingMeasurement):
            self._estimate = self._filter.step(reading)
        if self._estimate is not None:
            self._stair.heading_rad = self._numbers["heading_rad"] = self._estimate.heading_rad
            self._numbers["heading_rate_rad_s"] = self._estimate.heading_rate_rad_s
        if isinstance(reading, ImuSample | TrackReading) or (isinstance(reading, StairMap) and self._estimate is not None):
            self._stair.update(reading)

    def observe(self, state: ChairState, truth: Truth) -> Float[np.ndarray, " n"]:
        """Return the observation at an instant; state and ground truth are ignored."""
        del state, truth
        known = self._stair.around(self._half_m)
        heights_m = np.zeros(len(AHEAD_M)) if known is None else _heights_m(known, self._sign * AHEAD_M)
        return np.concatenate([list(self._numbers.values()), heights_m])


def _heights_m(known: KnownNosings, places_m: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the heights of the treads behind known nosings, of the floor before the first, above mid-track."""
    c, s = math.cos(known.pitch_rad), math.sin(known.pitch_rad)
    x_m, z_m = np.array(sorted((c * at.ahead_m - s * at.above_m, s * at.ahead_m + c * at.above_m) for at in known.nosings)).T
    behind = np.searchsorted(x_m, places_m)
    return np.where(behind > 0, z_m[behind - 1], z_m[0] - known.rise_m)
