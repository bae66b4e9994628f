"""Algorithm 1 as printed, stage by stage, and Eq. (1) to (4) on its result.

Paper: Section III, Algorithm 1, Fig. 5, Eq. (1)-(4). For comparison; a mission uses it only if the scenario requests it.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.perception.detection import Stages, StairDetection, ThresholdRule, refused
from treadline.perception.paper.edges import canny, depth_image, grey_of, without_abrupt_depth
from treadline.perception.paper.hough_segments import bounding_box, merged, most_frequent_slope, near_level, segments
from treadline.perception.paper.printed_heading import delta_d, delta_x, heading_as_printed

SIGMA_RAD = 2.0 * DEG
"""Declared standard deviation [rad]: the printed method has none; its RMSE on accepted frames is 2.2°."""
EDGE_COLOUR, LINE_COLOUR, BOX_COLOUR = (255, 255, 255), (255, 196, 0), (0, 200, 255)
"""Colours of edges, lines and the bounding box."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Steps:
    """Intermediate results of the stages."""

    colour_edges: Bool[np.ndarray, "h w"]
    depth_edges: Bool[np.ndarray, "h w"]
    kept_edges: Bool[np.ndarray, "h w"]
    lines: Float[np.ndarray, "n 4"]
    level_lines: Float[np.ndarray, "k 4"]
    nosings: Float[np.ndarray, "j 4"]


def run_steps(frame: RgbdFrame, rule: ThresholdRule = "median") -> Steps:
    """Return all stages of Algorithm 1 for a frame."""
    colour = canny(grey_of(frame.rgb), rule)
    depth = canny(depth_image(frame.depth_m), rule)
    kept_colour = without_abrupt_depth(colour, frame.depth_m)
    kept_depth = without_abrupt_depth(depth, frame.depth_m)
    lines = np.vstack([segments(kept_colour), segments(kept_depth)])
    level = near_level(lines)
    nosings = most_frequent_slope(merged(level, frame.camera.width_px)) if len(level) else level
    return Steps(
        colour_edges=colour,
        depth_edges=depth,
        kept_edges=kept_colour | kept_depth,
        lines=lines,
        level_lines=level,
        nosings=nosings,
    )


def look_as_printed(frame: RgbdFrame, rule: ThresholdRule, *, stages: bool) -> StairDetection:
    """Return the result of Algorithm 1 and Eq. (2) for a frame."""
    steps = run_steps(frame, rule)
    shown = pictures(frame, steps) if stages else None
    if len(steps.nosings) == 0:
        return refused("no line of near-zero slope", stages=shown)
    ends = _end_depths(frame, steps.nosings)
    known = np.isfinite(ends).all(axis=1)
    if not known.any():
        return refused("no line has a depth at both ends", edge_count=len(steps.nosings), stages=shown)
    nosings, ends = steps.nosings[known], ends[known]
    shortest = int(np.argmin(nosings[:, 2] - nosings[:, 0]))
    left = np.array([nosings[shortest, 0], ends[shortest, 0]])
    right = np.array([nosings[shortest, 2], ends[shortest, 1]])
    width = delta_x(left, right, 1.0 / frame.camera.fx_px, frame.camera.cx_px)
    heading = heading_as_printed(delta_d(ends[:, 0], ends[:, 1]), width)
    if not np.isfinite(heading):
        return refused("Eq. (2) has no answer: |ΔD| > |ΔX|", edge_count=len(steps.nosings), stages=shown)
    return StairDetection(
        accepted=True,
        reason=None,
        heading_rad=heading,
        sigma_rad=SIGMA_RAD,
        edge_count=len(steps.nosings),
        box_px=bounding_box(steps.nosings),
        stages=shown,
    )


def _end_depths(frame: RgbdFrame, lines: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 2"]:
    """Return the depth at both ends of each line, NaN in a hole."""
    rows, columns = frame.depth_m.shape
    u = np.clip(np.round(lines[:, [0, 2]]).astype(int), 0, columns - 1)
    v = np.clip(np.round(lines[:, [1, 3]]).astype(int), 0, rows - 1)
    return frame.depth_m[v, u].astype(float)


def pictures(frame: RgbdFrame, steps: Steps) -> Stages:
    """Return the six stages (a) to (f) of Fig. 5 as images."""
    grey = cv2.cvtColor(grey_of(frame.rgb) // 2, cv2.COLOR_GRAY2RGB)
    boxed = _drawn(frame.rgb.copy(), steps.nosings)
    if len(steps.nosings):
        u0, v0, u1, v1 = bounding_box(steps.nosings)
        cv2.rectangle(boxed, (u0, v0), (u1, v1), BOX_COLOUR, 2)
    return (
        cv2.cvtColor(depth_image(frame.depth_m), cv2.COLOR_GRAY2RGB),
        _mask(steps.colour_edges | steps.depth_edges),
        _drawn(_mask(steps.kept_edges) // 2, steps.lines),
        _drawn(grey.copy(), steps.level_lines),
        _drawn(grey.copy(), steps.nosings),
        boxed,
    )


def _mask(edges: Bool[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    return np.repeat(edges[:, :, None].astype(np.uint8) * EDGE_COLOUR[0], 3, axis=2)


def _drawn(picture: UInt8[np.ndarray, "h w 3"], lines: Float[np.ndarray, "n 4"]) -> UInt8[np.ndarray, "h w 3"]:
    for u1, v1, u2, v2 in np.round(lines).astype(int).tolist():
        cv2.line(picture, (u1, v1), (u2, v2), LINE_COLOUR, 2)
    return picture
