"""The staircase in the world: every step, nosing, landing and wall.

Paper: Fig. 3(a) (height h, width w). W: z up, x up the flight, origin on the floor under the first nosing, mid-width.
Several flights go straight on, alike but for their jitter, with a landing between any two; S stays the frame of the first, so that
x along S grows over the landings too: by cos β a metre. Where the flights turn (quarter landings), each has a frame of its own, F:
like W, below its first nosing. Places of steps are then in F, and S belongs to a flight.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG, rotation_y, rotation_z, wrap
from treadline.stair_settings import Friction, Stair, StepOverride
from treadline.step_rules import place_of

TREAD_THICKNESS_M = 0.04
"""Of an open-riser tread."""
WALL_HEIGHT_M = 2.2
STOREY_M = 0.3
"""Height above or below a flight within which a chair may still be on it: more than a pulley and its flipper lift it."""
FLOOR_LENGTH_M = 6.0
"""Of floor before the first step."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One tread and the nosing at its front."""

    index: int
    x_m: float
    """Of the nosing's front at mid-width, along its flight (F)."""
    z_m: float
    """Of the tread."""
    depth_m: float
    """To the next nosing's front, across a landing too."""
    rise_m: float
    """Above the tread (or floor) before."""
    yaw_rad: float
    """Of the nosing about the vertical; zero is square to the flight."""
    missing: bool
    friction: tuple[Friction, Friction]
    """Along and across the belt, on the left half and on the right one."""
    nosing_radius_m: float
    overhang_m: float = 0.0
    """Distance by which the tread stands out over the riser."""
    tread_slope_rad: float = 0.0
    """Positive where the tread rises towards its back."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A solid box: turned about the vertical by ``yaw_rad``, its front lowered by ``pitch_rad``."""

    kind: str
    """``floor``, ``step`` (a tread, with its riser unless it overhangs), ``riser`` (under an overhanging tread), ``landing`` or
    ``wall``."""
    index: int
    """Of the step; -1 for the rest."""
    centre_W: tuple[float, float, float]
    half_m: tuple[float, float, float]
    yaw_rad: float
    pitch_rad: float = 0.0

    @property
    def R_WK(self) -> Float[np.ndarray, "3 3"]:
        """Rotation of the box K in the world."""
        return rotation_z(self.yaw_rad) @ rotation_y(-self.pitch_rad) if self.pitch_rad else rotation_z(self.yaw_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class Staircase:
    """A flight between a floor and a landing, or several with landings between them."""

    steps: tuple[Step, ...]
    """Of all flights, the lowest first."""
    width_m: float
    landing_m: float
    open_risers: bool
    nosing_radius_m: float
    slope_rad: float
    """Of the nosing plane as designed, jitter aside."""
    friction: Friction
    """As designed, along and across; ``steps`` have what each one has."""
    floor_friction: Friction
    walls: str
    end_wall: bool = False
    """Whether a wall stands across the far end of the uppermost landing."""
    flight_count: int = 1
    turn: int = 0
    """Turn at each landing: 1 a quarter to the left, -1 to the right, 0 straight on."""

    @property
    def flights(self) -> tuple[tuple[Step, ...], ...]:
        """The steps of each flight, the lowest first; the uppermost step of each is its landing."""
        each = len(self.steps) // self.flight_count
        return tuple(self.steps[k * each : (k + 1) * each] for k in range(self.flight_count))

    def alone(self, flight: int) -> "Staircase":
        """Return one flight with its landing, as if there were no other: the world is then F."""
        steps = self.flights[flight]
        is_last = steps[-1] is self.steps[-1]
        landing_m = self.landing_m if is_last else steps[-1].depth_m
        return replace(self, steps=steps, landing_m=landing_m, end_wall=self.end_wall and is_last, flight_count=1, turn=0)

    def flight_frame(self, flight: int) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
        """Return rotation and origin of a flight's frame F in the world."""
        R_WF, p_WF = np.eye(3), np.zeros(3)
        if self.turn:
            for landing in (steps[-1] for steps in self.flights[:flight]):
                # The next flight leaves the landing by its side, flush with its far end.
                beyond = np.array([landing.x_m + landing.depth_m - 0.5 * self.width_m, self.turn * 0.5 * self.width_m, 0.0])
                p_WF = p_WF + R_WF @ beyond
                R_WF = np.round(R_WF @ rotation_z(self.turn * 0.5 * math.pi))  # quarters: the entries are whole numbers
        return R_WF, p_WF

    def stair_frame(self, flight: int) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"], float]:
        """Return a flight's S: rotation, origin, and how far along the stair its origin lies, across the landings before."""
        if not self.turn:
            return self.R_WS, self.p_WS, 0.0
        R_WF, p_WF = self.flight_frame(flight)
        first, c, s = self.flights[flight][0], math.cos(self.slope_rad), math.sin(self.slope_rad)
        along_m = sum((steps[-1].x_m + steps[-1].depth_m) * c for steps in self.flights[:flight])
        origin = p_WF + R_WF @ np.array([first.x_m, 0.0, first.z_m])
        return R_WF @ self.R_WS, origin, along_m + (first.z_m - self.steps[0].z_m) * s

    def flight_at(self, p_WB: Float[np.ndarray, " 3"], R_WB: Float[np.ndarray, "3 3"]) -> int:
        """Return the flight that a chair is on; on a landing that of the two to whose course it is turned."""
        if not self.turn:
            return 0
        yaw = math.atan2(R_WB[1, 0], R_WB[0, 0])
        level_m = float(p_WB[2])
        near = [
            k
            for k, steps in enumerate(self.flights)
            if steps[0].z_m - steps[0].rise_m - STOREY_M <= level_m <= steps[-1].z_m + STOREY_M
        ]
        askew = {k: abs(wrap(yaw - k * self.turn * 0.5 * math.pi)) for k in near or range(self.flight_count)}
        return min(askew, key=lambda k: (askew[k], k))

    @property
    def last_nosing_m(self) -> float:
        """Place of the uppermost nosing along the stair (S), from the first one, over the landings."""
        R_WS, p_WS, along_m = self.stair_frame(self.flight_count - 1)
        R_WF, p_WF = self.flight_frame(self.flight_count - 1)
        last = self.steps[-1]
        return along_m + float(R_WS[:, 0] @ (p_WF + R_WF @ np.array([last.x_m, 0.0, last.z_m]) - p_WS))

    @property
    def R_WS(self) -> Float[np.ndarray, "3 3"]:
        """Rotation of the stair's frame: x up the flight in the nosing plane, z its normal."""
        return rotation_y(-self.slope_rad)

    @property
    def p_WS(self) -> Float[np.ndarray, " 3"]:
        """Origin of S: the first nosing."""
        return np.array([self.steps[0].x_m, 0.0, self.steps[0].z_m])

    @property
    def nosings_W(self) -> Float[np.ndarray, "N 3"]:
        """Points on the nosings at mid-width, missing steps left out."""
        if not self.turn:
            return np.array([[step.x_m, 0.0, step.z_m] for step in self.steps if not step.missing])
        frames = [self.flight_frame(k) for k in range(self.flight_count)]
        return np.array(
            [
                p_WF + R_WF @ np.array([step.x_m, 0.0, step.z_m])
                for (R_WF, p_WF), steps in zip(frames, self.flights, strict=True)
                for step in steps
                if not step.missing
            ]
        )

    @property
    def pitch_m(self) -> float:
        """Mean distance between nosings along the first flight, √(h² + w²)."""
        flight = self.flights[0]
        first, last = flight[0], flight[-1]
        return math.hypot(last.x_m - first.x_m, last.z_m - first.z_m) / (len(flight) - 1)

    def boxes(self) -> tuple[Box, ...]:
        """Return the solids with sharp front edges: floor, steps, landing, walls.

        The plant rounds the nosings off; the camera draws them as they are here.
        """
        if self.turn:
            return tuple(
                _placed(box, *self.flight_frame(k))
                for k in range(self.flight_count)
                for box in self.alone(k).boxes()
                if k == 0 or box.kind != "floor"
            )
        last = self.steps[-1]
        end_x = last.x_m + max(self.landing_m, last.depth_m)
        half_width = 0.5 * self.width_m
        solids = [
            Box(
                kind="floor",
                index=-1,
                centre_W=(-0.5 * FLOOR_LENGTH_M, 0.0, -0.1),
                half_m=(0.5 * FLOOR_LENGTH_M + 0.5, half_width + 2.0, 0.1),
                yaw_rad=0.0,
            )
        ]
        landings = {flight[-1].index for flight in self.flights}
        for step, after in zip(self.steps, (*self.steps[1:], None), strict=True):
            if not step.missing:
                back_x = end_x if after is None else step.x_m + step.depth_m + self._under(step, after)
                solids += self._tread(step, back_x, "landing" if step.index in landings else "step")
        solids += [wall for flight in self.flights for wall in self._walls(flight)]
        if self.end_wall:
            half_height = 0.5 * WALL_HEIGHT_M
            wall_W = (end_x + 0.05, 0.0, last.z_m + half_height)
            solids.append(Box(kind="wall", index=-1, centre_W=wall_W, half_m=(0.05, half_width, half_height), yaw_rad=0.0))
        return tuple(solids)

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

    def _under(self, step: Step, after: Step) -> float:
        """Return how far a tread reaches under the next step, so that a turned nosing leaves no gap."""
        if self.open_risers:
            return 0.03
        turned_m = 0.5 * self.width_m * abs(math.tan(after.yaw_rad) - math.tan(step.yaw_rad))
        return max(0.10, turned_m + 0.01) + after.overhang_m

    def _tread(self, step: Step, back_x: float, kind: str) -> list[Box]:
        """Return a step's box, or a slab and the riser below it where the tread overhangs."""
        whole_m, half_width = step.rise_m + 0.10, 0.5 * self.width_m
        if self.open_risers:
            return [_behind_nosing(step, kind, half_width, back_x, 0.0, (0.0, TREAD_THICKNESS_M))]
        if step.overhang_m == 0.0:
            return [_behind_nosing(step, kind, half_width, back_x, 0.0, (0.0, whole_m))]
        slab_m = max(TREAD_THICKNESS_M, 2.0 * step.nosing_radius_m)
        slab = _behind_nosing(step, kind, half_width, back_x, 0.0, (0.0, slab_m))
        return [slab, _behind_nosing(step, "riser", half_width, back_x, step.overhang_m, (slab_m, max(whole_m, slab_m + 0.01)))]

    def _walls(self, flight: tuple[Step, ...]) -> list[Box]:
        """Return the walls beside a flight alone: floor and landings are rooms in which a chair can turn."""
        first, last = flight[0], flight[-1]
        return [
            Box(
                kind="wall",
                index=-1,
                centre_W=(0.5 * (first.x_m + last.x_m), sign * (0.5 * self.width_m + 0.05), 0.5 * last.z_m + 0.5),
                half_m=(0.5 * (last.x_m - first.x_m), 0.05, 0.5 * last.z_m + 0.5 + WALL_HEIGHT_M),
                yaw_rad=0.0,
            )
            for side, sign in (("left", 1.0), ("right", -1.0))
            if self.walls in (side, "both")
        ]


def _placed(box: Box, R_WF: Float[np.ndarray, "3 3"], p_WF: Float[np.ndarray, " 3"]) -> Box:
    """Return a box of one flight in the world."""
    x, y, z = p_WF + R_WF @ np.array(box.centre_W)
    yaw_rad = box.yaw_rad + math.atan2(R_WF[1, 0], R_WF[0, 0])
    return replace(box, centre_W=(float(x), float(y), float(z)), yaw_rad=yaw_rad)


def _behind_nosing(step: Step, kind: str, half_width: float, back_x: float, front_m: float, depths_m: tuple[float, float]) -> Box:
    """Return a box between two depths below a tread, from ``front_m`` behind the nosing to ``back_x``."""
    c, s = math.cos(step.tread_slope_rad), math.sin(step.tread_slope_rad)
    upper_m, lower_m = depths_m
    half_depth, half_height = 0.5 * (back_x - step.x_m - front_m), 0.5 * (lower_m - upper_m)
    along, below = front_m + half_depth, upper_m + half_height
    forward = along * c + below * s
    return Box(
        kind=kind,
        index=step.index,
        centre_W=(
            step.x_m + forward * math.cos(step.yaw_rad),
            forward * math.sin(step.yaw_rad),
            step.z_m + along * s - below * c,
        ),
        half_m=(half_depth, half_width, half_height),
        yaw_rad=step.yaw_rad,
        pitch_rad=step.tread_slope_rad,
    )


def build_staircase(stair: Stair, rng: np.random.Generator, overrides: Sequence[StepOverride] = ()) -> Staircase:
    """Return the staircase a scenario asks for; jitter is drawn from ``rng``.

    Args:
        overrides: Steps that differ; what one says replaces design and jitter.
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
    longer[stair.steps - 1 :: stair.steps] = 0.0  # a landing's depth is one of the stair's own
    heights, moved = np.cumsum(rises), np.cumsum(longer) - longer
    further_m = stair.between_m - stair.run_m
    left, right = stair.halves
    turn = {"none": 0, "left": 1, "right": -1}[stair.turn]
    first = np.arange(0, count, stair.steps)
    begins = first * stair.run_m + np.arange(stair.flights) * further_m + moved[first] if turn else np.zeros(stair.flights)
    steps = tuple(
        Step(
            index=i,
            x_m=i * stair.run_m + i // stair.steps * further_m + float(moved[i]) - begins[i // stair.steps],
            z_m=float(heights[i]),
            depth_m=(stair.between_m if stair.is_landing(i) and i + 1 < count else stair.run_m) + float(longer[i]),
            rise_m=float(rises[i]),
            yaw_rad=float(yaws[i]),
            missing=i in stair.missing_steps,
            friction=(keys.get("friction_left", left), keys.get("friction_right", right)),
            nosing_radius_m=keys.get("nosing_radius_m", stair.nosing_radius_m),
            overhang_m=keys.get("overhang_m", 0.0),
            tread_slope_rad=keys.get("tread_slope_deg", 0.0) * DEG,
        )
        for i, keys in ((i, own.get(i, {})) for i in range(count))
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
        flight_count=stair.flights,
        turn=turn,
    )


def as_designed(stair: Stair, overrides: Sequence[StepOverride] = ()) -> Staircase:
    """Return the staircase without jitter: what is known before it is built."""
    level = {"rise_jitter_m": 0.0, "run_jitter_m": 0.0, "nosing_yaw_jitter_deg": 0.0}
    return build_staircase(stair.model_copy(update=level), np.random.default_rng(0), overrides)


def _by_step(stair: Stair, overrides: Sequence[StepOverride]) -> dict[int, dict[str, Any]]:
    """Return what is given of each step, by its index; ``friction`` stands for both halves."""
    found: dict[int, dict[str, Any]] = {}
    for override in overrides:
        keys = {key: value for key, value in override.model_dump(exclude={"index"}).items() if value is not None}
        if "friction" in keys:
            keys["friction_left"] = keys["friction_right"] = keys.pop("friction")
        found.setdefault(place_of(stair, override), {}).update(keys)
    return found
