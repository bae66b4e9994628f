"""Staircase in the world: steps, nosings, flights and their frames; ``stair_solids`` gives its volume.

Paper: Fig. 3(a) (height h, width w). W: z up, x up the flight, origin on the floor under the first nosing, mid-width. Flights in
line, from one turn to the next, are a course; x along its frame S also grows over the landings, by cos β per metre. Each course
above a turn has its own frame F: like W, below its first nosing. Positions of steps are in F.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from operator import attrgetter
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG, wrap
from treadline.core.rotations import Rotation, Vector3, rotation_y, rotation_z
from treadline.scenario.flight import Side, StairFlight
from treadline.scenario.sill import Sill, landing_of
from treadline.scenario.stair import TURN_DEG, Friction, Stair, StepOverride, place_of
from treadline.vehicle.flight_plan import FlightPlan

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
    friction: Friction
    """Design friction along and across; individual values are in ``steps``."""
    floor_friction: Friction
    walls: str
    end_wall: bool
    """Whether a wall stands across the far end of the uppermost landing."""
    plans: tuple[FlightPlan, ...]
    """Plan of each flight; winders count as the top of the flight below them."""
    winders: Winders | None
    reliefs: Mapping[int | None, Relief]
    """Outlines of floor (None) and landings (index of the step) with sills; others are absent."""

    @property
    def slope_rad(self) -> float:
        """Design slope of the lowest flight's nosing plane [rad]."""
        return self.plans[0].slope_rad

    @property
    def flights(self) -> tuple[tuple[Step, ...], ...]:
        """Steps of each flight, the lowest first; the uppermost step of each flight is its landing."""
        ends = list(accumulate(plan.count for plan in self.plans))
        return tuple(self.steps[end - plan.count : end] for end, plan in zip(ends, self.plans, strict=True))

    @property
    def courses(self) -> tuple[range, ...]:
        """Numbers of the flights in line with each other, from one turn to the next."""
        begins = [0, *(k for k, plan in enumerate(self.plans[:-1], start=1) if plan.turn_rad)]
        return tuple(range(first, end) for first, end in pairwise([*begins, len(self.plans)]))

    def course_of(self, flight: int) -> int:
        """Return the number of the course to which a flight belongs."""
        return next(number for number, course in enumerate(self.courses) if flight in course)

    @property
    def straight_parts(self) -> tuple[tuple[Step, ...], ...]:
        """Steps of each flight whose nosings are parallel: all but the winders after the first, whose nosing is square."""
        if self.winders is None:
            return self.flights
        return self.steps[: self.winders.first + 1], self.steps[self.winders.after :]

    def ground_behind(self, place: int | None) -> tuple[float, float]:
        """Return distance and height of the ground behind the sills of floor (None) or landing [m]."""
        return self.reliefs.get(place, ((0.0, 0.0),))[-1]

    def alone(self, course: int) -> "Staircase":
        """Return the flights of one course with their landings and without the others; W is then F."""
        numbers = self.courses[course]
        steps = tuple(step for k in numbers for step in self.flights[k])
        is_last = steps[-1] is self.steps[-1]
        landing_m = self.landing_m if is_last else steps[-1].depth_m
        plans = (*self.plans[numbers.start : numbers.stop - 1], replace(self.plans[numbers.stop - 1], turn_rad=0.0))
        return replace(self, steps=steps, landing_m=landing_m, end_wall=self.end_wall and is_last, plans=plans, winders=None)

    def flight_frame(self, flight: int) -> tuple[Rotation, Vector3]:
        """Return rotation and origin of a flight's frame F in the world."""
        R_WF, p_WF = np.eye(3), np.zeros(3)
        for below in range(flight):
            if turn_rad := self.plans[below].turn_rad:
                p_WF = p_WF + R_WF @ self._next_origin_F(below)
                # Rounded, so that a quarter turn has whole numbers.
                R_WF = np.round(R_WF @ rotation_z(turn_rad), 15)
        return R_WF, p_WF

    def _next_origin_F(self, flight: int) -> Vector3:
        """Return the origin of the next flight's frame in the frame of a flight, which turns."""
        if self.winders is not None:
            x, y, _ = self.winders.nosing(self.winders.count)
            return np.array([self.steps[self.winders.first].x_m + x, y, 0.0])
        x, y = self.plans[flight].foot(self.width_m).mean(axis=0)
        return np.array([self.flights[flight][-1].x_m + x, y, 0.0])

    def _length_m(self, flight: int) -> float:
        """Return how far along the stair, in the plan, the next flight's origin lies from a flight's own.

        At the corner of a quarter turn a place has the same distance along the stair in both frames.
        """
        if self.winders is not None:
            chord_m = 2.0 * self.winders.walking_radius_m * math.sin(0.5 * abs(self.plans[flight].turn_rad))
            return self.steps[self.winders.first].x_m + chord_m
        return self.flights[flight][-1].x_m + self.plans[flight].depth_m

    def stair_frame(self, flight: int) -> tuple[Rotation, Vector3, float]:
        """Return the frame S of a flight: rotation, origin, and distance of the origin along the stair over the landings [m]."""
        along_m, z_m, number = 0.0, self.steps[0].z_m, self.course_of(flight)
        for course in self.courses[:number]:
            slope_rad, landing_m = self.plans[course.start].slope_rad, self.flights[course[-1]][-1].z_m
            along_m += self._length_m(course[-1]) * math.cos(slope_rad) + (landing_m - z_m) * math.sin(slope_rad)
            z_m = landing_m
        start = self.courses[number].start
        first, slope_rad = self.flights[start][0], self.plans[start].slope_rad
        along_m += (first.z_m - z_m) * math.sin(slope_rad)
        R_WF, p_WF = self.flight_frame(flight)
        return R_WF @ rotation_y(-slope_rad), p_WF + R_WF @ first.nosing_F, along_m

    def flight_at(self, p_WB: Vector3, R_WB: Rotation) -> int:
        """Return the flight under a chair; on a landing, the lowest of those with the smallest heading error."""
        yaw = math.atan2(R_WB[1, 0], R_WB[0, 0])
        height_m = float(p_WB[2])
        lift_m = 0.3  # more than the lift by a pulley and its flipper
        turned = [0.0, *accumulate(plan.turn_rad for plan in self.plans[:-1])]
        near = [
            k
            for k, steps in enumerate(self.flights)
            if steps[0].z_m - steps[0].rise_m - lift_m <= height_m <= steps[-1].z_m + lift_m
        ]
        heading_errors = {k: abs(wrap(yaw - turned[k])) for k in near or range(len(turned))}
        return min(heading_errors, key=lambda k: (heading_errors[k], k))

    @property
    def last_nosing_m(self) -> float:
        """Position of the uppermost nosing along the stair (S), measured from the first over the landings [m]."""
        last = len(self.plans) - 1
        (R_WS, p_WS, along_m), (R_WF, p_WF) = self.stair_frame(last), self.flight_frame(last)
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
        frames = [self.flight_frame(k) for k in range(len(self.plans))]
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
    count, sizes, numbers = stair.count, np.array(stair.sizes_m), [flight.steps for flight in stair.each]
    own = _by_step(stair, overrides)
    rise_m, run_m = np.repeat(sizes, numbers, axis=0).T
    rises = rise_m + stair.rise_jitter_m * rng.standard_normal(count)
    yaws = stair.nosing_yaw_jitter_deg * DEG * rng.standard_normal(count)
    longer = stair.run_jitter_m * rng.standard_normal(count) if stair.run_jitter_m else np.zeros(count)
    for index, keys in own.items():
        rises[index] = keys.get("rise_m", rises[index])
        yaws[index] = keys["yaw_deg"] * DEG if "yaw_deg" in keys else yaws[index]
        longer[index] = keys["run_m"] - run_m[index] if "run_m" in keys else longer[index]
    longer[list(stair.landings)] = 0.0  # the landings' depths are given
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
        friction=stair.friction,
        floor_friction=stair.floor_friction or stair.friction,
        walls=stair.walls,
        end_wall=stair.end_wall,
        plans=_plans(stair, winders),
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
        turn_rad=math.copysign(stair.winder_turn_deg * DEG, TURN_DEG[stair.winder_to]),
        newel_m=stair.newel_m,
        width_m=stair.width_m,
    )


