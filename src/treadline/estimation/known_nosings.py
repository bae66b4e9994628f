"""Known nosings relative to the chair at one instant: what the way and a riding flipper need of the stair tracker.

``StairTracker -> KnownNosings``. Heights are above the belts' line. The belts lie on the nosing that stands highest above that line
under the flat run, which is therefore their zero: errors that all nosings have in common do not count.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

SIGMAS = 3.0
"""Standard deviations beyond which a nosing counts as off the line of its neighbours: one in 370 that are on it."""
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
    """Height of the first nosing above the floor [m]: the flight's rise where it was not measured."""

    @property
    def top(self) -> KnownNosing:
        """Uppermost nosing: the landing's edge."""
        return self.nosings[-1]

    def floor_rad(self, half_m: float, radius_m: float) -> float:
        """Return the pitch with the landing's edge at mid-track and the rear pulley on the floor [rad].

        Args:
            half_m: Half of the flat run.
            radius_m: Radius of the rear pulley, with the belt.
        """
        low, top = self.nosings[0], self.nosings[-1]
        height_m = (top.ahead_m - low.ahead_m) * math.sin(self.pitch_rad) + (top.above_m - low.above_m) * math.cos(self.pitch_rad)
        # On the floor the pulley's axis is at its radius: half sin(pitch) - radius cos(pitch) = height - radius.
        share = (height_m + self.rise_m - radius_m) / math.hypot(half_m, radius_m)
        return math.asin(share) + math.atan2(radius_m, half_m) if share < 1.0 else 0.5 * math.pi

    def _slope(self, below: int) -> float:
        """Return the slope between two neighbouring nosings against the belts, with so many nosings above the pair [rad]."""
        low, high = self.nosings[-2 - below], self.nosings[-1 - below]
        return math.atan2(high.above_m - low.above_m, high.ahead_m - low.ahead_m)

    def falls_rad(self, ahead_m: float) -> float:
        """Return the angle by which a chair that backs down falls about the next nosing below a place [rad].

        Args:
            ahead_m: Place of the centre of mass ahead of mid-track along the belts.
        """
        below = sum(nosing.ahead_m > ahead_m for nosing in self.nosings)
        if not 0 < below < len(self.nosings) - 1:
            return 0.0
        return max(self._slope(below) - self._slope(below - 1), 0.0)

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
