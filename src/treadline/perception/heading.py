"""Heading from the end points of stair edges: the printed equations, and the one that is exact.

Paper: Eq. (1)-(4). Depths are in metres here, so ``a`` is 1 / focal length in pixels.
"""

import math

import numpy as np
from jaxtyping import Float


def x_world(column_px: float, depth_m: float, *, a: float, centre_px: float) -> float:
    """Return the sideways position of a point [m].

    Paper: Eq. (1), X = a D (X' - 320).
    """
    return a * depth_m * (column_px - centre_px)


def delta_x(columns_px: tuple[float, float], depths_m: tuple[float, float], *, a: float, centre_px: float) -> float:
    """Return the sideways extent of one edge from P1 to P2 [m].

    Paper: Eq. (3), ΔX = a (X2' D2 - X1' D1 + 320 (D1 - D2)).
    """
    (x1, x2), (d1, d2) = columns_px, depths_m
    return a * (x2 * d2 - x1 * d1 + centre_px * (d1 - d2))


def mean_delta_depth(first_m: Float[np.ndarray, " n"], second_m: Float[np.ndarray, " n"]) -> float:
    """Return the mean depth difference over all edges [m].

    Paper: Eq. (4), ΔD = Σ (D2(i) - D1(i)) / N.
    """
    return float(np.mean(second_m - first_m))


def printed_angle(delta_depth_m: float, delta_x_m: float) -> float:
    """Return the printed heading angle [rad]: π/2 when aligned, NaN where the arccos has no value.

    Paper: Eq. (2), θ = arccos(ΔD / ΔX). It takes the leg ΔX for the hypotenuse and measures from the
    optical axis.
    """
    if delta_x_m == 0.0 or abs(delta_depth_m) > abs(delta_x_m):
        return math.nan
    return math.acos(delta_depth_m / delta_x_m)


def edge_heading(delta_depth_m: float, delta_x_m: float) -> float:
    """Return the heading of a level camera that sees an edge [rad], positive anticlockwise from above.

    ``delta_depth_m`` is D2 - D1 with P2 to the right: a chair turned left has the edge's right end nearer.
    """
    return math.atan2(-delta_depth_m, delta_x_m)
