"""Duration of a fault that may flicker: ``limit exceeded or not, sample by sample -> whether it lasts``."""

from treadline.core.signals import ROUNDING_S


class Lasting:
    """Time beyond a limit minus time within it, never below zero: a shock ends soon, four bad samples in five do not.

    Args:
        limit_s: Time beyond the limit after which a fault lasts [s].
        gap_s: Longest interval between two samples that counts [s].
    """

    def __init__(self, limit_s: float, gap_s: float) -> None:
        self._limit_s, self._gap_s = limit_s, gap_s
        self._t_s: float | None = None
        self._over_s = 0.0

    def update(self, t_s: float, *, beyond: bool) -> bool:
        """Return whether the fault lasts, after one more sample."""
        dt_s = 0.0 if self._t_s is None else min(t_s - self._t_s, self._gap_s)
        before_s, self._t_s = self._over_s, t_s
        self._over_s = max(before_s + (dt_s if beyond else -dt_s), 0.0)
        return beyond and before_s >= self._limit_s - ROUNDING_S

    def forget(self) -> None:
        """Start again."""
        self._t_s, self._over_s = None, 0.0
