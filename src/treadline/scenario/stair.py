"""The ``[stair]`` and ``[[step]]`` tables of a scenario file, typed and checked.

Rules that join several tables: ``Stair, StepOverrides -> the first problem, in one line``, or None.
"""

import math
from bisect import bisect_left
from collections.abc import Sequence
from itertools import accumulate
from typing import Annotated, ClassVar, Literal, TypeGuard

from pydantic import Field, PrivateAttr, model_validator

from treadline.core.angles import DEG
from treadline.core.settings import Pairs, Settings
from treadline.scenario.flight import RISE_M, RUN_M, LandingDepth, Rise, Run, StairFlight, StepCount

SLOPE_DEG = (5.0, 45.0)
"""Bounds of a staircase's slope."""
TURN_DEG = {"none": 0.0, "left": 90.0, "right": -90.0}
"""Turn of each next flight by its name."""
TURNING_FLIGHTS = 4
"""Largest number of flights with quarter landings: after four quarters a fifth would lie above the first."""
WINDER_DEG = 45.0
"""Largest turn by one winder: two winders to a quarter are the least in use."""
LEAST_SIDE_DEPTH_M = 0.02
"""Least depth of a tread at its narrow side: nosings that meet leave no tread between them."""
FrictionCoefficient = Annotated[float, Field(gt=0.0, le=2.0)]
Friction = tuple[FrictionCoefficient, FrictionCoefficient]


