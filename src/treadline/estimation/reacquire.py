"""When measurements that the gate refused are right after all: the gyro jumped, or the chair was moved.

A burst of wrong measurements agrees with itself too (a wall seen for a stair). Two things tell them apart: who jumped, and how
long each side has been believed. A vision that goes on smoothly while the gyro leaps is right. A vision that leaps has to show for
itself as long as what it contradicts.
"""

from dataclasses import dataclass

from treadline.angles import DEG, wrap


@dataclass(frozen=True, slots=True, kw_only=True)
class ReacquisitionRule:
    """What refused measurements must show before they take over."""

    for_s: float = 4.0
    """From the first to the last, at least."""
    most_s: float = 30.0
    """A vision that leapt away from a long track needs as long as that track was, but no longer than this: a landing's wall is in
    view for 7 to 14 s, and the guard holds after 12."""
    smooth_for_s: float = 1.0
    """When it was the gyro that leapt."""
    rate_hz: float = 5.0
    """Half of what a camera of 10 Hz delivers."""
    gap_s: float = 1.0
    """Between neighbours: what happened in a longer pause is not known."""
    spread_rad: float = 1.5 * DEG
    """Between neighbours: five sigma of a frame."""
    smooth_share: float = 0.5
    """Vision went on if it moved by less than this share of what the gyro says."""
    smooth_gap_s: float = 0.35
    """Two frames further apart do not show who leapt."""


class Refused:
    """The run of refused measurements that agree with each other."""

    def __init__(self, rule: ReacquisitionRule) -> None:
        self._rule = rule
        self.count = 0
        """In a row, whether they agree or not."""
        self.smooth = False
        """Whether vision went on where it had been, so that it was the gyro that leapt."""
        self._believed: tuple[float, float, float] | None = None
        self._track_s = 0.0
        self._last_s = 0.0
        self._leapt = False
        self.clear()

    def clear(self) -> None:
        """Forget them."""
        self.count = self._agreeing = 0
        self.smooth = self._leapt = False
        self._first_s = self._last_s
        self._last_rad = 0.0

    def accepted(self, t_s: float, seen_rad: float, turned_rad: float) -> None:
        """Note a measurement that the gate let pass, and what the gyro says the chair had turned in all."""
        if self._believed is not None:
            self._track_s = min(self._track_s + max(t_s - self._believed[0], 0.0), self._rule.most_s)
        self._believed = (t_s, seen_rad, turned_rad)
        self.clear()

    def restart(self, t_s: float, seen_rad: float, turned_rad: float) -> None:
        """Begin a new track with this measurement."""
        self._track_s = 0.0
        self._believed = (t_s, seen_rad, turned_rad)
        self.clear()

    def agree(self, t_s: float, seen_rad: float, turned_rad: float) -> bool:
        """Add one measurement; say whether it now is to be believed."""
        rule = self._rule
        # What the gyro turned is taken out, so that a turning chair's measurements can agree.
        still = wrap(seen_rad - turned_rad)
        apart = abs(wrap(still - self._last_rad)) > rule.spread_rad or t_s - self._last_s > rule.gap_s
        if self._agreeing == 0 or apart:
            self._agreeing, self._first_s = 0, t_s
            self._blame(t_s, seen_rad, turned_rad)
        self.count += 1
        self._agreeing += 1
        self._last_s, self._last_rad = t_s, still
        needed_s = rule.smooth_for_s if self.smooth else max(rule.for_s, self._track_s if self._leapt else 0.0)
        # Stamps are sums of periods: a microsecond must not cost a frame.
        return self._agreeing >= rule.rate_hz * needed_s and t_s - self._first_s >= needed_s - 1e-6

    def _blame(self, t_s: float, seen_rad: float, turned_rad: float) -> None:
        """Find out who leapt: the gyro, if vision stayed where it was; vision, if the two are far apart for any other reason."""
        if self._believed is None:
            return
        moved, turned = wrap(seen_rad - self._believed[1]), turned_rad - self._believed[2]
        recent = 0.0 < t_s - self._believed[0] <= self._rule.smooth_gap_s
        self.smooth = self.smooth or (recent and abs(moved) < self._rule.smooth_share * abs(turned))
        self._leapt = not self.smooth and abs(wrap(moved - turned)) > self._rule.spread_rad
