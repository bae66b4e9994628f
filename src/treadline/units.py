"""Units in names: what the ending of a channel's, a key's or a score's name stands for."""

UNITS = {
    "m_s2": "m/s²",
    "rad_s2": "rad/s²",
    "deg_s2": "°/s²",
    "m_s": "m/s",
    "rad_s": "rad/s",
    "deg_s": "°/s",
    "rad": "rad",
    "deg": "°",
    "mm": "mm",
    "cm": "cm",
    "n_m": "N m",
    "m": "m",
    "s": "s",
    "hz": "Hz",
    "kg": "kg",
    "px": "px",
    "percent": "%",
}
"""Endings of names, the longer before those they end in. Single letters other than m and s end too many plain words."""


def unit_ending(name: str) -> str | None:
    """Return the ending of a name that is a unit, None where it has none."""
    return next((end for end in UNITS if name.lower().endswith("_" + end) and len(name) > len(end) + 1), None)
