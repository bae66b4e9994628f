"""Way: how belts and flipper take a chair over any ground, with the least fall under what is not known, then in the least time.

``RestChair, ground, start -> WayTable -> PlannedWay``. A shortest path over place, flipper angle and branch of the rest pose, both
directions alike: there is no case for kerb, foot, crest, edge, or a low step. Each move follows the rest pose in small parts, so
that a pose that vanishes on the way is a fall, priced by the speed with which it ends. The prices are seconds of the drive.
The table holds the way from every state that can be reached, so that it can be looked up from the state that is measured.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.scenario.chair import GRAVITY_M_S2
from treadline.vehicle.rest_poses import Ground, RestChair, RestPose, nosings_of
from treadline.vehicle.way_kernels import BRANCHES, MOVES, after, cheapest, explore, nearest, relax

PLACE_M, ANGLE_RAD = 0.025, 2.5 * DEG
"""Grid of the search: place [m] and flipper angle [rad]. Half of either changes pitch and fall less than the plant differs
(``tests/vehicle/test_way.py``)."""
SPEED_M_S, FLIPPER_RAD_S, PITCH_RAD_S = 0.1, 16.0 * DEG, 7.0 * DEG
"""Belt speed [m/s], flipper rate and pitch rate [rad/s] with which a move is timed: those of the planner near an edge."""
ERROR_M = 0.135
"""Error of the centre of mass along the chair against which a pose is judged [m]: the limit of the margin with its reserve,
12° at a height of 0.57 m, and 15 mm by which the place is not known."""
QUIET_M_S = 0.02
"""Speed with which a fall may end without a jolt [m/s]: of a tenth of a millimetre."""
PRICES = (400.0, 400.0, QUIET_M_S, 3000.0, 3.0, 6.0, 1.0, 50.0, 100.0)
"""Prices [s], see ``way_kernels.explore``. A passenger of 4 m/s² stops a fall from 1 mm: it costs more than any detour. Pitch above
the steepest line, load on the tip, and motion have small prices, so that of equal ways the one with less of them is taken."""
TORQUE_SHARES = (0.7, 0.95)
"""Share of the flipper's torque that a way uses freely, and at a price at most."""
PORTION, SWEEPS = 40, 4
"""States that are explored, and sweeps over all of them, in a portion: about 2 ms."""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class WayState:
    """State of a table of ways."""

    x_m: float
    """Place of mid-track [m]."""
    angle_rad: float
    """Angle of the flipper [rad]."""
    pitch_rad: float
    torque_n_m: float
    """Torque of the flipper's motor [N m]."""
    to_go_s: float
    """Cost of the way to the end [s]."""


