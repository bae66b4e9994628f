"""When measurements that the gate refused are right after all: the gyro jumped, or the chair was moved.

A burst of wrong measurements agrees with itself too (a wall seen for a stair); only time and number tell them apart.
"""

from dataclasses import dataclass

from treadline.angles import DEG, wrap


@dataclass(frozen=True, slots=True, kw_only=True)
class ReacquisitionRule:
    """What refused measurements must show before they take over."""

    for_s: float = 4.0
    """From the first to the last."""
    count: int = 20
    """Half of what 10 Hz delivers in that time."""
    gap_s: float = 1.0
    """Between neighbours: what happened in a longer pause is not known."""
    spread_rad: float = 1.5 * DEG
    """Between neighbours: five sigma of a frame."""


class Refused:
    """The run of refused measurements that agree with each other."""

    def __init__(self, rule: ReacquisitionRule) -> None:
        self._rule = rule
        self.clear()

    def clear(self) -> None:
        """Forget them: a measurement was accepted."""
        self._count = 0
        self._first_s = 0.0
        self._last_s = 0.0
        self._last_rad = 0.0

    def agree(self, t_s: float, heading_rad: float) -> bool:
        """Add one measurement; say whether they now are to be believed, and start anew if so."""
        rule = self._rule
        apart = abs(wrap(heading_rad - self._last_rad)) > rule.spread_rad or t_s - self._last_s > rule.gap_s
        if self._count == 0 or apart:
            self._count, self._first_s = 0, t_s
        self._count += 1
        self._last_s, self._last_rad = t_s, heading_rad
        # Stamps are sums of periods: a microsecond must not cost a frame.
        believed = self._count >= rule.count and t_s - self._first_s >= rule.for_s - 1e-6
        if believed:
            self.clear()
        return believed
