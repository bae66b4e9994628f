"""Winders: wedge-shaped steps around a newel post, which turn a flight of stairs.

All places are in the plan, relative to the middle of the first winder's nosing: x up the flight, y to the left. The first winder's
nosing is square to the flight below; each next nosing, and the one above the last winder, is turned further by the same angle about
the newel's axis.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Winders:
    """Plan of the winders of one stair."""

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
