"""Reacquisition: acceptance of rejected measurements after a gyro jump or an external displacement of the chair.

A burst of wrong measurements is also self-consistent (a wall mistaken for a stair). Two criteria distinguish the cases: the
sensor that jumped, and the length of the previous track. A continuous vision track during a gyro jump is accepted. A vision
track that jumped must last as long as the track it contradicts.
"""

from dataclasses import dataclass

from treadline.core.angles import DEG, wrap


@dataclass(frozen=True, slots=True, kw_only=True)
class ReacquisitionRule:
    """Criteria for the acceptance of rejected measurements."""

    for_s: float = 4.0
    """Smallest duration from the first to the last measurement [s]."""
    most_s: float = 30.0
    """Largest duration required after a long contradicted track [s]: the wall of a landing is in view for 7 to 14 s, and the guard
    holds after 12 s."""
    smooth_for_s: float = 1.0
    """Smallest duration after a gyro jump [s]."""
    rate_hz: float = 5.0
    """Smallest rate of measurements [Hz]: half the rate of a 10 Hz camera."""
    gap_s: float = 1.0
    """Longest gap between neighbouring measurements [s]; motion in a longer gap is unknown."""
    spread_rad: float = 1.5 * DEG
    """Largest difference between neighbouring measurements [rad]: five sigma of a frame."""
    smooth_share: float = 0.5
    """Largest vision turn relative to the gyro turn for a continuous vision track."""
    smooth_gap_s: float = 0.35
    """Longest time between two frames to attribute a jump to a sensor [s]."""


class RejectedTrack:
    """Sequence of consistent rejected measurements."""

    def __init__(self, rule: ReacquisitionRule) -> None:
        self._rule = rule
        self.count = 0
        """Number of consecutive rejected measurements, consistent or not."""
        self.smooth = False
        """Whether vision was continuous, so that the gyro jumped."""
        self._accepted_at: tuple[float, float, float] | None = None
        self._track_s = 0.0
        self._last_s = 0.0
        self._vision_jumped = False
        self.clear()

    def clear(self) -> None:
        """Reset the sequence."""
        self.count = self._agreeing = 0
        self.smooth = self._vision_jumped = False
        self._first_s = self._last_s
        self._last_rad = 0.0

    def accepted(self, t_s: float, seen_rad: float, turned_rad: float) -> None:
        """Take an accepted measurement and the total turn by the gyro."""
        if self._accepted_at is not None:
            self._track_s = min(self._track_s + max(t_s - self._accepted_at[0], 0.0), self._rule.most_s)
        self._accepted_at = (t_s, seen_rad, turned_rad)
        self.clear()

    def restart(self, t_s: float, seen_rad: float, turned_rad: float) -> None:
        """Begin a new track with this measurement."""
        self._track_s = 0.0
        self._accepted_at = (t_s, seen_rad, turned_rad)
        self.clear()

    def agree(self, t_s: float, seen_rad: float, turned_rad: float) -> bool:
        """Add one rejected measurement; return whether the sequence is now accepted."""
        rule = self._rule
        # The gyro turn is removed, so that measurements of a turning chair can be consistent.
        still = wrap(seen_rad - turned_rad)
        apart = abs(wrap(still - self._last_rad)) > rule.spread_rad or t_s - self._last_s > rule.gap_s
        if self._agreeing == 0 or apart:
            self._agreeing, self._first_s = 0, t_s
            self._attribute_jump(t_s, seen_rad, turned_rad)
        self.count += 1
        self._agreeing += 1
        self._last_s, self._last_rad = t_s, still
        needed_s = rule.smooth_for_s if self.smooth else max(rule.for_s, self._track_s if self._vision_jumped else 0.0)
        # The tolerance covers rounding of stamps, which are sums of periods.
        return self._agreeing >= rule.rate_hz * needed_s and t_s - self._first_s >= needed_s - 1e-6

    def _attribute_jump(self, t_s: float, seen_rad: float, turned_rad: float) -> None:
        """Attribute the jump: to the gyro for a continuous vision track, else to vision for a large difference."""
        if self._accepted_at is None:
            return
        moved, turned = wrap(seen_rad - self._accepted_at[1]), turned_rad - self._accepted_at[2]
        recent = 0.0 < t_s - self._accepted_at[0] <= self._rule.smooth_gap_s
        self.smooth = self.smooth or (recent and abs(moved) < self._rule.smooth_share * abs(turned))
        self._vision_jumped = not self.smooth and abs(wrap(moved - turned)) > self._rule.spread_rad