class WayTable:
    """Cheapest moves to the end of a ground from all states that can be reached.

    Args:
        chair: Chair.
        ground: Vertices of the ground that is likely.
        start: Pose at the start, on that ground.
        end_m: Place of mid-track at the end.
        range_rad: Range of the flipper.
        end_rad: Flipper angle wanted at the end; None for any.
        friction: Friction that the belts find at most.
        known_friction: Friction that is known; more has a price.
        place_m: Step of the place.
        angle_rad: Step of the flipper's angle.

    Raises:
        MechanicsError: If the ground holds a value that is not a number.
    """

    def __init__(
        self,
        chair: RestChair,
        ground: Ground,
        start: RestPose,
        end_m: float,
        range_rad: tuple[float, float],
        *,
        end_rad: float | None = None,
        friction: float = math.inf,
        known_friction: float = math.inf,
        place_m: float = PLACE_M,
        angle_rad: float = ANGLE_RAD,
    ) -> None:
        if not np.isfinite(ground).all():
            raise MechanicsError("a place, height or radius of the ground is not a number; give metres")
        self.chair, self.ground, self.end_m = chair, ground, end_m
        self.places_m = _places(start.x_m, end_m, ground, place_m)
        # The grid holds the angle at the start.
        low, high = ((bound - start.angles_rad[0]) / angle_rad for bound in range_rad)
        steps = np.arange(math.ceil(low - 1e-9), high + 1e-9)
        self.angles_rad = start.angles_rad[0] + angle_rad * steps
        size = self.places_m.size * self.angles_rad.size * BRANCHES
        self._pitch, self._state = np.full(size, np.nan), np.zeros((size, 3))
        self._leads, self._cost = np.full((size, len(MOVES)), -1), np.zeros((size, len(MOVES), 2))
        self._order, self._to_go = np.empty(size, dtype=np.int64), np.full(size, np.inf)
        self.start = int(np.argmin(np.abs(steps))) * BRANCHES
        moves = range_rad[0] < range_rad[1]
        free, most = (share * chair.torques_n_m[0] if moves else math.inf for share in TORQUE_SHARES)
        # A single nosing has no line to the next one: no pitch is above it.
        self._limits = np.array([free, friction, ERROR_M, steepest_rad(ground, 0.5 * math.pi), most, known_friction])
        self._rates = np.array([SPEED_M_S, FLIPPER_RAD_S, PITCH_RAD_S])
        self._end_rad = end_rad
        self._pitch[self.start] = start.pitch_rad
        self._order[0], self._count = self.start, 1

    def fill(self) -> Iterator[None]:
        """Explore and relax in portions."""
        prices = np.array(PRICES)
        explored = 0
        while explored < self._count:
            last = explored + PORTION
            self._count = explore(
                explored,
                self._count,
                last,
                self._order,
                self._pitch,
                self._state,
                self._leads,
                self._cost,
                self.places_m,
                self.angles_rad,
                self.ground,
                self.chair.parts,
                self.chair.masses,
                self.chair.torques_n_m,
                self._limits,
                self._rates,
                prices,
            )
            explored = last
            yield
        found = self._order[: self._count]
        at_the_end = found[found // (self.angles_rad.size * BRANCHES) == self.places_m.size - 1]
        off_rad = (
            0.0 if self._end_rad is None else np.abs(self.angles_rad[at_the_end // BRANCHES % self.angles_rad.size] - self._end_rad)
        )
        self._to_go[at_the_end] = (1.0 / FLIPPER_RAD_S + PRICES[6]) * off_rad
        while not relax(SWEEPS, found, self._leads, self._cost, self._to_go):
            yield

    def nearest(self, x_m: float, angle_rad: float, pitch_rad: float) -> int:
        """Return the state with a way that is nearest to a measured one; -1 if there is none near."""
        return int(nearest(x_m, angle_rad, pitch_rad, self._pitch, self._to_go, self.places_m, self.angles_rad))

    def after(self, node: int, time_s: float) -> int:
        """Return the state on the way from a state after so much time."""
        leads, cost, to_go, pitch = self._leads, self._cost, self._to_go, self._pitch
        return int(after(node, time_s, leads, cost, to_go, pitch, self.places_m, self.angles_rad, self._rates))

    def state(self, node: int) -> WayState:
        """Return a state of the table."""
        wide = self.angles_rad.size
        return WayState(
            x_m=float(self.places_m[node // (wide * BRANCHES)]),
            angle_rad=float(self.angles_rad[node // BRANCHES % wide]),
            pitch_rad=float(self._pitch[node]),
            torque_n_m=float(self._state[node, 2]),
            to_go_s=float(self._to_go[node]),
        )

    def path(self, node: int) -> PlannedWay | None:
        """Return the way from a state to the end, or None."""
        if not math.isfinite(self._to_go[node]):
            return None
        nodes, drops = [node], [0.0]
        while (move := cheapest(node, self._leads, self._cost, self._to_go)) >= 0:
            drops.append(float(self._cost[node, move, 1]))
            node = int(self._leads[node, move])
            nodes.append(node)
        states = [self.state(number) for number in nodes]
        poses = tuple(self.chair.at(self.ground, state.x_m, (state.angle_rad,), state.pitch_rad) for state in states)
        return PlannedWay(poses=poses, drops_m=np.array(drops), unknown_m=self._state[nodes, 1], cost_s=states[0].to_go_s)


def find_way(
    chair: RestChair,
    ground: Ground,
    start: RestPose,
    end_m: float,
    range_rad: tuple[float, float],
    **options: float,
) -> PlannedWay | None:
    """Return the cheapest way, or None; arguments and errors are those of ``WayTable``."""
    table = WayTable(chair, ground, start, end_m, range_rad, **options)
    for _ in table.fill():
        pass
    return table.path(table.start)


def steepest_rad(ground: Ground, single_rad: float) -> float:
    """Return the slope of the steepest line from one nosing to the next [rad]; ``single_rad`` where there are not two."""
    rises = np.diff(nosings_of(ground), axis=0)
    return float(np.arctan2(rises[:, 1], rises[:, 0]).max()) if rises.size else single_rad


def _places(start_m: float, end_m: float, ground: Ground, step_m: float) -> Float[np.ndarray, " n"]:
    """Return the grid of places from start to end, laid from the uppermost nosing so that it does not depend on the start."""
    sign, nosings = math.copysign(1.0, end_m - start_m), nosings_of(ground)
    anchor_m = float(nosings[-1, 0]) if nosings.size else start_m
    first, last = ((place - anchor_m) / (sign * step_m) for place in (start_m, end_m))
    between = anchor_m + sign * step_m * np.arange(math.floor(first + 1e-6) + 1, math.ceil(last - 1e-6))
    return np.array([start_m, *between, end_m])
