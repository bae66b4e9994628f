"""Unit suffixes in the names of channels, keys and scores."""

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
"""Unit by name suffix, longer suffixes first. Single letters other than m and s are excluded: many ordinary words end in them."""


def unit_ending(name: str) -> str | None:
    """Return the unit suffix of a name, or None."""
    return next((end for end in UNITS if name.lower().endswith("_" + end) and len(name) > len(end) + 1), None)
