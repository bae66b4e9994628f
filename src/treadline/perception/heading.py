"""Eq. (1) to (4) as printed, and the form that is right.

Paper: Section III.A, Fig. 6. ``x`` is an image column, ``D`` a depth [m]; a is the paper's adjustment parameter, 1/f for
a pinhole camera, and 320 its column of the optical axis.
"""

import numpy as np
from jaxtyping import Float


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
    return float(a * (right[0] * right[1] - left[0] * left[1] + centre_px * (left[1] - right[1])))


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
