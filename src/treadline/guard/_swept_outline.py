"""Monitor of the outline that a turn on a landing sweeps: ``FreeGround, ImuSample, plan -> cause``.

Places are in a level frame that begins with the turn, by gyro and belts. Belts that turn on the spot skid about a centre ahead of
mid-track. A side, an edge or a wall, is remembered at its newest sighting until the turn ends.
"""

import math
from typing import Any

from treadline.core.angles import DEG, wrap
from treadline.core.signals import FreeGround, ImuSample, Recent
from treadline.guard._guard_config import GuardConfig
from treadline.guard._known import Known, Monitor

Place = tuple[float, float]
Pose = tuple[float, float, float]
SAME_RAD, SAME_M = 10.0 * DEG, 0.10
"""Angle and distance within which two sightings are of one side: four deviations of its ends, 2 cm over 0.5 m [rad, m]."""


class SweptOutline(Monitor):
    """On a landing on which the chair turns, its outline comes too near to an edge or a wall seen in the turn, or none is in view.

    Time: 5 cm before, by the newest sighting of each side, at once; without a side or ground in view 3 s.
    Not covered: sides that were never in view, and slip that is not that of the assumed load.
    """

    rows, hears, needs, declared = "29", (ImuSample, FreeGround), ("turn_outline_m",), "awaits_ground"

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._imu_s, self._travel_m = math.inf, 0.0
        self._begin()

    def _begin(self) -> None:
        self._pose: Pose = (0.0, 0.0, 0.0)
        self._past: Recent[Pose] = Recent()
        self._sides: list[tuple[Place, Place]] = []
        self._seen_s: float | None = None
        """Time of the latest frame with a side or ground in view, or at which the turn began."""

    def hear(self, message: Any, known: Known) -> None:
        """Update with an IMU sample, or with the sides in view of one frame."""
        is_turning = known.followed is not None and known.followed.phase == "turn"
        match message:
            case ImuSample():
                dt_s, self._imu_s = max(message.t_s - self._imu_s, 0.0), message.t_s
                along_m, self._travel_m = known.travel.travel_m - self._travel_m, known.travel.travel_m
                if is_turning:
                    self._move(message.t_s, along_m, message.angular_velocity_rad_s[2] * dt_s)
                elif self._seen_s is not None:
                    self._begin()
            case FreeGround() if is_turning and (exposed := self._past.at(message.t_s)) is not None:
                ends = [_placed((x, y), exposed) for x, y, _ in message.sides_B]
                self._seen_s = message.t_s if ends or message.seen_m > message.blind_m else self._seen_s
                for side in zip(ends[::2], ends[1::2], strict=True):
                    self._sides = [*(kept for kept in self._sides if not _is_same(kept, side)), side]

    def _move(self, t_s: float, along_m: float, turned_rad: float) -> None:
        """Move by the belts and the gyro."""
        x, y, heading = self._pose
        aside_m = -self._config.turn_centre_m * turned_rad
        x, y = _placed((along_m, aside_m), self._pose)
        self._pose = (x, y, heading + turned_rad)
        self._past.add(t_s, self._pose)

    def cause(self, known: Known) -> str | None:
        """Return which side the outline of a chair that moves is too near to; None if it keeps its distance."""
        outline, plan = self._config.turn_outline_m, known.followed
        if not outline or plan is None or plan.phase != "turn" or known.passed.brake:
            return None
        self._seen_s = known.t_s if self._seen_s is None else self._seen_s
        if known.t_s - self._seen_s > self._config.blind_timeout_s:
            return f"neither ground nor a side of the landing in view for {known.t_s - self._seen_s:.1f} s of a turn"
        rear_m, front_m, half_m = (length_m + self._config.turn_clear_m for length_m in outline)
        for side in self._sides:
            ends = (_seen_from(side[0], self._pose), _seen_from(side[1], self._pose))
            low, high = clipped(ends, (-rear_m, front_m), (-half_m, half_m))
            if low < high:
                return f"an edge or a wall comes within {self._config.turn_clear_m:.2f} m of the chair that turns"
        return None


def _placed(place_B: Place, pose: Pose) -> Place:
    """Return a place in the chair's frame in that of the turn."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return pose[0] + c * place_B[0] - s * place_B[1], pose[1] + s * place_B[0] + c * place_B[1]


def _seen_from(place: Place, pose: Pose) -> Place:
    """Return a place in the frame of the turn in that of the chair."""
    c, s, x, y = math.cos(pose[2]), math.sin(pose[2]), place[0] - pose[0], place[1] - pose[1]
    return c * x + s * y, c * y - s * x


def _is_same(one: tuple[Place, Place], other: tuple[Place, Place]) -> bool:
    """Return whether two sightings are of one side: parallel and in line."""
    (x, y), (to_x, to_y) = other
    along_rad = math.atan2(to_y - y, to_x - x)
    turned_rad = 0.5 * wrap(2.0 * (math.atan2(one[1][1] - one[0][1], one[1][0] - one[0][0]) - along_rad))
    middle = 0.5 * (one[0][0] + one[1][0]) - x, 0.5 * (one[0][1] + one[1][1]) - y
    return abs(turned_rad) < SAME_RAD and abs(middle[1] * math.cos(along_rad) - middle[0] * math.sin(along_rad)) < SAME_M


def clipped(ends: tuple[Place, Place], *bounds: tuple[float, float]) -> tuple[float, float]:
    """Return the part of a line from end to end within a rectangle, as shares of its length (Liang and Barsky, 1984).

    The first share is less than the second where there is such a part.
    """
    low, high = 0.0, 1.0
    for axis, (least, most) in enumerate(bounds):
        start, along = ends[0][axis], ends[1][axis] - ends[0][axis]
        if abs(along) < 1e-9:
            if not least < start < most:
                return 1.0, 0.0
            continue
        first, last = sorted(((least - start) / along, (most - start) / along))
        low, high = max(low, first), min(high, last)
    return low, high
