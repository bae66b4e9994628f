"""Plan of one flight and of the landing above it: ``StairFlight -> FlightPlan``. Places are in the flight's frame F."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.scenario.flight import Side

TINY = 1e-9
"""Cosine of a quarter turn, and length of nothing [m], by rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPlan:
    """Plan of one flight and of the landing above it, a rectangle in F: x from the landing's nosing, y to the left."""

    count: int
    """Number of steps, the landing included."""
    slope_rad: float
    """Design slope of the nosing plane, without jitter [rad]."""
    turn_rad: float = 0.0
    """Turn of the next flight, positive to the left; zero straight on and above the last flight."""
    depth_m: float
    """Depth of the landing [m]; a flight that winders end has none."""
    right_m: float
    left_m: float
    """Places of the landing's sides across the flight [m]."""
    walls: tuple[Side, ...] = ()
    """Sides of the landing with a wall."""

    @property
    def side(self) -> float:
        """Side to which the next flight turns: 1 on the left, -1 on the right."""
        return math.copysign(1.0, self.turn_rad)

    def closed(self, side: str, width_m: float) -> list[tuple[float, float]]:
        """Return the parts of a side that the next flight of a width leaves closed: from and to along it, as the landing [m]."""
        across = side == "far"
        low_m, high_m = (self.right_m, self.left_m) if across else (0.0, self.depth_m)
        leaves = math.cos(self.turn_rad) > -TINY if across else self.turn_rad != 0.0 and (self.side > 0.0) == (side == "left")
        first_m, last_m = sorted(self.foot(width_m)[:, int(across)].tolist()) if leaves else (high_m, high_m)
        return [(start, end) for start, end in ((low_m, first_m), (last_m, high_m)) if end - start > TINY]

    def foot(self, width_m: float) -> Float[np.ndarray, "2 2"]:
        """Return the outer and the inner end of the next flight's foot on the landing, in F from the landing's nosing [m].

        Straight on it is in the middle of the far end. Up to 90° it cuts the corner at the far end, so that it is flush with it
        after a quarter turn; above 90° it cuts the corner next to this flight.
        """
        c, s = math.cos(self.turn_rad), abs(math.sin(self.turn_rad))
        aside_m = self.left_m if self.turn_rad > 0.0 else -self.right_m
        if not self.turn_rad:
            ends = [[self.depth_m, -0.5 * width_m], [self.depth_m, 0.5 * width_m]]
        elif c > -TINY:
            ends = [[self.depth_m, aside_m - c * width_m], [self.depth_m - s * width_m, aside_m]]
        else:
            ends = [[s * width_m, aside_m], [0.0, aside_m + c * width_m]]
        return np.array(ends) * (1.0, self.side)
