"""The staircase in the world: every step, nosing, landing and wall.

Paper: Fig. 3(a) (height h, width w). W: z up, x up the flight, origin on the floor under the first nosing, mid-width.
Several flights go straight on, alike but for their jitter, with a landing between any two; S stays the frame of the first, so that
x along S grows over the landings too: by cos β a metre.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG, rotation_y
from treadline.scenario import Stair

TREAD_THICKNESS_M = 0.04
"""Of an open-riser tread."""
WALL_HEIGHT_M = 2.2
FLOOR_LENGTH_M = 6.0
"""Of floor before the first step."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One tread and the nosing at its front."""

    index: int
    x_m: float
    """Of the nosing's front at mid-width."""
    z_m: float
    """Of the tread."""
    depth_m: float
    """To the next nosing's front, across a landing too."""
    rise_m: float
    """Above the tread (or floor) before."""
    yaw_rad: float
    """Of the nosing about the vertical; zero is square to the flight."""
    missing: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A solid box: upright, turned about the vertical by ``yaw_rad``."""

    kind: str
    """``floor``, ``step``, ``landing`` or ``wall``."""
    index: int
    """Of the step; -1 for the rest."""
    centre_W: tuple[float, float, float]
    half_m: tuple[float, float, float]
    yaw_rad: float


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
    friction: tuple[float, float]
    walls: str
    flight_count: int = 1

    @property
    def flights(self) -> tuple[tuple[Step, ...], ...]:
        """The steps of each flight, the lowest first; the uppermost step of each is its landing."""
        each = len(self.steps) // self.flight_count
        return tuple(self.steps[k * each : (k + 1) * each] for k in range(self.flight_count))

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
        return np.array([[step.x_m, 0.0, step.z_m] for step in self.steps if not step.missing])

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
        for step in self.steps:
            if step.missing:
                continue
            is_last = step is last
            # Treads reach under the next step, so that a turned nosing leaves no gap; the last one is the landing.
            back_x = end_x if is_last else step.x_m + step.depth_m + (0.03 if self.open_risers else 0.10)
            thickness = TREAD_THICKNESS_M if self.open_risers else step.rise_m + 0.10
            half_depth = 0.5 * (back_x - step.x_m)
            solids.append(
                Box(
                    kind="landing" if step.index in landings else "step",
                    index=step.index,
                    centre_W=(
                        step.x_m + half_depth * math.cos(step.yaw_rad),
                        half_depth * math.sin(step.yaw_rad),
                        step.z_m - 0.5 * thickness,
                    ),
                    half_m=(half_depth, half_width, 0.5 * thickness),
                    yaw_rad=step.yaw_rad,
                )
            )
        return tuple(solids) + tuple(wall for flight in self.flights for wall in self._walls(flight))

    @property
    def surfaces(self) -> Float[np.ndarray, "N 7"]:
        """Flat tops of floor, treads and landings: centre x, y, cosine and sine of the yaw, half length, half width, height."""
        return np.array(
            [
                (x, y, math.cos(box.yaw_rad), math.sin(box.yaw_rad), *box.half_m[:2], z + box.half_m[2])
                for box in self.boxes()
                if box.kind != "wall"
                for x, y, z in [box.centre_W]
            ]
        )

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


def build_staircase(stair: Stair, rng: np.random.Generator) -> Staircase:
    """Return the staircase a scenario asks for; jitter is drawn from ``rng``."""
    count = stair.flights * stair.steps
    rises = stair.rise_m + stair.rise_jitter_m * rng.standard_normal(count)
    yaws = stair.nosing_yaw_jitter_deg * DEG * rng.standard_normal(count)
    heights = np.cumsum(rises)
    further_m = stair.between_m - stair.run_m
    steps = tuple(
        Step(
            index=i,
            x_m=i * stair.run_m + i // stair.steps * further_m,
            z_m=float(heights[i]),
            depth_m=stair.between_m if (i + 1) % stair.steps == 0 and i + 1 < count else stair.run_m,
            rise_m=float(rises[i]),
            yaw_rad=float(yaws[i]),
            missing=i in stair.missing_steps,
        )
        for i in range(count)
    )
    return Staircase(
        steps=steps,
        width_m=stair.width_m,
        landing_m=stair.landing_m,
        open_risers=stair.open_risers,
        nosing_radius_m=stair.nosing_radius_m,
        slope_rad=stair.slope_rad,
        friction=stair.friction,
        walls=stair.walls,
        flight_count=stair.flights,
    )
