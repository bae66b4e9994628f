"""What is true of the stair in a view, in the terms of the signals that speak of it."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from treadline.devices.visibility import crossings
from treadline.mechanics.chair import ChairDescription
from treadline.mechanics.staircase import Staircase, Step
from treadline.signals import PinholeCamera
from treadline.sim.camera.camera import ExactView
from treadline.sim.camera.clutter import OBSTACLES, RAIL_INSET_M, RAIL_M
from treadline.sim.camera.flight import Direction, Flight, Pose
from treadline.sim.camera.solids import Solid

SWEPT_HEIGHT_M = (0.06, 1.4)
"""Above the belts' lower line: lower things the belts climb, and the chair's rider is no taller."""
GRAIN_M = 0.01
"""Distance between the points of a thing that are asked whether they stand in the way."""
LEAST_WALL = 0.01
"""Share of the image that a wall or a rail must fill to count as seen."""
LEAST_TREAD = 0.01
"""Share of the image that a tread must fill to count as seen."""
UPPER_SIDE = 5
"""Of a box's six."""
HIDDEN_M = 0.03
"""A nosing this far behind what the image shows in its place is hidden."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StairTruth:
    """The stair as it is, in the terms of ``StairMap``."""

    direction: Direction
    heading_rad: float
    edge_C: Float[np.ndarray, " 3"]
    """Unit vector along the nosings, pointing to the chair's right."""
    normal_C: Float[np.ndarray, " 3"]
    """Unit vector square to the plane through the nosings, pointing away from the stair."""
    slope_rad: float
    rise_m: float
    run_m: float
    """As designed; jitter of single steps comes on top."""
    share: float
    """Of the image that shows steps."""
    nosings_B: Float[np.ndarray, "n 3"]
    """Where each nosing ahead meets the chair's middle plane, the nearest first; those out of sight too, and those that
    would meet it beside the stair. A worn nosing counts as if it were sharp."""
    nosing_in_view: Bool[np.ndarray, " n"]
    """Whether that point is on the stair, in the image and not hidden."""
    treads_in_view: int
    """Steps that show their tread, the landing among them. One alone may as well be a doorstep's, before a wall or on a floor."""
    end_in_view: bool
    """Whether the flight's last nosing is in view, where it meets the middle plane or elsewhere."""
    left_wall_m: float | None
    """From the chair's middle to the wall or rail at its left, square to that; None if none is in view."""
    right_wall_m: float | None
    obstacle_m: float | None
    """Along x to the nearest thing in the volume that the chair's tracks will sweep."""


