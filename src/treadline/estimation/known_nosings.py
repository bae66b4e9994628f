"""Known nosings relative to the chair at one instant: what flipper, crest and edge need of the stair tracker.

``StairTracker -> KnownNosings``. Heights are above the belts' line. The belts lie on the nosing that stands highest above that line
under the flat run, which is therefore their zero: errors that all nosings have in common do not count.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

SIGMAS = 3.0
"""Standard deviations beyond which a nosing counts as off the line of its neighbours: one in 370 that are on it."""
FALLS_RAD = math.radians(2.0)
"""Angle that a chair may fall freely onto the next nosing [rad]: 2.4 m/s² at the passenger, in proportion to 3 m/s² from 2.5°."""
SHORT = 0.25
"""Share of the flipper's length from its axis on which a nosing lies under the front pulley rather than the flipper."""


class KnownNosing(NamedTuple):
    """One nosing in the chair's middle plane."""

    ahead_m: float
    """Distance ahead of mid-track along the belts [m], negative behind."""
    above_m: float
    """Height above the belts' line [m]."""
    sigma_m: float
    """Standard deviation of that height against the nosing that bears [m]."""


@dataclass(frozen=True, slots=True)
class KnownNosings:
    """Known nosings of one flight, the lowest first and at least one, and the chair's pitch."""

    pitch_rad: float
    nosings: tuple[KnownNosing, ...]
    rise_m: float = 0.0
    """Rise of the flight [m]: below a single step the floor."""

    @property
    def top(self) -> KnownNosing:
        """Uppermost nosing: the landing's edge."""
        return self.nosings[-1]

    @property
    def crossed(self) -> KnownNosing:
        """Nosing about which the chair turns at the landing's edge: the uppermost on which its belts lie at this pitch.

        Below a low last step the chair lies on the nosings before, and turns about the uppermost of those until it lies on the
        landing's edge.
        """
        if len(self.nosings) < 3:
            return self.top
        (high_rad, sigma_rad), (low_rad, _) = self.slope(0), self.slope(1)
        lies_below = min(low_rad, self.pitch_rad) - high_rad > max(SIGMAS * sigma_rad, FALLS_RAD)
        return self.nosings[-2] if lies_below else self.top

    @property
    def landing_m(self) -> float:
        """Height of the landing above the crossed nosing [m]."""
        return self._below_m(self.crossed)

    def _below_m(self, nosing: KnownNosing) -> float:
        """Return the height of the landing above a nosing [m]."""
        along_m, above_m = self.top.ahead_m - nosing.ahead_m, self.top.above_m - nosing.above_m
        return along_m * math.sin(self.pitch_rad) + above_m * math.cos(self.pitch_rad)

    @property
    def steepest(self) -> tuple[float, float]:
        """Larger slope of the two uppermost pairs of nosings and its standard deviation [rad]; zero with a single nosing."""
        return max((self.slope(below) for below in range(min(len(self.nosings) - 1, 2))), default=(0.0, 0.0))

    def lies(self, half_m: float, ahead_m: float, radius_m: float) -> tuple[float, float]:
        """Return the pitch at which the belts lie on the landing's edge and what is behind it, and its standard deviation [rad].

        That is the slope of the uppermost nosings, or less where the rear pulley stands on the floor.

        Args:
            half_m: Half of the flat run.
            ahead_m: Distance of the edge ahead of mid-track.
            radius_m: Radius of the rear pulley, with the belt.
        """
        height_m = self._below_m(self.nosings[0]) + self.rise_m
        behind_m = half_m + max(ahead_m, 0.0)
        # On the floor the pulley's axis is at its radius: behind sin(pitch) - radius cos(pitch) = height - radius.
        share = (height_m - radius_m) / math.hypot(behind_m, radius_m)
        floor_rad = math.asin(share) + math.atan2(radius_m, behind_m) if share < 1.0 else 0.5 * math.pi
        floor = floor_rad, self.top.sigma_m / behind_m
        return floor if len(self.nosings) == 1 else min(floor, self.steepest)

    def slope(self, below: int = 0) -> tuple[float, float]:
        """Return the slope between two neighbouring nosings and its standard deviation [rad].

        Args:
            below: Number of nosings above the pair; 0 for the uppermost pair.
        """
        low, high = self.nosings[-2 - below], self.nosings[-1 - below]
        along_m = high.ahead_m - low.ahead_m
        sigma_m = math.hypot(low.sigma_m, high.sigma_m)
        return self.pitch_rad + math.atan2(high.above_m - low.above_m, along_m), sigma_m / along_m

    def falls_rad(self, ahead_m: float) -> float:
        """Return the angle by which a chair that backs down falls about the next nosing below a place [rad].

        Args:
            ahead_m: Place of the centre of mass ahead of mid-track along the belts.
        """
        below = sum(nosing.ahead_m > ahead_m for nosing in self.nosings)
        if not 0 < below < len(self.nosings) - 1:
            return 0.0
        return max(self.slope(below)[0] - self.slope(below - 1)[0], 0.0)

    def flipper_rad(self, axis_m: float, length_m: float) -> float:
        """Return the angle to the belts' line at which a flipper lies on the nosings below it and passes over the next [rad].

        Args:
            axis_m: Distance of the flipper's axis ahead of mid-track.
            length_m: Length of the flipper; nosings up to one more length ahead are passed over.
        """
        places = [(n.ahead_m - axis_m, n.above_m, SIGMAS * n.sigma_m) for n in self.nosings]
        lies = max((math.atan2(up, ahead) for ahead, up, _ in places if SHORT * length_m < ahead < length_m), default=0.0)
        before = [(up, spare) for ahead, up, spare in places if length_m <= ahead < 2.0 * length_m]
        passes = [math.atan2(up + spare, length_m) for up, spare in before if up - length_m * math.sin(lies) > spare]
        return max([lies, *passes])