class Stair(Settings):
    """The staircase: ``rise_m`` and ``run_m``, or ``slope_deg`` with ``run_m``.

    The slope is another way to write the rise: it is converted as the file is read, and is not kept, nor is the run of a single
    step. Several flights are alike, with a landing between any two; ``[[flight]]`` tables give flights and landings of their own.
    """

    alternatives: ClassVar[Pairs] = (("rise_m", "slope_deg"),)

    rise_m: Rise = 0.16
    """Height of a step."""
    run_m: Run = 0.30
    """Depth of a step, from nosing to nosing. A stair of one step has none: its value is then the default."""
    slope_deg: Annotated[float, Field(ge=SLOPE_DEG[0], le=SLOPE_DEG[1])] | None = Field(default=None, exclude=True)
    """Slope of the flight, in place of ``rise_m``."""
    steps: StepCount = 20
    """Number of steps of each flight; the uppermost is its landing. One step is a kerb, a threshold or a dock, ``rise_m`` high."""
    flights: Annotated[int, Field(ge=1, le=20)] = 1
    between_m: LandingDepth = 2.5
    """Depth of the landing between two flights, from the nosing of one to the first nosing of the next."""
    turn: Literal["none", "left", "right"] = "none"
    """Direction of each next flight: straight on, or a quarter turn to one side (quarter landings)."""
    winders: Annotated[int, Field(ge=0, le=12)] = 0
    """Number of winders: wedge-shaped steps around a newel, which turn the flight. They are among ``steps``."""
    winder_first: Annotated[int, Field(ge=0)] | None = None
    """Index of the first winder, counted from the floor, from 0; unset: the winders lead up to the landing."""
    winder_to: Literal["left", "right"] = "left"
    """Way the winders turn the flight."""
    # Beyond 180° the flight above would lie over the flight below.
    winder_turn_deg: Annotated[float, Field(ge=10.0, le=180.0)] = 90.0
    """Turn of the flight by all winders together."""
    # Walls of the two flights, 0.10 m thick, fit between them after half a turn.
    newel_m: Annotated[float, Field(ge=0.05, le=0.5)] = 0.1
    """Radius of the newel around which the winders turn."""
    width_m: Annotated[float, Field(ge=0.8, le=60.0)] = 1.2
    landing_m: Annotated[float, Field(ge=0.0, le=20.0)] = 1.5
    """Depth of the landing above the last flight."""
    end_wall: bool = False
    """Whether a wall stands across the far end of that landing."""
    open_risers: bool = False
    """Whether the stair has treads without risers."""
    nosing_radius_m: Annotated[float, Field(ge=0.002, le=0.03)] = 0.01
    overhang_m: Annotated[float, Field(ge=0.0, le=0.10)] = 0.0
    """Distance by which each tread stands out over its riser."""
    side_slope_deg: Annotated[float, Field(ge=-5.0, le=5.0)] = 0.0
    """Fall of floor, treads and landings to the right, seen by a chair that faces up; MuJoCo only."""
    rise_jitter_m: Annotated[float, Field(ge=0.0, le=0.03)] = 0.0
    """Standard deviation of a step's height."""
    run_jitter_m: Annotated[float, Field(ge=0.0, le=0.03)] = 0.0
    """Standard deviation of a step's depth."""
    nosing_yaw_jitter_deg: Annotated[float, Field(ge=0.0, le=5.0)] = 0.0
    """Standard deviation of a nosing's turn about the vertical."""
    friction: Friction = (0.62, 0.5)
    """Friction coefficients along the belt and across it."""
    friction_left: Friction | None = None
    """Friction on the left half of every step, along and across; unset: friction."""
    friction_right: Friction | None = None
    """Friction on the right half of every step, along and across; unset: friction."""
    floor_friction: Friction | None = None
    """Friction of the floor before the first step, along and across; unset: friction."""
    missing_steps: tuple[Annotated[int, Field(ge=0)], ...] = ()
    """Indices of missing steps, counted from the floor over all flights, from 0."""
    texture: Literal["wood", "concrete", "carpet", "terrazzo", "dark"] = "wood"
    """Material in the camera's picture."""
    walls: Literal["none", "left", "right", "both"] = "left"
    light: Annotated[float, Field(ge=0.35, le=1.6)] = 1.0
    """Gain of the light: 1 as usual, less is darker."""
    _own: tuple[StairFlight, ...] = PrivateAttr(default=())
    """Flights of ``[[flight]]`` tables."""

    @model_validator(mode="before")
    @classmethod
    def _as_kept(cls, tables: object) -> object:
        """Convert ``slope_deg`` to a rise, so that only one of the two is kept, and leave out the run of a single step."""
        if not isinstance(tables, dict):
            return tables
        run = tables.get("run_m", cls.model_fields["run_m"].default)
        if not _within(RUN_M, run):
            return tables  # the field's own check says what is wrong with it
        kept = {key: value for key, value in tables.items() if key != "run_m" or tables.get("steps") != 1}
        slope = kept.get("slope_deg", math.nan)
        if "rise_m" in tables or not _within(SLOPE_DEG, slope):
            return kept  # both together are refused as alternatives
        rise = run * math.tan(math.radians(slope))
        if not _within(RISE_M, rise):
            raise ValueError(
                f"slope_deg = {slope:g} with run_m = {run:g} is a rise of {rise:.3f} m; it must be from "
                f"{RISE_M[0]:g} to {RISE_M[1]:g} m"
            )
        del kept["slope_deg"]
        return kept | {"rise_m": rise}

    @model_validator(mode="after")
    def _steps_exist(self) -> "Stair":
        count = self.count
        beyond = [index for index in self.missing_steps if index >= count or self.is_landing(index)]
        if beyond and self.steps == 1:
            raise ValueError(f"missing_steps names step {beyond[0]}, and with steps = 1 every step is a landing; remove it")
        if beyond and self.flights == 1:
            raise ValueError(
                f"missing_steps names step {beyond[0]} of a flight of {self.steps} steps; the last that can be missing "
                f"is {self.steps - 2}, for the one above it is the landing"
            )
        if beyond:
            raise ValueError(
                f"missing_steps names step {beyond[0]} of {self.flights} flights of {self.steps} steps, counted over all from the "
                f"floor; it must be below {count - 1} and no flight's uppermost, for that is its landing"
            )
        if self.overhang_m and self.open_risers:
            raise ValueError(_hangs_over_nothing(self.overhang_m))
        return self

    @model_validator(mode="after")
    def _landings_can_turn(self) -> "Stair":
        if self.turn == "none":
            return self
        if not 2 <= self.flights <= TURNING_FLIGHTS:
            raise ValueError(
                f"turn is '{self.turn}' with {self.flights} flights; give 2 to {TURNING_FLIGHTS}: they turn at the landings "
                "between flights, and a fifth would lie above the first"
            )
        if self.between_m < self.width_m:
            raise ValueError(
                f"turn is '{self.turn}' and between_m = {self.between_m:g}; a quarter landing must be at least as deep as the next "
                f"flight is wide, width_m = {self.width_m:g}"
            )
        return self

    @model_validator(mode="after")
    def _winders_fit(self) -> "Stair":
        if not self.winders:
            return self
        step_deg = self.winder_turn_deg / self.winders
        inner_m = 2.0 * self.newel_m * math.sin(0.5 * math.radians(step_deg))
        if self.flights > 1:
            raise ValueError(
                f"winders is {self.winders} with {self.flights} flights; a stair has winders or landings: give flights = 1"
            )
        if self.open_risers:
            raise ValueError(
                f"winders is {self.winders} with open_risers; the box of a winder reaches under the next steps, which open risers "
                "would show: leave one of the two out"
            )
        if self.steps < 3:
            raise ValueError(
                f"winders is {self.winders} of {self.steps} steps; at least two must be straight: give 3 steps or more"
            )
        if self.winders > self.steps - 2:
            raise ValueError(
                f"winders is {self.winders} of {self.steps} steps; at least two must be straight, the landing among them: give at "
                f"most {self.steps - 2} winders or more steps"
            )
        if self.first_winder > self.steps - 1 - self.winders:
            raise ValueError(
                f"winder_first is {self.winder_first} with {self.winders} winders of {self.steps} steps; the step above the last "
                f"winder must exist: give one from 0 to {self.steps - 1 - self.winders}"
            )
        if step_deg > WINDER_DEG:
            least = math.ceil(self.winder_turn_deg / WINDER_DEG)
            raise ValueError(
                f"winder_turn_deg is {self.winder_turn_deg:g} with {self.winders} winders, {step_deg:g}° each; a winder turns by "
                f"at most {WINDER_DEG:g}°: give at least {least} winders"
            )
        if inner_m < LEAST_SIDE_DEPTH_M:
            raise ValueError(
                f"newel_m is {self.newel_m:g}, so each winder is {inner_m:.3f} m deep at the newel; it must be at least "
                f"{LEAST_SIDE_DEPTH_M:g} m: give a larger newel_m or fewer winders"
            )
        return self

    @property
    def first_winder(self) -> int:
        """Index of the first winder, where there are winders."""
        return self.steps - 1 - self.winders if self.winder_first is None else self.winder_first

    def is_winder(self, index: int) -> bool:
        """Return whether a step is a winder."""
        return bool(self.winders) and self.first_winder <= index < self.first_winder + self.winders

    def with_flights(self, flights: tuple[StairFlight, ...]) -> "Stair":
        """Return the stair with the flights of ``[[flight]]`` tables; ``steps`` is then the number of the lowest flight's."""
        if not flights:
            return self
        stair = self.model_copy(update={"steps": flights[0].steps, "flights": len(flights)})
        stair._own = flights  # noqa: SLF001 - its own copy
        return stair

    @property
    def each(self) -> tuple[StairFlight, ...]:
        """Flights, the lowest first."""
        next_one = StairFlight(steps=self.steps, turn_deg=TURN_DEG[self.turn], landing_depth_m=self.between_m)
        return self._own or (StairFlight(steps=self.steps), *[next_one] * (self.flights - 1))

    @property
    def sizes_m(self) -> tuple[tuple[float, float], ...]:
        """Rise and run of a step of each flight [m]."""
        return tuple((flight.rise_m or self.rise_m, flight.run_m or self.run_m) for flight in self.each)

    @property
    def landings(self) -> tuple[int, ...]:
        """Index of the uppermost step of each flight."""
        return tuple(end - 1 for end in accumulate(flight.steps for flight in self.each))

    @property
    def slope_rad(self) -> float:
        """Angle of the nosing plane."""
        return math.atan2(self.rise_m, self.run_m)

    @property
    def count(self) -> int:
        """Number of steps of all flights."""
        return self.landings[-1] + 1

    @property
    def halves(self) -> tuple[Friction, Friction]:
        """Friction on the left and on the right half of the steps."""
        return self.friction_left or self.friction, self.friction_right or self.friction

    @property
    def mean_friction(self) -> Friction:
        """Mean friction under the two belts of a chair in the middle."""
        (left_along, left_across), (right_along, right_across) = self.halves
        return 0.5 * (left_along + right_along), 0.5 * (left_across + right_across)

    def is_landing(self, index: int) -> bool:
        """Return whether a step is the uppermost of its flight."""
        return index in self.landings

    def flight_of(self, index: int) -> int:
        """Return the number of the flight to which a step belongs."""
        return bisect_left(self.landings, index)