def stair_truth(
    direction: Direction,
    flight: Flight,
    pose: Pose,
    camera: PinholeCamera,
    solids: list[Solid],
    exact: ExactView,
    chair: ChairDescription,
) -> StairTruth:
    """Return what is true of a flight from where the chair stands."""
    right_W = np.array([0.0, -1.0 if direction == "up" else 1.0, 0.0])
    edge_B = pose.R_WB.T @ right_W
    is_step = np.array([*(solid.kind == "step" for solid in solids), False])
    staircase = flight.staircase
    nosings = _nosings(flight, pose, direction)
    on_stair = np.abs((pose.p_WB + nosings @ pose.R_WB.T)[:, 1]) <= 0.5 * staircase.width_m
    steps = staircase.steps
    left, right = _walls(staircase, solids, pose, direction, exact)
    return StairTruth(
        direction=direction,
        heading_rad=math.atan2(-edge_B[0], -edge_B[1]),
        edge_C=camera.R_BC.T @ edge_B,
        normal_C=camera.R_BC.T @ pose.R_WB.T @ staircase.R_WS[:, 2],
        slope_rad=staircase.slope_rad,
        rise_m=staircase.pitch_m * math.sin(staircase.slope_rad),
        run_m=staircase.pitch_m * math.cos(staircase.slope_rad),
        share=float(is_step[np.where(exact.face >= 0, exact.face // 6, len(solids))].mean()),
        nosings_B=nosings,
        nosing_in_view=_in_view(nosings, camera, exact) & on_stair,
        treads_in_view=_treads_in_view(solids, exact),
        end_in_view=_end_in_view(flight, steps[-1] if direction == "up" else steps[0], pose, camera, exact),
        left_wall_m=left,
        right_wall_m=right,
        obstacle_m=_obstacle(solids, pose, chair),
    )


def _nosings(flight: Flight, pose: Pose, direction: Direction) -> Float[np.ndarray, "n 3"]:
    """Return the nosings ahead of the chair's middle, the nearest first."""
    steps = [step for step in flight.staircase.steps[:: 1 if direction == "up" else -1] if not step.missing]
    places = np.array([[step.x_m, 0.0, step.z_m] for step in steps])
    points = crossings(places, np.array([flight.along(step) for step in steps]), pose.R_WB, pose.p_WB)
    return points[points[:, 0] > 0.0]


def _in_view(points_B: Float[np.ndarray, "n 3"], camera: PinholeCamera, exact: ExactView) -> Bool[np.ndarray, " n"]:
    """Return which points are in the image and not behind something."""
    points = (points_B - np.array(camera.mount_m)) @ camera.R_BC
    z = np.maximum(points[:, 2], 1e-6)
    u = np.round(camera.fx_px * points[:, 0] / z + camera.cx_px)
    v = np.round(camera.fy_px * points[:, 1] / z + camera.cy_px)
    inside = (points[:, 2] > 0.1) & (u >= 0) & (u < camera.width_px) & (v >= 0) & (v < camera.height_px)
    seen = np.zeros(len(points), dtype=np.bool_)
    shown = exact.depth_m[v[inside].astype(int), u[inside].astype(int)]
    seen[inside] = points[inside, 2] < np.nan_to_num(shown, nan=np.inf) + HIDDEN_M
    return seen


def _treads_in_view(solids: list[Solid], exact: ExactView) -> int:
    step_of = np.array([solid.index if solid.kind in ("step", "landing") else -1 for solid in solids])
    shown = step_of[exact.face[(exact.face >= 0) & (exact.face % 6 == UPPER_SIDE)] // 6]
    return int(np.count_nonzero(np.bincount(shown[shown >= 0]) > LEAST_TREAD * exact.face.size))


def _end_in_view(flight: Flight, step: Step, pose: Pose, camera: PinholeCamera, exact: ExactView) -> bool:
    aside = np.linspace(-0.5, 0.5, 21)[:, None] * flight.staircase.width_m
    points_W = np.array([step.x_m, 0.0, step.z_m]) + aside * flight.along(step)
    return bool(_in_view((points_W - pose.p_WB) @ pose.R_WB, camera, exact).any())


def _walls(
    staircase: Staircase, solids: list[Solid], pose: Pose, direction: Direction, exact: ExactView
) -> tuple[float | None, float | None]:
    """Return the free widths at the chair's left and right, to the nearest of wall and rail that is in view."""
    half = 0.5 * staircase.width_m
    shown = np.bincount(exact.face[exact.face >= 0] // 6, minlength=len(solids)) / exact.face.size
    free: list[float | None] = []
    for side in (1.0, -1.0):
        widths = []
        for kind, inner in (("wall", half), ("rail", half - RAIL_INSET_M - 0.5 * RAIL_M)):
            there = [i for i, solid in enumerate(solids) if solid.kind == kind and side * solid.centre_W[1] > 0.5 * half]
            widths += [inner - side * float(pose.p_WB[1])] if shown[there].sum() > LEAST_WALL else []
        free.append(min(widths, default=None))
    return (free[0], free[1]) if direction == "up" else (free[1], free[0])


def _obstacle(solids: list[Solid], pose: Pose, chair: ChairDescription) -> float | None:
    """Return how far ahead something stands between the tracks' outer sides, to a centimetre."""
    half = 0.5 * (chair.tracks.gauge_m + chair.tracks.belt_width_m)
    found = []
    for solid in solids:
        if solid.kind in OBSTACLES:
            axes = [np.linspace(-h, h, max(2, round(2.0 * h / GRAIN_M) + 1)) for h in solid.half_m]
            points_K = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
            x, y, z = ((solid.centre_W + points_K @ solid.R_WK.T - pose.p_WB) @ pose.R_WB).T
            hit = (np.abs(y) <= half) & (z >= SWEPT_HEIGHT_M[0]) & (z <= SWEPT_HEIGHT_M[1]) & (x > 0.0)
            found += [float(x[hit].min())] if hit.any() else []
    return min(found, default=None)
