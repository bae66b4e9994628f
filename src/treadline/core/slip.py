"""Slip of the belts on a stair, for the guard and the plots: ``belt travel, movement -> slip ratio``, of numbers or arrays."""

from typing import Any

DRIVEN_LEAST_M = 0.03
"""Smallest belt travel in a window of which a slip ratio is given [m]; below, noise of the nosings would count as slip."""


def slower_belt_m_s(left_m_s: float, right_m_s: float) -> float:
    """Return the speed of the slower belt [m/s], backwards negative.

    On a stair the chair moves with the slower belt (Coulomb friction is rate independent), so slip is measured against it.
    """
    return min(left_m_s, right_m_s, key=abs)


def slip_ratio(off_m: Any, driven_m: Any) -> Any:
    """Return the slip ratio: the part of the slower belt's travel that the chair does not follow, forwards or backwards.

    Args:
        off_m: Travel of the slower belt minus movement of the chair [m].
        driven_m: Travel of the slower belt [m], at least ``DRIVEN_LEAST_M`` in magnitude.
    """
    return abs(off_m) / abs(driven_m)
