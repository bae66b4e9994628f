"""Support of a chair by its pose: the part of the belts that touches stair or floor, and its centre of mass.

``pose, Staircase -> front, rear, left, right``. Contact forces are not needed, so that a log without a simulator has a support too.
"""

import numpy as np
from jaxtyping import Float

from treadline.scenario.chair import ChairDescription
from treadline.vehicle.stair_solids import above_ground_m
from treadline.vehicle.staircase import Staircase
from treadline.vehicle.tip_over_margin import ROCKING_M

SAMPLES = 49
"""Points along the flat run of a belt: 2 cm apart for a run of 0.95 m, less than the depth of the strip that supports it."""
ACROSS = 3
"""Points across a belt: its edges and its middle."""


def support_of(
    chair: ChairDescription, staircase: Staircase, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"]
) -> tuple[float, float, float, float] | None:
    """Return the reach of the supported points from B [m], front, rear, left, right, each positive outwards; None without support.

    A point of the belts' lower line is supported if ground is at most ``ROCKING_M`` below it, as for the tip-over margin.
    """
    tracks = chair.tracks
    along = np.linspace(-0.5 * tracks.flat_run_m, 0.5 * tracks.flat_run_m, SAMPLES)
    aside = 0.5 * tracks.gauge_m + np.linspace(-0.5, 0.5, ACROSS) * tracks.belt_width_m
    x, y = (grid.ravel() for grid in np.meshgrid(along, np.concatenate([-aside, aside]), indexing="ij"))
    points_W = p_WB + np.stack([x, y, np.zeros(len(x))], axis=1) @ R_WB.T
    near = above_ground_m(staircase, points_W, ROCKING_M) <= ROCKING_M
    if not near.any():
        return None
    return float(x[near].max()), float(-x[near].min()), float(y[near].max()), float(-y[near].min())
