"""Lists on the command line: ``1,1`` and ``a,b``."""

import math

from treadline.errors import SettingsError


def numbers(option: str, text: str | None) -> list[float] | None:
    """Return the numbers of a comma-separated list.

    Raises:
        SettingsError: If one is not a finite number.
    """
    if text is None:
        return None
    values = []
    for part in text.split(","):
        try:
            value = float(part)
        except ValueError:
            raise SettingsError(f"{option}: '{part}' is not a number; write for example {option} 1,1") from None
        if not math.isfinite(value):
            raise SettingsError(f"{option}: '{part}' is not finite")
        values.append(value)
    return values


def words(option: str, text: str) -> tuple[str, ...]:
    """Return the words of a comma-separated list.

    Raises:
        SettingsError: If one is empty or stands twice.
    """
    parts = tuple(part.strip() for part in text.split(","))
    if not all(parts):
        raise SettingsError(f"{option}: '{text}' has an empty name; write for example {option} left_m_s,right_m_s")
    if len(set(parts)) < len(parts):
        raise SettingsError(f"{option}: '{text}' names a column twice")
    return parts
