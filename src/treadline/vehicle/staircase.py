"""Staircase in the world: steps, nosings, landings and walls.

Paper: Fig. 3(a) (height h, width w). W: z up, x up the flight, origin on the floor under the first nosing, mid-width. Several
straight flights are equal except for jitter, with a landing between any two; S is the frame of the first flight, so that x along S
also grows over the landings, by cos β per metre. Turning flights (quarter landings) have separate frames F: like W, below the first
nosing of the flight. Positions of steps are then in F, and S belongs to a flight.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG, rotation_y, rotation_z, wrap
from treadline.scenario.stair import Friction, Stair, StepOverride
from treadline.scenario.step_rules import place_of
from treadline.vehicle.winders import Winders

TREAD_THICKNESS_M = 0.04
"""Thickness of an open-riser tread [m]."""
WALL_HEIGHT_M = 2.2
"""Height of the walls above the steps [m]."""
NEWEL_HEIGHT_M = 1.0
"""Height of a newel post above the last winder: about that of a handrail."""
STOREY_M = 0.3
"""Height range above and below a flight within which a chair counts as on the flight [m]: more than the lift by a pulley and its
flipper."""
FLOOR_LENGTH_M = 6.0
"""Length of the floor before the first step [m]."""
SIGN_OF_TURN = {"none": 0, "left": 1, "right": -1}
"""Sign of a turn, positive to the left."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Tread with the nosing at its front."""

    index: int
    x_m: float
    """Position of the nosing's front at mid-width along the flight (F) [m]."""
    z_m: float
    """Height of the tread [m]."""
    depth_m: float
    """Distance to the front of the next nosing, also across a landing [m]."""
    rise_m: float
    """Height above the previous tread or the floor [m]."""
    yaw_rad: float
    """Rotation of the nosing about the vertical [rad]; zero is perpendicular to the flight."""
    missing: bool
    """Whether the step has no tread."""
    friction: tuple[Friction, Friction]
    """Friction along and across the belt, for the left half and the right half."""
    nosing_radius_m: float
    """Radius of the rounded front edge."""
    y_m: float = 0.0
    """Place of the nosing's middle across its flight (F), positive to the left: not zero for winders alone."""
    overhang_m: float = 0.0
    """Overhang of the tread over the riser [m]."""
    tread_slope_rad: float = 0.0
    """Slope of the tread [rad], positive if the tread rises towards its back."""

    @property
    def nosing_F(self) -> Float[np.ndarray, " 3"]:
        """Middle of the nosing's front in the frame of its flight."""
        return np.array([self.x_m, self.y_m, self.z_m])


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """Solid box, rotated about the vertical by ``yaw_rad``, its front lowered by ``pitch_rad``."""

    kind: str
    """Kind: ``floor``, ``step`` (a tread, with its riser unless it overhangs), ``riser`` (under an overhanging tread), ``landing``
    or ``wall``."""
    index: int
    """Index of the step; -1 for other boxes."""
    centre_W: tuple[float, float, float]
    half_m: tuple[float, float, float]
    """Half extents along the box's own axes."""
    yaw_rad: float
    pitch_rad: float = 0.0

    @property
    def R_WK(self) -> Float[np.ndarray, "3 3"]:
        """Rotation of the box K in the world."""
        return rotation_z(self.yaw_rad) @ rotation_y(-self.pitch_rad) if self.pitch_rad else rotation_z(self.yaw_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class Staircase:
    """Flight between a floor and a landing, or several flights with landings between them."""

    steps: tuple[Step, ...]
    """Steps of all flights, the lowest first."""
    width_m: float
    landing_m: float
    """Depth of the uppermost landing."""
    open_risers: bool
    nosing_radius_m: float
    """Radius of the nosings as designed; ``steps`` hold the radius of each."""
    slope_rad: float
    """Design slope of the nosing plane, without jitter [rad]."""
    friction: Friction
    """Design friction along and across; individual values are in ``steps``."""
    floor_friction: Friction
    walls: str
    end_wall: bool = False
    """Whether a wall stands across the far end of the uppermost landing."""
    flight_count: int = 1
    """Number of flights; winders count as the top of the flight below them."""
    turn_rad: float = 0.0
    """Turn from each flight to the next, positive to the left; zero straight on."""
    winders: Winders | None = None

    @property
    def flights(self) -> tuple[tuple[Step, ...], ...]:
        """Steps of each flight, the lowest first; the uppermost step of each flight is its landing."""
        if self.winders is not None:
            return self.steps[: self.winders.after], self.steps[self.winders.after :]
        each = len(self.steps) // self.flight_count
        return tuple(self.steps[k * each : (k + 1) * each] for k in range(self.flight_count))

    @property
    def straight_parts(self) -> tuple[tuple[Step, ...], ...]:
        """Steps of each flight whose nosings are parallel: all but the winders after the first, whose nosing is square."""
        if self.winders is None:
            return self.flights
        return self.steps[: self.winders.first + 1], self.steps[self.winders.after :]

    def alone(self, flight: int) -> "Staircase":
        """Return one flight with its landing and without the others; W is then F."""
        steps = self.flights[flight]
        is_last = steps[-1] is self.steps[-1]
        landing_m = self.landing_m if is_last else steps[-1].depth_m
        end_wall = self.end_wall and is_last
        return replace(self, steps=steps, landing_m=landing_m, end_wall=end_wall, flight_count=1, turn_rad=0.0, winders=None)

    def flight_frame(self, flight: int) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
        """Return rotation and origin of a flight's frame F in the world."""
        R_WF, p_WF = np.eye(3), np.zeros(3)
        if self.turn_rad:
            for below in range(flight):
                p_WF = p_WF + R_WF @ self._next_origin_F(below)
                # Rounded, so that a quarter turn has whole numbers.
                R_WF = np.round(R_WF @ rotation_z(self.turn_rad), 15)
        return R_WF, p_WF

    def _next_origin_F(self, flight: int) -> Float[np.ndarray, " 3"]:
        """Return the origin of the next flight's frame in the frame of a flight, which turns."""
        if self.winders is not None:
            x, y, _ = self.winders.nosing(self.winders.count)
            return np.array([self.steps[self.winders.first].x_m + x, y, 0.0])
        landing = self.flights[flight][-1]
        # The next flight leaves the landing by its side, flush with its far end.
        aside_m = math.copysign(0.5 * self.width_m, self.turn_rad)
        return np.array([landing.x_m + landing.depth_m - 0.5 * self.width_m, aside_m, 0.0])

    def _length_m(self, flight: int) -> float:
        """Return how far along the stair, in the plan, the next flight's origin lies from a flight's own.

        At the corner of a turn a place has the same distance along the stair in both frames.
        """
        if self.winders is not None:
            chord_m = 2.0 * self.winders.walking_radius_m * math.sin(0.5 * abs(self.turn_rad))
            return self.steps[self.winders.first].x_m + chord_m
        landing = self.flights[flight][-1]
        return landing.x_m + landing.depth_m

    def stair_frame(self, flight: int) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"], float]:
        """Return the frame S of a flight: rotation, origin, and distance of the origin along the stair over the landings [m]."""
        if not self.turn_rad:
            return self.R_WS, self.p_WS, 0.0
        R_WF, p_WF = self.flight_frame(flight)
        first, c, s = self.flights[flight][0], math.cos(self.slope_rad), math.sin(self.slope_rad)
        along_m = sum(self._length_m(below) * c for below in range(flight))
        origin = p_WF + R_WF @ first.nosing_F
        return R_WF @ self.R_WS, origin, along_m + (first.z_m - self.steps[0].z_m) * s

    def flight_at(self, p_WB: Float[np.ndarray, " 3"], R_WB: Float[np.ndarray, "3 3"]) -> int:
        """Return the flight under a chair; on a landing, that of the two flights with the smaller heading error."""
        if not self.turn_rad:
            return 0
        yaw = math.atan2(R_WB[1, 0], R_WB[0, 0])
        height_m = float(p_WB[2])
        near = [
            k
            for k, steps in enumerate(self.flights)
            if steps[0].z_m - steps[0].rise_m - STOREY_M <= height_m <= steps[-1].z_m + STOREY_M
        ]
        heading_errors = {k: abs(wrap(yaw - k * self.turn_rad)) for k in near or range(self.flight_count)}
        return min(heading_errors, key=lambda k: (heading_errors[k], k))

    @property
    def last_nosing_m(self) -> float:
        """Position of the uppermost nosing along the stair (S), measured from the first over the landings [m]."""
        R_WS, p_WS, along_m = self.stair_frame(self.flight_count - 1)
        R_WF, p_WF = self.flight_frame(self.flight_count - 1)
        return along_m + float(R_WS[:, 0] @ (p_WF + R_WF @ self.steps[-1].nosing_F - p_WS))

    @property
    def R_WS(self) -> Float[np.ndarray, "3 3"]:
        """Rotation of the stair's frame: x up the flight in the nosing plane, z its normal."""
        return rotation_y(-self.slope_rad)

    @property
    def p_WS(self) -> Float[np.ndarray, " 3"]:
        """Origin of S in W: the first nosing [m]."""
        return self.steps[0].nosing_F

    @property
    def nosings_W(self) -> Float[np.ndarray, "N 3"]:
        """Points on the nosings at mid-width [m], missing steps excluded."""
        if not self.turn_rad:
            return np.array([step.nosing_F for step in self.steps if not step.missing])
        frames = [self.flight_frame(k) for k in range(self.flight_count)]
        return np.array(
            [
                p_WF + R_WF @ step.nosing_F
                for (R_WF, p_WF), steps in zip(frames, self.flights, strict=True)
                for step in steps
                if not step.missing
            ]
        )

    @property
    def pitch_m(self) -> float:
        """Mean distance between nosings along the first flight, √(h² + w²); with winders, of the longer straight part."""
        flight = self.flights[0] if self.winders is None else max(self.straight_parts, key=len)
        first, last = flight[0], flight[-1]
        return math.hypot(last.x_m - first.x_m, last.z_m - first.z_m) / (len(flight) - 1)

    def boxes(self) -> tuple[Box, ...]:
        """Return the solids with sharp front edges: floor, steps, landings, walls.

        The plant rounds the nosings off; the camera draws them with these sharp edges.
        """
        floor = Box(
            kind="floor",
            index=-1,
            centre_W=(-0.5 * FLOOR_LENGTH_M, 0.0, -0.1),
            half_m=(0.5 * FLOOR_LENGTH_M + 0.5, 0.5 * self.width_m + 2.0, 0.1),
            yaw_rad=0.0,
        )
        frames = [self.flight_frame(k) for k in range(self.flight_count)]
        treads = [_placed(box, *frame) for k, frame in enumerate(frames) for box in self._treads(k)]
        walls = [_placed(box, *frame) for k, frame in enumerate(frames) for box in self._walls(k)]
        if self.end_wall:
            walls.append(_placed(self._end_wall(), *frames[-1]))
        return (floor, *treads, *walls)

    def _treads(self, flight: int) -> list[Box]:
        """Return the steps of a flight, winders included, and its landing, in F."""
        steps = self.flights[flight]
        is_last, half_width = flight + 1 == self.flight_count, 0.5 * self.width_m
        goes_on = not is_last and not self.turn_rad
        above: tuple[Step | None, ...] = (*steps[1:], self.flights[flight + 1][0] if goes_on else None)
        boxes: list[Box] = []
        for step, after in zip(steps, above, strict=True):
            if step.missing:
                continue
            if self.winders is not None and self.winders.holds(step.index):
                boxes += self._winder(step, self.winders)
            elif after is None:
                boxes += self._tread(step, max(self.landing_m, step.depth_m) if is_last else step.depth_m, "landing", half_width)
            else:
                kind = "landing" if step is steps[-1] else "step"
                boxes += self._tread(step, step.depth_m + self._under(step, after), kind, half_width)
        return boxes

    def _end_wall(self) -> Box:
        """Return the wall across the far end of the uppermost landing, in F."""
        last, half_height = self.steps[-1], 0.5 * WALL_HEIGHT_M
        end_x = last.x_m + max(self.landing_m, last.depth_m)
        return Box(
            kind="wall",
            index=-1,
            centre_W=(end_x + 0.05, 0.0, last.z_m + half_height),
            half_m=(0.05, 0.5 * self.width_m, half_height),
            yaw_rad=0.0,
        )

    @property
    def surfaces(self) -> Float[np.ndarray, "N 7"]:
        """Flat tops of floor, treads and landings: centre x, y, cosine and sine of the yaw, half length, half width, height."""
        return np.array(
            [
                (x, y, math.cos(box.yaw_rad), math.sin(box.yaw_rad), *box.half_m[:2], z + box.half_m[2])
                for box in self.boxes()
                if box.kind not in ("wall", "riser")
                for x, y, z in [box.centre_W]
            ]
        )

    def above_ground_m(self, points_W: Float[np.ndarray, "n 3"], sunk_m: float = 0.0) -> Float[np.ndarray, " n"]:
        """Return the height of points above the highest floor, tread or landing below them [m]; inf where there is none.

        Args:
            sunk_m: Largest height of the ground above a point that lies in it.
        """
        x, y, c, s, half_length, half_width, height = self.surfaces.T
        dx, dy = points_W[:, :1] - x, points_W[:, 1:2] - y
        inside = (np.abs(dx * c + dy * s) <= half_length) & (np.abs(dy * c - dx * s) <= half_width)
        below = inside & (height <= points_W[:, 2:] + sunk_m)
        return np.asarray(points_W[:, 2] - np.where(below, height, -np.inf).max(axis=1))

    def _under(self, step: Step, after: Step) -> float:
        """Return the length of a tread under the next step [m], so that a rotated nosing leaves no gap."""
        if self.open_risers:
            return 0.03
        turned_m = 0.5 * self.width_m * abs(math.tan(after.yaw_rad) - math.tan(step.yaw_rad))
        return max(0.10, turned_m + 0.01) + after.overhang_m

    def _winder(self, step: Step, winders: Winders) -> list[Box]:
        """Return the boxes that cover a winder's wedge; what they cover beyond it lies under the next steps or in the newel."""
        into_newel_m = winders.newel_m * (1.0 - math.cos(winders.step_rad))
        aside_m = 0.5 * into_newel_m * winders.side
        inward = replace(step, x_m=step.x_m - aside_m * math.sin(step.yaw_rad), y_m=step.y_m + aside_m * math.cos(step.yaw_rad))
        depth_m = winders.depth_m + self._under_next_winder(step, winders)
        return self._tread(inward, depth_m, "step", 0.5 * (self.width_m + into_newel_m))

    def _under_next_winder(self, step: Step, winders: Winders) -> float:
        """Return how far a winder reaches under the next step beyond its wedge: jitter turns their nosings apart."""
        after = self.steps[step.index + 1]
        design_rad = winders.step_rad if winders.holds(after.index) else -winders.nosing(winders.count - 1)[2]
        turned_m = 0.5 * self.width_m * abs(math.tan(after.yaw_rad - step.yaw_rad - design_rad))
        return max(0.10, turned_m + 0.01) + after.overhang_m

    def _tread(self, step: Step, depth_m: float, kind: str, half_width: float) -> list[Box]:
        """Return the box of a step, or a slab and the riser below an overhanging tread."""
        whole_m = step.rise_m + 0.10
        if self.open_risers:
            return [_behind_nosing(step, kind, half_width, depth_m, 0.0, (0.0, TREAD_THICKNESS_M))]
        if step.overhang_m == 0.0:
            return [_behind_nosing(step, kind, half_width, depth_m, 0.0, (0.0, whole_m))]
        slab_m = max(TREAD_THICKNESS_M, 2.0 * step.nosing_radius_m)
        slab = _behind_nosing(step, kind, half_width, depth_m, 0.0, (0.0, slab_m))
        lower = (slab_m, max(whole_m, slab_m + 0.01))
        return [slab, _behind_nosing(step, "riser", half_width, depth_m, step.overhang_m, lower)]

    def _walls(self, flight: int) -> list[Box]:
        """Return the walls next to a flight; floor and landings are open, so that a chair can turn."""
        steps, winders = self.flights[flight], self.winders
        winds = winders is not None and flight == 0
        first, last = steps[0], steps[winders.first] if winders is not None and winds else steps[-1]
        height_m = 0.5 * last.z_m + 0.5
        straight = [
            Box(
                kind="wall",
                index=-1,
                centre_W=(0.5 * (first.x_m + last.x_m), sign * (0.5 * self.width_m + 0.05), height_m),
                half_m=(0.5 * (last.x_m - first.x_m), 0.05, height_m + WALL_HEIGHT_M),
                yaw_rad=0.0,
            )
            for sign in self._walled_sides
            if last.x_m > first.x_m
        ]
        return straight + (self._around(winders, last.x_m) if winders is not None and winds else [])

    @property
    def _walled_sides(self) -> list[float]:
        """Sides with a wall: 1 on the left, -1 on the right."""
        return [sign for side, sign in (("left", 1.0), ("right", -1.0)) if self.walls in (side, "both")]

    def _around(self, winders: Winders, first_x_m: float) -> list[Box]:
        """Return the newel, a box inscribed in its circle for each winder, and the wall at the outer side of each, in F."""
        top_m = self.steps[winders.after - 1].z_m
        boxes: list[Box] = []
        for k in range(winders.count):
            x, y, yaw = winders.nosing(k)
            frame = rotation_z(yaw), np.array([first_x_m + x, y, 0.0])
            half = 0.5 * abs(winders.step_rad)
            post = Box(
                kind="wall",
                index=-1,
                centre_W=(0.0, winders.side * winders.walking_radius_m, 0.5 * (top_m + NEWEL_HEIGHT_M)),
                half_m=(winders.newel_m * math.sin(half), winders.newel_m * math.cos(half), 0.5 * (top_m + NEWEL_HEIGHT_M)),
                yaw_rad=winders.side * half,
            )
            boxes.append(_placed(post, *frame))
            if -winders.side in self._walled_sides:
                outside = Box(
                    kind="wall",
                    index=-1,
                    centre_W=(0.5 * winders.depth_m, -winders.side * (0.5 * self.width_m + 0.05), 0.5 * (top_m + WALL_HEIGHT_M)),
                    half_m=(0.5 * winders.depth_m, 0.05, 0.5 * (top_m + WALL_HEIGHT_M)),
                    yaw_rad=0.0,
                )
                boxes.append(_placed(outside, *frame))
        return boxes


def _placed(box: Box, R_WF: Float[np.ndarray, "3 3"], p_WF: Float[np.ndarray, " 3"]) -> Box:
    """Return a box of one flight in the world."""
    x, y, z = p_WF + R_WF @ np.array(box.centre_W)
    yaw_rad = box.yaw_rad + math.atan2(R_WF[1, 0], R_WF[0, 0])
    return replace(box, centre_W=(float(x), float(y), float(z)), yaw_rad=yaw_rad)


def _behind_nosing(step: Step, kind: str, half_width: float, depth_m: float, front_m: float, depths_m: tuple[float, float]) -> Box:
    """Return a box between two depths below a tread, from ``front_m`` to ``depth_m`` behind the nosing, in F."""
    c, s = math.cos(step.tread_slope_rad), math.sin(step.tread_slope_rad)
    upper_m, lower_m = depths_m
    half_depth, half_height = 0.5 * (depth_m - front_m), 0.5 * (lower_m - upper_m)
    along, below = front_m + half_depth, upper_m + half_height
    forward = along * c + below * s
    return Box(
        kind=kind,
        index=step.index,
        centre_W=(
            step.x_m + forward * math.cos(step.yaw_rad),
            step.y_m + forward * math.sin(step.yaw_rad),
            step.z_m + along * s - below * c,
        ),
        half_m=(half_depth, half_width, half_height),
        yaw_rad=step.yaw_rad,
        pitch_rad=step.tread_slope_rad,
    )


def build_staircase(stair: Stair, rng: np.random.Generator, overrides: Sequence[StepOverride] = ()) -> Staircase:
    """Return the staircase of a scenario, with jitter drawn from ``rng``.

    Args:
        overrides: Properties of individual steps, which replace design values and jitter.
    """
    count = stair.count
    own = _by_step(stair, overrides)
    rises = stair.rise_m + stair.rise_jitter_m * rng.standard_normal(count)
    yaws = stair.nosing_yaw_jitter_deg * DEG * rng.standard_normal(count)
    longer = stair.run_jitter_m * rng.standard_normal(count) if stair.run_jitter_m else np.zeros(count)
    for index, keys in own.items():
        rises[index] = keys.get("rise_m", rises[index])
        yaws[index] = keys["yaw_deg"] * DEG if "yaw_deg" in keys else yaws[index]
        longer[index] = keys["run_m"] - stair.run_m if "run_m" in keys else longer[index]
    longer[stair.steps - 1 :: stair.steps] = 0.0  # stair.landing_m and between_m are the landings' depths
    winders = _winders(stair)
    if winders is not None:
        longer[winders.first : winders.after] = 0.0
    heights = np.cumsum(rises)
    left, right = stair.halves
    places = _places(stair, longer, winders)
    steps = tuple(
        Step(
            index=i,
            x_m=x_m,
            y_m=y_m,
            z_m=float(heights[i]),
            depth_m=depth_m,
            rise_m=float(rises[i]),
            yaw_rad=turned + float(yaws[i]),
            missing=i in stair.missing_steps,
            friction=(keys.get("friction_left", left), keys.get("friction_right", right)),
            nosing_radius_m=keys.get("nosing_radius_m", stair.nosing_radius_m),
            overhang_m=keys.get("overhang_m", 0.0),
            tread_slope_rad=keys.get("tread_slope_deg", 0.0) * DEG,
        )
        for i, (x_m, y_m, turned, depth_m) in enumerate(places)
        for keys in (own.get(i, {}),)
    )
    return Staircase(
        steps=steps,
        width_m=stair.width_m,
        landing_m=stair.landing_m,
        open_risers=stair.open_risers,
        nosing_radius_m=stair.nosing_radius_m,
        slope_rad=stair.slope_rad,
        friction=stair.friction,
        floor_friction=stair.floor_friction or stair.friction,
        walls=stair.walls,
        end_wall=stair.end_wall,
        flight_count=stair.flights if winders is None else 2,
        turn_rad=0.5 * math.pi * SIGN_OF_TURN[stair.turn] if winders is None else winders.turn_rad,
        winders=winders,
    )


def _winders(stair: Stair) -> Winders | None:
    if not stair.winders:
        return None
    return Winders(
        first=stair.first_winder,
        count=stair.winders,
        turn_rad=stair.winder_turn_deg * DEG * SIGN_OF_TURN[stair.winder_to],
        newel_m=stair.newel_m,
        width_m=stair.width_m,
    )


def _places(stair: Stair, longer_m: Float[np.ndarray, " n"], winders: Winders | None) -> list[tuple[float, float, float, float]]:
    """Return each step's place in its flight (x, y), the turn of its nosing by design, and its depth.

    Args:
        longer_m: Depth of each step beyond ``stair.run_m``.
    """
    count = stair.count
    moved = np.cumsum(longer_m) - longer_m
    further_m = stair.between_m - stair.run_m
    first = np.arange(0, count, stair.steps)
    turns = stair.turn != "none"
    begins = first * stair.run_m + np.arange(stair.flights) * further_m + moved[first] if turns else np.zeros(stair.flights)
    places = [
        (
            i * stair.run_m + i // stair.steps * further_m + float(moved[i]) - float(begins[i // stair.steps]),
            0.0,
            0.0,
            (stair.between_m if stair.is_landing(i) and i + 1 < count else stair.run_m) + float(longer_m[i]),
        )
        for i in range(count)
    ]
    if winders is None:
        return places
    foot_x_m, above_x_m = places[winders.first][0], places[winders.after][0]
    nosings = [winders.nosing(k) for k in range(winders.count)]
    wound = [(foot_x_m + x, y, turned, winders.going_m(winders.walking_radius_m)) for x, y, turned in nosings]
    above = [(x - above_x_m, y, turned, depth) for x, y, turned, depth in places[winders.after :]]
    return places[: winders.first] + wound + above


def as_designed(stair: Stair, overrides: Sequence[StepOverride] = ()) -> Staircase:
    """Return the staircase without jitter."""
    level = {"rise_jitter_m": 0.0, "run_jitter_m": 0.0, "nosing_yaw_jitter_deg": 0.0}
    return build_staircase(stair.model_copy(update=level), np.random.default_rng(0), overrides)


def _by_step(stair: Stair, overrides: Sequence[StepOverride]) -> dict[int, dict[str, Any]]:
    """Return the overridden properties of each step by index; ``friction`` applies to both halves."""
    found: dict[int, dict[str, Any]] = {}
    for override in overrides:
        keys = {key: value for key, value in override.model_dump(exclude={"index"}).items() if value is not None}
        if "friction" in keys:
            keys["friction_left"] = keys["friction_right"] = keys.pop("friction")
        found.setdefault(place_of(stair, override), {}).update(keys)
    return found