def _plans(stair: Stair, winders: Winders | None) -> tuple[FlightPlan, ...]:
    """Return the plans of the flights; winders divide the only flight."""
    half_m = 0.5 * stair.width_m
    walls: tuple[Side, ...] = ("far",) if stair.end_wall else ()
    if winders is not None:
        parts = ((winders.after, winders.turn_rad), (stair.steps - winders.after, 0.0))
        sides = {"slope_rad": stair.slope_rad, "depth_m": max(stair.landing_m, stair.run_m), "right_m": -half_m, "left_m": half_m}
        return tuple(FlightPlan(count=count, turn_rad=turn_rad, walls=walls, **sides) for count, turn_rad in parts)
    uppermost_m = max(stair.landing_m, stair.sizes_m[-1][1])
    last = StairFlight.model_construct(steps=1, landing_depth_m=uppermost_m, landing_walls=walls)
    plans = []
    for flight, size_m, above in zip(stair.each, stair.sizes_m, (*stair.each[1:], last), strict=True):
        # A landing is as wide to both sides straight on; else it reaches to the side of the turn.
        wider_m = above.width_of_landing_m(stair.width_m) - stair.width_m
        left, right = (0.5, 0.5) if not above.turn_deg else (1.0, 0.0) if above.turn_deg > 0.0 else (0.0, 1.0)
        plans.append(
            FlightPlan(
                count=flight.steps,
                slope_rad=math.atan2(*size_m),
                turn_rad=above.turn_deg * DEG,
                depth_m=above.landing_depth_m,
                right_m=-half_m - right * wider_m,
                left_m=half_m + left * wider_m,
                walls=above.landing_walls,
            )
        )
    return tuple(plans)


def _places(stair: Stair, longer_m: Float[np.ndarray, " n"], winders: Winders | None) -> list[tuple[float, float, float, float]]:
    """Return each step's place in its flight (x, y), the turn of its nosing by design, and its depth.

    Args:
        longer_m: Depth of each step beyond the run of its flight.
    """
    moved = np.cumsum(longer_m) - longer_m
    places: list[tuple[float, float, float, float]] = []
    further_m = begin_m = before_m = 0.0
    for number, (flight, (_, run_m)) in enumerate(zip(stair.each, stair.sizes_m, strict=True)):
        first, last = len(places), len(places) + flight.steps - 1
        # Each place is the product of its index and the run, plus what landings and other runs below add.
        further_m += (flight.landing_depth_m - before_m) + first * (before_m - run_m) if number else 0.0
        if flight.turn_deg:
            begin_m = first * run_m + further_m + float(moved[first])
        depth_m = run_m if number + 1 == stair.flights else stair.each[number + 1].landing_depth_m
        places += [
            (i * run_m + further_m + float(moved[i]) - begin_m, 0.0, 0.0, (depth_m if i == last else run_m) + float(longer_m[i]))
            for i in range(first, last + 1)
        ]
        before_m = run_m
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