def _within(limits: tuple[float, float], value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and limits[0] <= value <= limits[1]


class StepOverride(Settings):
    """One step that differs from the others; a value that is not given is the stair's."""

    alternatives: ClassVar[Pairs] = (("friction", "friction_left"), ("friction", "friction_right"))

    index: int
    """Index of the step: 0 is the first above the floor, counted over all flights; -1 is the uppermost, the landing."""
    # Bounds of rise and run: from a lip to a mounting block, and from a narrow tread to a podium.
    rise_m: Annotated[float, Field(ge=0.005, le=0.35)] | None = None
    """Height of its nosing above the one before; all that is above moves along."""
    run_m: Annotated[float, Field(ge=0.10, le=1.5)] | None = None
    """Depth from its nosing to the next one."""
    yaw_deg: Annotated[float, Field(ge=-30.0, le=30.0)] | None = None
    """Turn of its nosing about the vertical, positive anticlockwise seen from above."""
    friction: Friction | None = None
    """Friction along the belt and across it, on the whole step."""
    friction_left: Friction | None = None
    """Friction on its left half, along and across."""
    friction_right: Friction | None = None
    """Friction on its right half, along and across."""
    # At most three times the overhang of usual timber treads, 30 to 40 mm.
    overhang_m: Annotated[float, Field(ge=0.0, le=0.10)] | None = None
    """Distance by which its tread stands out over its riser."""
    nosing_radius_m: Annotated[float, Field(ge=0.002, le=0.03)] | None = None
    """Radius of its rounded front edge; 30 mm is badly worn."""
    tread_slope_deg: Annotated[float, Field(ge=-5.0, le=5.0)] | None = None
    """Slope of its tread, positive where the back is higher than the nosing, so that water runs off the front."""


def flight_problem(stair: Stair, flights: Sequence[StairFlight]) -> str | None:
    """Return why the flights of ``[[flight]]`` tables cannot be built, or None."""
    if not flights:
        return None
    if stair.winders:
        return f"flight.0: stair.winders is {stair.winders}; a stair has winders or flights of its own: remove one of the two"
    if "steps" in stair.model_fields_set and stair.steps != flights[0].steps:
        return f"flight.0: steps is {flights[0].steps}, and stair.steps is {stair.steps}; leave stair.steps out"
    if flights[0].turn_deg:
        return f"flight.0: turn_deg is {flights[0].turn_deg:g}, and it rises from the floor; remove it"
    for number, flight in enumerate(flights[1:], start=1):
        least, own = flight.least_landing_m(stair.width_m), (flight.width_of_landing_m(stair.width_m), flight.landing_depth_m)
        for name, least_m, own_m in zip(("landing_width_m", "landing_depth_m"), least, own, strict=True):
            if own_m < least_m - 1e-9:  # rounding
                return (
                    f"flight.{number}: {name} is {own_m:g}; a flight {stair.width_m:g} m wide that turns by {flight.turn_deg:g}° "
                    f"needs {least_m:.2f} m"
                )
    return None


def step_problem(stair: Stair, overrides: Sequence[StepOverride]) -> str | None:
    """Return why a staircase cannot be built, or None."""
    for check in (_outside, _given_twice, _landing_depth, _shape_of_winder, _overhang, _steep_tread):
        for number, override in enumerate(overrides):
            problem = check(stair, overrides, number, place_of(stair, override))
            if problem is not None:
                return f"step.{number}: {problem}"
    return _crossing_nosings(stair, overrides)


def place_of(stair: Stair, override: StepOverride) -> int:
    """Return the index of a step from the floor; negative ones count from the top."""
    return override.index % stair.count if -stair.count <= override.index < stair.count else override.index


def _value_at(stair: Stair, overrides: Sequence[StepOverride], key: str, index: int, usual: float) -> float:
    """Return a step's value: its override, or the usual value."""
    for override in overrides:
        if place_of(stair, override) == index and getattr(override, key) is not None:
            return float(getattr(override, key))
    return usual


def run_of(stair: Stair, overrides: Sequence[StepOverride], index: int) -> float:
    """Return the depth of a step to the next nosing, across a landing too."""
    number = stair.flight_of(index)
    run_m = stair.sizes_m[number][1]
    if index == stair.count - 1:
        return max(stair.landing_m, run_m)
    usual_m = stair.each[number + 1].landing_depth_m if stair.is_landing(index) else run_m
    return _value_at(stair, overrides, "run_m", index, usual_m)


def _outside(stair: Stair, overrides: Sequence[StepOverride], number: int, _index: int) -> str | None:
    index = overrides[number].index
    if -stair.count <= index < stair.count:
        return None
    return f"index is {index}, the stair has {stair.count} steps; give one from {-stair.count} (from the top) to {stair.count - 1}"


def _given_twice(stair: Stair, overrides: Sequence[StepOverride], number: int, index: int) -> str | None:
    same = {(key, key) for key in StepOverride.model_fields if key != "index"} | set(StepOverride.alternatives)
    for other, earlier in enumerate(overrides[:number]):
        for key, before in sorted(same | {(two, one) for one, two in same}):
            both = getattr(overrides[number], key) is not None and getattr(earlier, before) is not None
            if both and place_of(stair, earlier) == index:
                return f"{key} of step {index} is given by step.{other} already ({before}); remove one"
    return None


def _landing_depth(stair: Stair, overrides: Sequence[StepOverride], number: int, index: int) -> str | None:
    run_m = overrides[number].run_m
    if run_m is None or not stair.is_landing(index):
        return None
    name = "landing_m" if index == stair.count - 1 else "between_m"
    return f"run_m is {run_m:g}, but step {index} is a landing; its depth is stair.{name}"


def _shape_of_winder(stair: Stair, overrides: Sequence[StepOverride], number: int, index: int) -> str | None:
    """Return why an override would change the plan of a winder."""
    for key in ("run_m", "yaw_deg", "tread_slope_deg"):
        value = getattr(overrides[number], key)
        if value is not None and stair.is_winder(index):
            return f"{key} is {value:g}, but step {index} is a winder: stair.winders shapes it; remove it"
        if value is not None and key == "yaw_deg" and index > 0 and stair.is_winder(index - 1):
            return f"yaw_deg is {value:g}, but the nosing of step {index} ends the last winder; remove it"
    return None


def _overhang(stair: Stair, overrides: Sequence[StepOverride], number: int, index: int) -> str | None:
    overhang_m, run_m = overrides[number].overhang_m, run_of(stair, overrides, index)
    if overhang_m and stair.open_risers:
        return _hangs_over_nothing(overhang_m)
    if overhang_m and overhang_m >= run_m:
        return f"overhang_m is {overhang_m:g}; it must be below the run of {run_m:g} m, for the riser stands under the tread"
    return None


def _hangs_over_nothing(overhang_m: float) -> str:
    return f"overhang_m is {overhang_m:g}, but stair.open_risers leaves no riser to hang over"


def _steep_tread(stair: Stair, overrides: Sequence[StepOverride], number: int, index: int) -> str | None:
    """Return why the back of a tread would rise above the next nosing."""
    slope_deg = overrides[number].tread_slope_deg
    if not slope_deg or index == stair.count - 1:
        return None
    climb_m = run_of(stair, overrides, index) * math.tan(slope_deg * DEG)
    rise_m = _value_at(stair, overrides, "rise_m", index + 1, stair.sizes_m[stair.flight_of(index + 1)][0])
    if climb_m < rise_m:
        return None
    higher = f"the next nosing is only {rise_m:g} m higher"
    return f"tread_slope_deg is {slope_deg:g}, so the tread rises {climb_m:.3f} m to its back; {higher}"


def _crossing_nosings(stair: Stair, overrides: Sequence[StepOverride]) -> str | None:
    """Return where turned nosings meet within the stair's width."""
    turned = {place_of(stair, override) for override in overrides if override.yaw_deg is not None}
    for index in sorted({*turned, *(turn - 1 for turn in turned)}):
        if not 0 <= index < stair.count - 1:
            continue
        before, after = (math.tan(_value_at(stair, overrides, "yaw_deg", i, 0.0) * DEG) for i in (index, index + 1))
        depth_m = run_of(stair, overrides, index) - 0.5 * stair.width_m * abs(after - before)
        if depth_m < LEAST_SIDE_DEPTH_M:
            return (
                f"step: between the nosings of steps {index} and {index + 1} the tread is {depth_m:.3f} m deep at its narrow side; "
                f"it must be at least {LEAST_SIDE_DEPTH_M:g} m: give a larger run_m, a smaller yaw_deg or a narrower stair"
            )
    return None
