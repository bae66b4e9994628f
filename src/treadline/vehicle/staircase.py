"""Staircase in the world: steps, nosings, flights and their frames; ``stair_solids`` gives its volume.

Paper: Fig. 3(a) (height h, width w). W: z up, x up the flight, origin on the floor under the first nosing, mid-width. Several
straight flights are equal except for jitter, with a landing between any two; S is the frame of the first flight, so that x along S
also grows over the landings, by cos β per metre. Turning flights (quarter landings) have separate frames F: like W, below the first
nosing of the flight. Positions of steps are then in F, and S belongs to a flight.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG, wrap
from treadline.core.rotations import Rotation, Vector3, rotation_y, rotation_z
from treadline.scenario.sill import Sill, landing_of
from treadline.scenario.stair import Friction, Stair, StepOverride, place_of

SIGN_OF_TURN = {"none": 0, "left": 1, "right": -1}
"""Sign of a turn, positive to the left."""
Relief = tuple[tuple[float, float], ...]
"""Outline of ground with sills: distance from the flight and height of each vertex [m], the nearest first."""


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
    y_m: float
    """Place of the nosing's middle across its flight (F), positive to the left: not zero for winders alone."""
    overhang_m: float
    """Overhang of the tread over the riser [m]."""
    tread_slope_rad: float
    """Slope of the tread [rad], positive if the tread rises towards its back."""

    @property
    def nosing_F(self) -> Vector3:
        """Middle of the nosing's front in the frame of its flight."""
        return np.array([self.x_m, self.y_m, self.z_m])


