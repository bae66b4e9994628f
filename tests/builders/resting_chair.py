"""A chair that rests on the ground at every instant, its belts and flipper, and the faults of both.

The ground is a polyline of nosings given as literals; the rest poses are those of ``treadline.vehicle.rest_poses``, which
``tests/vehicle`` compares with the simulator of motion. Nothing here plans.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from chairs import CHAIR

from treadline.core.angles import DEG
from treadline.core.signals import FlipperReading
from treadline.vehicle.rest_poses import RestPose, fall_to, rest_chair

HALF_M, FLIPPER_M, FLIPPER_N = 0.475, 0.45, 3.0 * 9.81
"""Half of the flat run, length of the flipper [m] and its weight [N], of the shipped wheelchair."""
STOWED_RAD, RANGE_RAD, MOST_N_M = 40.0 * DEG, (-75.0 * DEG, 60.0 * DEG), 200.0
"""Stowed angle, range and motor torque of its flipper."""
DROPS_RAD_S, YIELDS_RAD_S, YIELD_RAD = 90.0 * DEG, 30.0 * DEG, 0.1 * DEG
"""Rate at which a flipper without torque drops; rate and step with which an overloaded one yields, pushing with all that it has."""
JUMP_RAD, OVER_S = 1.0 * DEG, 0.1
"""Turn within a step that is a fall, and time over which a pitch rate counts [s]."""

Nosing = tuple[float, float]
"""Place and height of a nosing above the floor before the flight [m]."""


def flight(*steps_m: tuple[float, float], first_m: float = 0.0) -> list[Nosing]:
    """Return the nosings of a flight of steps (rise, run), the first at a place; the run of a step lies behind its nosing."""
    rises, runs = zip(*steps_m, strict=True)
    places = first_m + np.concatenate([[0.0], np.cumsum(runs)[:-1]])
    return list(zip(places.tolist(), np.cumsum(rises).tolist(), strict=True))


def ground_of(nosings: Sequence[Nosing], landing_m: float = 4.0) -> np.ndarray:
    """Return the vertices of the ground under nosings rounded by 1 cm; behind so much of landing it drops by 3 m."""
    first_m, last_m, top_m = nosings[0][0], nosings[-1][0], nosings[-1][1]
    floors = [0.0, *(height for _, height in nosings[:-1])]
    steps = [v for floor, (x, z) in zip(floors, nosings, strict=True) for v in ((x, floor, 0.0), (x, z, 0.01))]
    end_m = last_m + landing_m
    beyond = [(end_m, top_m, 0.0), (end_m + 0.001, top_m - 3.0, 0.0), (end_m + 9.0, top_m - 3.0, 0.0)]
    return np.array([(first_m - 9.0, 0.0, 0.0), *steps, *beyond])


@dataclass(kw_only=True)
class RestingChair:
    """A chair on its ground, and what its belts and flipper do with their commands."""

    ground: np.ndarray
    x_m: float
    payload_kg: float = 50.0
    angle_rad: float = STOWED_RAD
    pitch_rad: float = 0.0
    flipper_moves: bool = True
    """Whether the flipper turns; one that does not carries any load."""
    most_n_m: float = MOST_N_M
    """Torque of the flipper's motor; without any the flipper drops."""
    pose: RestPose = field(init=False)

    def __post_init__(self) -> None:
        self.chair = rest_chair(CHAIR, self.payload_kg)
        self.pose = self.chair.at(self.ground, self.x_m, (self.angle_rad,), self.pitch_rad)
        self.is_stalled = False
        """Whether the flipper's motor pushes with all that it has."""
        self.fastest_rad_s = 0.0
        """Largest pitch rate over 0.1 s, for rest poses count a jump of half a degree as motion; of a fall, the rate at its end."""
        self._pitch_rad: list[float] = []

    def move(self, along_m: float, flipper_rad_s: float, dt_s: float) -> None:
        """Move by a distance along the belts, and turn the flipper."""
        before, angle = self.pose, self.pose.angles_rad[0]
        if self.most_n_m == 0.0:
            flipper_rad_s = -DROPS_RAD_S if before.torques_n_m[0] <= 0.0 else 0.0
        if self.flipper_moves:
            angle = min(max(angle + flipper_rad_s * dt_s, RANGE_RAD[0]), RANGE_RAD[1])
        pose, fall = self.chair.moved(self.ground, before, before.x_m + along_m * math.cos(before.pitch_rad), (angle,))
        pose, second = self._pivoted(before, pose, along_m)
        self.is_stalled = self.flipper_moves and pose.torques_n_m[0] > self.most_n_m
        yields_rad = YIELDS_RAD_S * dt_s if self.most_n_m else math.inf
        highest_rad = min(pose.angles_rad[0] + yields_rad, RANGE_RAD[1])
        while self.is_stalled and pose.torques_n_m[0] > self.most_n_m and pose.angles_rad[0] < highest_rad:
            pose, _ = self.chair.moved(self.ground, pose, pose.x_m, (pose.angles_rad[0] + YIELD_RAD,))
        self.pose = pose
        self.x_m, self.pitch_rad, self.angle_rad = pose.x_m, pose.pitch_rad, pose.angles_rad[0]
        falls = [fall.rate_rad_s for fall in (fall, second) if fall is not None]
        if not falls and abs(pose.pitch_rad - before.pitch_rad) > JUMP_RAD:  # a pose that vanishes as it is described
            sunk_m = before.com_m[1] + along_m * math.sin(before.pitch_rad) - pose.com_m[1]
            falls = [fall_to(pose, JUMP_RAD, max(sunk_m, 0.0)).rate_rad_s]
        self._pitch_rad = [pose.pitch_rad] if falls else [*self._pitch_rad, pose.pitch_rad][-1 - round(OVER_S / dt_s) :]
        turned = abs(self._pitch_rad[-1] - self._pitch_rad[0])
        self.fastest_rad_s = max(self.fastest_rad_s, turned / OVER_S, *falls)

    def _pivoted(self, before: RestPose, after: RestPose, along_m: float):  # noqa: ANN202
        """Return the pose with the belts where they were on the contact that bears: a chair that turns moves over it."""
        (px, pz), turned = before.pivot_m, after.pitch_rad - before.pitch_rad
        slope = before.slopes[0] if before.front_share > 0.5 else before.slopes[1]
        ahead, above = before.x_m - px, before.height_m - pz
        x_m = px + along_m / math.hypot(1.0, slope) + ahead * math.cos(turned) - above * math.sin(turned)
        return self.chair.moved(self.ground, after, x_m, after.angles_rad)

    def reading(self, t_s: float) -> FlipperReading:
        """Return what the flipper's motor reads: it raises its weight, less what the ground turns up."""
        level_m = 0.5 * FLIPPER_M * math.cos(self.pitch_rad + self.angle_rad)
        borne_n_m = self.most_n_m if self.is_stalled else self.pose.torques_n_m[0]
        torque = FLIPPER_N * level_m - borne_n_m if self.most_n_m else 0.0
        return FlipperReading(t_s=t_s, angle_rad=self.angle_rad, torque_n_m=torque)
