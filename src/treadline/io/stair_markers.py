"""Markers of the stair ahead for RViz and Foxglove: nosings, directions of the steps, sides, way, drop, set heading and hold.

``StairMap, FreeGround, MotionPlan -> Marker``. All are drawn in frames that resolve to ``odom``: what a camera frame measured in
``chair``, the set heading in ``stair``.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from treadline.core.signals import FreeGround, MotionPlan, SideKind, StairMap
from treadline.io.scene_messages import BASE, LINE_LIST, TEXT_FACING, Marker
from treadline.vehicle.appearance import colour

Points = Float[np.ndarray, "n 3"]

SEEN_HALF_M = 0.5
"""Half length of a detected nosing or drop whose ends are out of view [m]: half of a stair of common width."""
LINE_M = 0.012
"""Drawn width of a line [m]."""
SET_HEADING_M = 1.0
"""Drawn length of the set heading [m]: about that of a chair."""
TEXT_M, TEXT_HEIGHT_M = 0.12, 1.6
"""Height of a letter, and of the text above the chair [m]: above a seated person."""
SIDES: dict[SideKind | None, str] = {"open": "flipper", "wall": "riser", None: "riser"}
"""Colour of a side by what follows beyond it."""


def nosings_marker(stair: StairMap, heading_rad: float) -> Marker:
    """Return the detected nosings as lines, turned by the heading measured in the same frame."""
    left = SEEN_HALF_M if stair.left_edge_m is None else stair.left_edge_m
    right = SEEN_HALF_M if stair.right_edge_m is None else stair.right_edge_m
    nosings_B, across = np.array(stair.nosings_B).reshape(-1, 3), _across(heading_rad)
    ends = np.stack([nosings_B + left * across, nosings_B - right * across], axis=1).reshape(-1, 3)
    return _lines("seen", ends, "seen_nosing")


def stair_markers(stair: StairMap, heading_rad: float) -> Iterator[Marker]:
    """Yield nosings, directions of the steps, sides and way of a map, as far as they are in view."""
    if not stair.nosings_B:
        return
    nosings_B = np.array(stair.nosings_B)
    yield nosings_marker(stair, heading_rad)
    turns = np.full(len(nosings_B), -heading_rad)
    turns[-1] += stair.turn_rad or 0.0
    steps = stair.run_m * np.stack([np.cos(turns), np.sin(turns), np.zeros(len(turns))], axis=1)
    yield _lines("directions", np.stack([nosings_B, nosings_B + steps], axis=1).reshape(-1, 3), "lens")
    yield _lines("way", _chain(np.vstack([np.zeros(3), nosings_B])), "cushion")
    for name, edge_m, side, sign in (
        ("left side", stair.left_edge_m, stair.left_side, 1.0),
        ("right side", stair.right_edge_m, stair.right_side, -1.0),
    ):
        if edge_m is not None and len(nosings_B) > 1:
            yield _lines(name, _chain(nosings_B + sign * edge_m * _across(heading_rad)), SIDES[side])


def drop_marker(ground: FreeGround) -> Marker | None:
    """Return the edge at which the ground ends; None if none is in view."""
    if ground.end_m is None:
        return None
    sign = 1.0 if ground.view == "front" else -1.0
    across = SEEN_HALF_M * _across(-(ground.direction_rad or 0.0))
    middle = np.array([sign * ground.end_m, 0.0, 0.0])
    return _lines("drop", np.array([middle - across, middle + across]), "flipper")


def heading_marker(plan: MotionPlan) -> Marker:
    """Return the set point of the heading on the stair."""
    end = SET_HEADING_M * np.array([math.cos(plan.heading_rad), math.sin(plan.heading_rad), 0.0])
    return _lines("set heading", np.array([np.zeros(3), end]), "linkage", "stair")


def hold_marker(cause: str) -> Marker:
    """Return the cause of a hold as a text above the chair."""
    place = np.array([[0.0, 0.0, TEXT_HEIGHT_M]])
    rgba = (*colour("linkage"), 1.0)
    return Marker(
        frame=BASE, name="hold", number=0, kind=TEXT_FACING, points_m=place, rgba=rgba, width_m=TEXT_M, text=f"HOLD: {cause}"
    )


def _across(heading_rad: float) -> Float[np.ndarray, " 3"]:
    """Return the direction along the nosings in B, to the left of the flight."""
    return np.array([math.sin(heading_rad), math.cos(heading_rad), 0.0])


def _chain(points_m: Points) -> Points:
    """Return the ends of the lines from each point to the next."""
    return np.stack([points_m[:-1], points_m[1:]], axis=1).reshape(-1, 3)


def _lines(name: str, points_m: Points | Sequence[Sequence[float]], of: str, frame: str = "chair") -> Marker:
    points = np.asarray(points_m, dtype=float)
    rgba = (*colour(of), 1.0)
    return Marker(frame=frame, name=name, number=0, kind=LINE_LIST, points_m=points, rgba=rgba, width_m=LINE_M)