@dataclass(frozen=True, slots=True, kw_only=True)
class Winders:
    """Plan of the winders of one stair: wedge-shaped steps around a newel post.

    All places are in the plan, relative to the middle of the first winder's nosing: x up the flight, y to the left. The first
    winder's nosing is square to the flight below; each next nosing, and the nosing above the last winder, is turned further by the
    same angle about the newel's axis.
    """

    first: int
    """Index of the first winder, counted over all steps from the floor."""
    count: int
    """Number of winders."""
    turn_rad: float
    """Turn of the flight by all winders together, positive to the left."""
    newel_m: float
    """Radius of the newel: distance of the nosings' inner ends from its axis."""
    width_m: float
    """Length of a nosing, from the newel to the outer side."""

    @property
    def side(self) -> float:
        """Side of the newel: 1 on the left, -1 on the right."""
        return math.copysign(1.0, self.turn_rad)

    @property
    def step_rad(self) -> float:
        """Angle between neighbouring nosings, with the sign of the turn."""
        return self.turn_rad / self.count

    @property
    def walking_radius_m(self) -> float:
        """Distance of the nosings' middles from the newel's axis."""
        return self.newel_m + 0.5 * self.width_m

    @property
    def outer_radius_m(self) -> float:
        """Distance of the nosings' outer ends from the newel's axis."""
        return self.newel_m + self.width_m

    @property
    def depth_m(self) -> float:
        """Depth of a tread at its outer side, square to its nosing: the box that covers the wedge is as deep."""
        return self.outer_radius_m * math.sin(abs(self.step_rad))

    @property
    def after(self) -> int:
        """Index of the step above the last winder."""
        return self.first + self.count

    def going_m(self, radius_m: float) -> float:
        """Return the distance between neighbouring nosings at a distance from the newel's axis, along the chord."""
        return 2.0 * radius_m * math.sin(0.5 * abs(self.step_rad))

    def holds(self, index: int) -> bool:
        """Return whether a step is a winder."""
        return self.first <= index < self.after

    def nosing(self, k: int) -> tuple[float, float, float]:
        """Return the place of the k-th nosing's middle (x, y) and its turn; k = count is the step above the last winder."""
        turned, radius_m = k * self.step_rad, self.walking_radius_m
        return radius_m * math.sin(abs(turned)), self.side * radius_m * (1.0 - math.cos(turned)), turned


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
    end_wall: bool
    """Whether a wall stands across the far end of the uppermost landing."""
    flight_count: int
    """Number of flights; winders count as the top of the flight below them."""
    turn_rad: float
    """Turn from each flight to the next, positive to the left; zero straight on."""
    winders: Winders | None
    reliefs: Mapping[int | None, Relief]
    """Outlines of floor (None) and landings (index of the step) with sills; others are absent."""

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

    def ground_behind(self, place: int | None) -> tuple[float, float]:
        """Return distance and height of the ground behind the sills of floor (None) or landing [m]."""
        return self.reliefs.get(place, ((0.0, 0.0),))[-1]

    def alone(self, flight: int) -> "Staircase":
        """Return one flight with its landing and without the others; W is then F."""
        steps = self.flights[flight]
        is_last = steps[-1] is self.steps[-1]
        landing_m = self.landing_m if is_last else steps[-1].depth_m
        end_wall = self.end_wall and is_last
        return replace(self, steps=steps, landing_m=landing_m, end_wall=end_wall, flight_count=1, turn_rad=0.0, winders=None)

    def flight_frame(self, flight: int) -> tuple[Rotation, Vector3]:
        """Return rotation and origin of a flight's frame F in the world."""
        R_WF, p_WF = np.eye(3), np.zeros(3)
        if self.turn_rad:
            for below in range(flight):
                p_WF = p_WF + R_WF @ self._next_origin_F(below)
                # Rounded, so that a quarter turn has whole numbers.
                R_WF = np.round(R_WF @ rotation_z(self.turn_rad), 15)
        return R_WF, p_WF

    def _next_origin_F(self, flight: int) -> Vector3:
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

    def stair_frame(self, flight: int) -> tuple[Rotation, Vector3, float]:
        """Return the frame S of a flight: rotation, origin, and distance of the origin along the stair over the landings [m]."""
        if not self.turn_rad:
            return self.R_WS, self.p_WS, 0.0
        R_WF, p_WF = self.flight_frame(flight)
        first, c, s = self.flights[flight][0], math.cos(self.slope_rad), math.sin(self.slope_rad)
        along_m = sum(self._length_m(below) * c for below in range(flight))
        origin = p_WF + R_WF @ first.nosing_F
        return R_WF @ self.R_WS, origin, along_m + (first.z_m - self.steps[0].z_m) * s

    def flight_at(self, p_WB: Vector3, R_WB: Rotation) -> int:
        """Return the flight under a chair; on a landing, that of the two flights with the smaller heading error."""
        if not self.turn_rad:
            return 0
        yaw = math.atan2(R_WB[1, 0], R_WB[0, 0])
        height_m = float(p_WB[2])
        lift_m = 0.3  # more than the lift by a pulley and its flipper
        near = [
            k
            for k, steps in enumerate(self.flights)
            if steps[0].z_m - steps[0].rise_m - lift_m <= height_m <= steps[-1].z_m + lift_m
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
    def R_WS(self) -> Rotation:
        """Rotation of the stair's frame: x up the flight in the nosing plane, z its normal."""
        return rotation_y(-self.slope_rad)

    @property
    def p_WS(self) -> Vector3:
        """Origin of S in W: the first nosing [m]."""
        return self.steps[0].nosing_F

    @property
    def nosings_W(self) -> Float[np.ndarray, "N 3"]:
        """Points on the nosings at mid-width [m], missing steps excluded."""
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
        """Mean distance between nosings along the first flight, √(h² + w²); with winders, of the longer straight part.

        A single nosing has the distance by design.
        """
        flight = self.flights[0] if self.winders is None else max(self.straight_parts, key=len)
        first, last = flight[0], flight[-1]
        if first is last:
            return first.rise_m / math.sin(self.slope_rad)
        return math.hypot(last.x_m - first.x_m, last.z_m - first.z_m) / (len(flight) - 1)


def build_staircase(
    stair: Stair, rng: np.random.Generator, overrides: Sequence[StepOverride] = (), sills: Sequence[Sill] = ()
) -> Staircase:
    """Return the staircase of a scenario, with jitter drawn from ``rng``.

    Args:
        overrides: Properties of individual steps, which replace design values and jitter.
        sills: Sills on floor and landings.
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
            overhang_m=keys.get("overhang_m", stair.overhang_m),
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
        reliefs=_reliefs(stair, sills),
    )


def _reliefs(stair: Stair, sills: Sequence[Sill]) -> dict[int | None, Relief]:
    """Return the outlines of floor and landings with sills."""
    found: dict[int | None, Relief] = {}
    for sill in sorted(sills, key=attrgetter("distance_m")):
        place = landing_of(stair, sill)
        before = found.get(place, ((0.0, 0.0),))
        found[place] = (*before, *sill.vertices(before[-1][1]))
    return found


def up_W(stair: Stair) -> Vector3:
    """Return the unit vector against gravity in W: its z axis, except on a stair that falls to a side."""
    fall_rad = stair.side_slope_deg * DEG
    return np.array([0.0, math.sin(fall_rad), math.cos(fall_rad)])


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


def as_designed(stair: Stair, overrides: Sequence[StepOverride] = (), sills: Sequence[Sill] = ()) -> Staircase:
    """Return the staircase without jitter."""
    level = {"rise_jitter_m": 0.0, "run_jitter_m": 0.0, "nosing_yaw_jitter_deg": 0.0}
    return build_staircase(stair.model_copy(update=level), np.random.default_rng(0), overrides, sills)


def _by_step(stair: Stair, overrides: Sequence[StepOverride]) -> dict[int, dict[str, Any]]:
    """Return the overridden properties of each step by index; ``friction`` applies to both halves."""
    found: dict[int, dict[str, Any]] = {}
    for override in overrides:
        keys = {key: value for key, value in override.model_dump(exclude={"index"}).items() if value is not None}
        if "friction" in keys:
            keys["friction_left"] = keys["friction_right"] = keys.pop("friction")
        found.setdefault(place_of(stair, override), {}).update(keys)
    return found
