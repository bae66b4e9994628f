"""Algorithm 1 as printed, stage by stage.

Paper: Algorithm 1, Eq. (1)-(4), Fig. 5.
"""

import math

import cv2
import numpy as np
from jaxtyping import Float, Float32

from treadline.angles import DEG
from treadline.perception import pictures
from treadline.perception.edges import Rule, canny, depth_picture, without_abrupt
from treadline.perception.heading import delta_x, mean_delta_depth, printed_angle
from treadline.perception.merge import merged, most_frequent_slope
from treadline.perception.segments import hough_segments, near_zero
from treadline.perception.sight import Sight, Stages, refused
from treadline.signals import RgbdFrame

LEAST_EDGES = 2
SIGMA = 2.2 * DEG
"""RMSE of the literal algorithm on frames where it does not fail: it has no uncertainty of its own."""


def look_paper(frame: RgbdFrame, *, rule: Rule, stages: bool) -> Sight:
    """Return what Algorithm 1 says of a frame; the heading is 90° less the printed angle."""
    grey = np.asarray(cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    depth = depth_picture(frame.depth_m)
    edges = canny(grey, rule), canny(depth, rule)
    filtered = without_abrupt(edges[0], frame.depth_m), without_abrupt(edges[1], frame.depth_m)
    lines = near_zero(np.concatenate([hough_segments(filtered[0]), hough_segments(filtered[1])]))
    nosings = most_frequent_slope(merged(lines, frame.camera.cx_px))
    box = bounding_box(nosings) if len(nosings) else None
    kept = None
    if stages:
        drawn = pictures.six_stages(depth, edges, filtered, lines, nosings, box, frame.rgb)
        kept = Stages(pictures=drawn, nosings_px=nosings)
    ends = end_depths(nosings, frame.depth_m)
    known = np.isfinite(ends).all(axis=1)
    count = int(known.sum())
    if count < LEAST_EDGES:
        return refused(f"{count} edge(s) with depth at both ends, {LEAST_EDGES} needed", edge_count=count, stages=kept)
    heading = _heading(nosings[known], ends[known], frame)
    if not math.isfinite(heading):
        return refused("Eq. (2) has no value: |ΔD| exceeds |ΔX|", edge_count=count, stages=kept)
    return Sight(
        accepted=True,
        reason=None,
        heading_rad=heading,
        sigma_rad=SIGMA,
        edge_direction_C=np.array([math.cos(heading), 0.0, -math.sin(heading)]),
        edge_count=count,
        box_px=box,
        shape=None,
        stages=kept,
    )


def bounding_box(lines: Float[np.ndarray, "n 4"]) -> tuple[int, int, int, int]:
    """Return the box around all end points: u0, v0, u1, v1.

    Paper: Algorithm 1, step 6; Fig. 5(f).
    """
    columns, rows = lines[:, [0, 2]], lines[:, [1, 3]]
    return int(columns.min()), int(rows.min()), int(columns.max()), int(rows.max())


def end_depths(lines: Float[np.ndarray, "n 4"], depth_m: Float32[np.ndarray, "h w"]) -> Float[np.ndarray, "n 2"]:
    """Return the depth at both ends of each segment [m]; NaN where there was no return."""
    points = np.round(lines).astype(int)
    return np.column_stack([depth_m[points[:, 1], points[:, 0]], depth_m[points[:, 3], points[:, 2]]]).astype(float)


def _heading(lines: Float[np.ndarray, "n 4"], ends: Float[np.ndarray, "n 2"], frame: RgbdFrame) -> float:
    shortest = int(np.argmin(lines[:, 2] - lines[:, 0]))
    extent = delta_x(
        (float(lines[shortest, 0]), float(lines[shortest, 2])),
        (float(ends[shortest, 0]), float(ends[shortest, 1])),
        a=1.0 / frame.camera.fx_px,
        centre_px=frame.camera.cx_px,
    )
    # The printed angle is 90° when aligned and grows when the right end is nearer, as the heading does.
    return printed_angle(mean_delta_depth(ends[:, 0], ends[:, 1]), extent) - 0.5 * math.pi
