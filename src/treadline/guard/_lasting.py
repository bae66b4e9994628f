"""Duration of a fault that may flicker: ``limit exceeded or not, sample by sample -> whether it lasts``."""

from treadline.core.signals import ROUNDING_S


class Lasting:
    """Time between samples beyond a limit minus time until samples within it, never below zero.

    A shock is soon over; four bad samples in five last.

    Args:
        limit_s: Time beyond the limit after which a fault lasts [s].
        gap_s: Longest interval between two samples that counts [s].
    """

    def __init__(self, limit_s: float, gap_s: float) -> None:
        self._limit_s, self._gap_s = limit_s, gap_s
        self._t_s = self._over_s = 0.0
        self._was_beyond = False

    def update(self, t_s: float, *, beyond: bool) -> bool:
        """Return whether the fault lasts, after one more sample."""
        dt_s = min(t_s - self._t_s, self._gap_s)
        if not beyond:
            self._over_s = max(self._over_s - dt_s, 0.0)
        elif self._was_beyond:
            self._over_s += dt_s
        self._t_s, self._was_beyond = t_s, beyond
        return beyond and self._over_s >= self._limit_s - ROUNDING_S

    def forget(self) -> None:
        """Start again."""
        self._over_s, self._was_beyond = 0.0, False
