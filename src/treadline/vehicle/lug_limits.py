"""Limits of lug size by the chair's pulleys: ``belts, tracks -> reason for rejection``."""

from treadline.scenario.chair import Tracks
from treadline.scenario.scenario import Belts

LUG_SHARE = 0.5
"""Largest ratio of lug height to pulley radius."""
LUG_MOST_M = 0.04
"""Largest lug height [m]: the belt solid of 0.05 m shrinks by the lug height."""


def oversized_lugs(belts: Belts, tracks: Tracks) -> str | None:
    """Return why the lugs are too large for the chair's pulleys, or None."""
    height, most = belts.measures_m[0], min(LUG_SHARE * tracks.pulley_radius_m, LUG_MOST_M)
    if height <= most:
        return None
    return (
        f"belts.height_m is {height:.3f}, the pulleys' radius {tracks.pulley_radius_m:.3f} m; lugs up to {most:.3f} m fit, "
        "half that radius and 0.04 m at most: a belt bends at the lugs' feet"
    )
