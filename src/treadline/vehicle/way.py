"""Way: how belts and flipper take a chair over any ground, with the least fall under what is not known, then in the least time.

``RestChair, grounds, start -> PlannedWay``. A shortest path over place, flipper angle and branch of the rest pose, both
directions alike: there is no case for kerb, foot, crest, edge, or a low step. Each move follows the rest pose in small parts, so
that a pose that vanishes on the way is a fall, priced by the speed with which it ends. The prices are seconds of the drive.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.scenario.chair import GRAVITY_M_S2
from treadline.vehicle.rest_poses import Ground, RestChair, RestPose, nosings_of
from treadline.vehicle.way_kernels import search

PLACE_M, ANGLE_RAD = 0.025, 2.5 * DEG
"""Grid of the search: place [m] and flipper angle [rad]. Half of either changes pitch and fall less than the plant differs
(``tests/vehicle/test_way.py``)."""
SPEED_M_S, FLIPPER_RAD_S, PITCH_RAD_S = 0.1, 16.0 * DEG, 9.0 * DEG
"""Belt speed [m/s], flipper rate and pitch rate [rad/s] with which a move is timed: those of the planner near an edge."""
ERROR_M = 0.05
"""Error of the centre of mass along the chair against which a pose is judged [m]: a passenger who leans."""
QUIET_M_S = 0.02
"""Speed with which a fall may end without a jolt [m/s]: of a tenth of a millimetre."""
PRICES = (400.0, 400.0, QUIET_M_S, 3000.0, 2.0, 6.0, 1.0)
"""Prices [s], see ``way_kernels.search``. A passenger of 4 m/s² stops a fall from 1 mm: it costs more than any detour. Pitch above
the steepest line, load on the tip, and motion have small prices, so that of equal ways the one with less of them is taken."""
TORQUE_SHARES = (0.7, 0.95)
"""Shares of the flipper's torque that a way may use: the second where none with the first keeps ``KEEPS_RAD``."""
KEEPS_RAD = 5.0 * DEG
"""Margin that a way keeps if it can [rad]: ``ERROR_M`` at a height of 0.57 m."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedWay:
    """Sequence of rest poses from the start to the end of a ground."""

    poses: tuple[RestPose, ...] = field(repr=False)
    drops_m: Float[np.ndarray, " n"] = field(repr=False)
    """Drop of the fall on the move to each pose [m]; 0 where the pose was followed."""
    unknown_m: Float[np.ndarray, " n"] = field(repr=False)
    """Drop that an error of the centre of mass by ``ERROR_M`` would cause at each pose [m]."""
    cost_s: float
    """Cost of the search."""

    @property
    def margin_rad(self) -> float:
        """Least margin to tipping over front or rear [rad]."""
        return min(min(pose.front_margin_rad, pose.rear_margin_rad) for pose in self.poses)

    @property
    def torque_n_m(self) -> float:
        """Largest torque of the flipper's motor [N m]."""
        return max(max(pose.torques_n_m) for pose in self.poses)

    @property
    def fall_m_s(self) -> float:
        """Speed with which the centre of mass ends its largest fall [m/s]."""
        return math.sqrt(2.0 * GRAVITY_M_S2 * float(self.drops_m.max()))


def find_way(
    chair: RestChair,
    grounds: Sequence[Ground],
    start: RestPose,
    end_m: float,
    range_rad: tuple[float, float],
    *,
    friction: float = math.inf,
    place_m: float = PLACE_M,
    angle_rad: float = ANGLE_RAD,
) -> PlannedWay | None:
    """Return the cheapest way that holds on all grounds, or None.

    Args:
        grounds: Grounds that may be the true one, the likely one first, with as many vertices each.
        start: Pose at the start on the first of them.
        end_m: Place of mid-track at the end.
        range_rad: Range of the flipper.
        friction: Friction that the belts find.
        place_m: Step of the place.
        angle_rad: Step of the flipper's angle.

    Raises:
        MechanicsError: If a ground holds a value that is not a number, or the chair cannot stand on a pose of the way.
    """
    if not all(np.isfinite(ground).all() for ground in grounds):
        raise MechanicsError("a place, height or radius of the ground is not a number; give metres")
    found = None
    for share in TORQUE_SHARES:
        way = _way(chair, grounds, start, end_m, range_rad, share, friction, place_m, angle_rad)
        if way is not None and (found is None or way.margin_rad > found.margin_rad):
            found = way
        if found is not None and found.margin_rad >= KEEPS_RAD:
            return found
    return found


def _way(
    chair: RestChair,
    grounds: Sequence[Ground],
    start: RestPose,
    end_m: float,
    range_rad: tuple[float, float],
    share: float,
    friction: float,
    place_m: float,
    angle_rad: float,
) -> PlannedWay | None:
    """Return the cheapest way with a share of the flipper's torque, or None."""
    places = _places(start.x_m, end_m, grounds[0], place_m)
    # The grid holds the angle at the start.
    low, high = ((bound - start.angles_rad[0]) / angle_rad for bound in range_rad)
    steps = np.arange(math.ceil(low - 1e-9), high + 1e-9)
    angles = start.angles_rad[0] + angle_rad * steps
    torque = share * chair.torques_n_m[0] if range_rad[0] < range_rad[1] else math.inf
    rises = np.diff(nosings_of(grounds[0]), axis=0)
    # A single nosing has no line to the next one: no pitch is above it.
    steepest_rad = np.arctan2(rises[:, 1], rises[:, 0]).max() if rises.size else 0.5 * math.pi
    limits = np.array([torque, friction, ERROR_M, steepest_rad])
    rows, cost = search(
        np.stack(grounds),
        chair.parts,
        chair.masses,
        chair.torques_n_m,
        places,
        angles,
        np.array([0.0, float(np.argmin(np.abs(steps))), start.pitch_rad]),
        limits,
        np.array([SPEED_M_S, FLIPPER_RAD_S, PITCH_RAD_S]),
        np.array(PRICES),
    )
    if not cost.size:
        return None
    poses = tuple(chair.at(grounds[0], float(x), (float(angle),), float(pitch)) for x, angle, pitch in rows[:, :3])
    return PlannedWay(poses=poses, drops_m=rows[:, 3], unknown_m=rows[:, 4], cost_s=float(cost[0]))


def _places(start_m: float, end_m: float, ground: Ground, step_m: float) -> Float[np.ndarray, " n"]:
    """Return the grid of places from start to end, laid from the uppermost nosing so that it does not depend on the start."""
    sign, nosings = math.copysign(1.0, end_m - start_m), nosings_of(ground)
    anchor_m = float(nosings[-1, 0]) if nosings.size else start_m
    first, last = ((place - anchor_m) / (sign * step_m) for place in (start_m, end_m))
    between = anchor_m + sign * step_m * np.arange(math.floor(first + 1e-6) + 1, math.ceil(last - 1e-6))
    return np.array([start_m, *between, end_m])
