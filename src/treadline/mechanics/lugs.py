"""Lugs that a chair's pulleys can carry: ``belts, tracks -> reason against``."""

from treadline.mechanics.chair import Tracks
from treadline.scenario import Belts

LUG_SHARE = 0.5
"""Largest height of a lug as a share of the pulley's radius."""
LUG_MOST_M = 0.04
"""Largest height of a lug: the belt's solid of 0.05 m shrinks by it."""


def oversized_lugs(belts: Belts, tracks: Tracks) -> str | None:
    """Return why a chair's pulleys cannot carry a belt's lugs, None if they can."""
    height, most = belts.measures_m[0], min(LUG_SHARE * tracks.pulley_radius_m, LUG_MOST_M)
    if height <= most:
        return None
    return (
        f"belts.height_m is {height:.3f}, the pulleys' radius {tracks.pulley_radius_m:.3f} m; lugs up to {most:.3f} m fit, "
        "half that radius and 0.04 m at most: a belt bends at the lugs' feet"
    )
