"""Duration of a fault that may flicker: ``limit exceeded or not, sample by sample -> whether it lasts``."""

import math

from treadline.core.signals import ROUNDING_S


class Lasting:
    """Time beyond a limit minus time within it, never below zero: a shock is soon over, a flickering fault is not.

    Each interval counts by the sample that ends it. A fault that is there for a share p of the time lasts after the limit divided
    by 2p - 1.

    Args:
        limit_s: Time beyond the limit after which a fault lasts [s].
        gap_s: Longest interval between two samples that counts [s].
    """

    def __init__(self, limit_s: float, gap_s: float) -> None:
        self._limit_s, self._gap_s = limit_s, gap_s
        self._t_s, self._over_s = math.inf, 0.0

    def update(self, t_s: float, *, beyond: bool) -> bool:
        """Return whether the fault lasts, after one more sample."""
        dt_s = min(max(t_s - self._t_s, 0.0), self._gap_s)
        before_s, self._t_s = self._over_s, t_s
        self._over_s = max(before_s + (dt_s if beyond else -dt_s), 0.0)
        return beyond and before_s >= self._limit_s - ROUNDING_S

    def forget(self, t_s: float) -> None:
        """Start again with a sample within the limit."""
        self._t_s, self._over_s = t_s, 0.0
