"""The ``[[flight]]`` tables of a scenario file: flights with steps of their own, and the landing at the foot of each.

A landing is a rectangle in front of the flight below. The next flight goes on straight, or leaves at an angle over the corner at
the far end; by more than 90° it leaves over the corner next to the flight below, so that after a half turn it rises next to it.
"""

import math
from typing import Annotated, Literal

from pydantic import Field

from treadline.core.angles import DEG
from treadline.core.settings import Settings

RISE_M, RUN_M = (0.01, 0.30), (0.15, 1.00)
"""Bounds of a staircase's rise and run: from a threshold, whose run means nothing, to a dock."""
Side = Literal["left", "right", "far"]
"""Side of a landing, seen from the flight below."""
StepCount = Annotated[int, Field(ge=1, le=2000)]
Rise = Annotated[float, Field(ge=RISE_M[0], le=RISE_M[1])]
Run = Annotated[float, Field(ge=RUN_M[0], le=RUN_M[1])]
LandingDepth = Annotated[float, Field(ge=0.5, le=20.0)]


class StairFlight(Settings):
    """One flight of several, the lowest first, and the landing at its foot."""

    steps: StepCount
    """Number of steps; the uppermost is the flight's landing."""
    rise_m: Rise | None = None
    """Height of a step. Unset: stair.rise_m."""
    run_m: Run | None = None
    """Depth of a step. Unset: stair.run_m."""
    turn_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 0.0
    """Turn at its foot against the flight below, positive to the left: 90 on a quarter landing, 180 on a half landing."""
    landing_depth_m: LandingDepth = 2.5
    """Depth of the landing at its foot, from the nosing of the flight below."""
    landing_width_m: Annotated[float, Field(ge=0.8, le=60.0)] | None = None
    """Width of that landing, from the outer side of the flight below to the side to which the stair turns. Unset: the least."""
    landing_walls: tuple[Side, ...] = ()
    """Sides of that landing with a wall; the others drop."""

    def least_landing_m(self, width_m: float) -> tuple[float, float]:
        """Return width and depth of the least landing on which a flight of a width leaves by its turn [m]."""
        turn_rad = abs(self.turn_deg) * DEG
        return width_m * max(1.0, 1.0 - math.cos(turn_rad)), width_m * math.sin(turn_rad)

    def width_of_landing_m(self, width_m: float) -> float:
        """Return the width of its landing [m] on a stair of a width."""
        return self.least_landing_m(width_m)[0] if self.landing_width_m is None else self.landing_width_m
