"""Eq. (1) to (4) as printed, and in corrected form.

Paper: Section III.A, Fig. 6. ``x`` is an image column, ``D`` a depth [m]; a is the paper's adjustment parameter, 1/f for a pinhole
camera, and 320 its column of the optical axis. ``heading_about`` is for a camera with unknown mount.
"""

import numpy as np
from jaxtyping import Float

from treadline.core.rotations import Vector3

LEAST_AHEAD = 0.2
"""Least component of the optical axis perpendicular to the chair's z for a defined forward direction."""


def world_x(x_px: float, depth_m: float, a: float, centre_px: float) -> float:
    """Return the lateral coordinate of a point [m].

    Paper: Eq. (1).
    """
    return a * depth_m * (x_px - centre_px)


def heading_as_printed(delta_d_m: float, delta_x_m: float) -> float:
    """Return θ = arccos(ΔD / ΔX) [rad], as printed.

    Paper: Eq. (2). It gives 90° for a chair square to the stair, has no sign, and is undefined (NaN) for |ΔD| > |ΔX|; the intended
    form is ``heading_of_edge``.
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

    Exact for a horizontal camera; positive for a chair rotated anticlockwise.
    """
    return float(np.arctan2(-delta_d_m, delta_x_m))


def heading_about(up_C: Vector3, edge_C: Vector3) -> float | None:
    """Return the heading [rad] of a chair with known z axis in C, for any camera pitch and roll and a camera yaw of 0.

    The optical axis then lies in the chair's middle plane. On the flight z is the normal of the nosing plane, on horizontal ground
    the vertical.

    Args:
        up_C: Unit vector along the chair's z.
        edge_C: Unit vector along the edges, to the chair's right.

    Returns:
        None for a camera looking along z, for which the forward direction is undefined.
    """
    ahead = np.array([0.0, 0.0, 1.0]) - up_C[2] * up_C
    if float(np.linalg.norm(ahead)) < LEAST_AHEAD:
        return None
    left = np.cross(up_C, ahead)
    return float(np.arctan2(-edge_C @ ahead, -edge_C @ left))
