"""Eq. (1) to (4) as printed, and the form that is right.

Paper: Section III.A, Fig. 6. ``x`` is an image column, ``D`` a depth [m]; a is the paper's adjustment parameter, 1/f for
a pinhole camera, and 320 its column of the optical axis. ``heading_about`` is for a camera whose mount nobody knows.
"""

import numpy as np
from jaxtyping import Float

LEAST_AHEAD = 0.2
"""Of the optical axis that must lie across the chair's z to tell where ahead is."""


def world_x(x_px: float, depth_m: float, a: float, centre_px: float) -> float:
    """Return the lateral coordinate of a point [m].

    Paper: Eq. (1).
    """
    return a * depth_m * (x_px - centre_px)


def heading_as_printed(delta_d_m: float, delta_x_m: float) -> float:
    """Return θ = arccos(ΔD / ΔX) [rad], as printed.

    Paper: Eq. (2). It answers 90° to a chair that stands square, has no sign, and has no answer where |ΔD| > |ΔX|
    (NaN); ``heading_of_edge`` is what is meant.
    """
    if delta_x_m == 0.0 or abs(delta_d_m) > abs(delta_x_m):
        return float("nan")
    return float(np.arccos(delta_d_m / delta_x_m))


def delta_x(left: Float[np.ndarray, " 2"], right: Float[np.ndarray, " 2"], a: float, centre_px: float) -> float:
    """Return ΔX = a (X₂'D₂ - X₁'D₁ + 320 (D₁ - D₂)) of a segment [m]; each end is (column, depth).

    Paper: Eq. (3).
    """
    return float(world_x(right[0], right[1], a, centre_px) - world_x(left[0], left[1], a, centre_px))


def delta_d(left_m: Float[np.ndarray, " n"], right_m: Float[np.ndarray, " n"]) -> float:
    """Return ΔD, the mean difference of depth between the right and the left ends of all edges [m].

    Paper: Eq. (4).
    """
    return float(np.mean(right_m - left_m))


def heading_of_edge(delta_d_m: float, delta_x_m: float) -> float:
    """Return the heading of one edge [rad]: ψ = atan2(D₁ - D₂, X₂ - X₁), P₁ left of P₂.

    Exact for a level camera; positive when the chair is turned anticlockwise.
    """
    return float(np.arctan2(-delta_d_m, delta_x_m))


def heading_about(up_C: Float[np.ndarray, " 3"], edge_C: Float[np.ndarray, " 3"]) -> float | None:
    """Return the heading [rad] of a chair whose z axis is known in C, whatever the camera's pitch and roll; its yaw must be 0.

    The optical axis then lies in the chair's middle plane. On the flight z is the normal of the nosings' plane, on the level up.

    Args:
        up_C: Unit vector along the chair's z.
        edge_C: Unit vector along the edges, to the chair's right.

    Returns:
        None for a camera that looks along z: then ahead is not known.
    """
    ahead = np.array([0.0, 0.0, 1.0]) - up_C[2] * up_C
    if float(np.linalg.norm(ahead)) < LEAST_AHEAD:
        return None
    left = np.cross(up_C, ahead)
    return float(np.arctan2(-edge_C @ ahead, -edge_C @ left))
