"""Ground truth of the stair in a view, in the quantities of ``StairMap``."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from scenes.clutter import OBSTACLES, RAIL_INSET_M, RAIL_M
from scenes.flight import Direction, Pose, TiltedFlight
from treadline.core.camera_images import PinholeCamera
from treadline.core.rotations import Vector3
from treadline.plant.sensors.camera import ExactView
from treadline.plant.sensors.camera.solids import SceneBox
from treadline.scenario.chair import ChairDescription
from treadline.vehicle.staircase import Staircase, Step
from treadline.vehicle.visibility import crossings

SWEPT_HEIGHT_M = (0.06, 1.4)
"""Height range of the swept volume above the lower line of the belts [m]: the belts climb lower objects, and the rider is lower
than the upper limit."""
GRAIN_M = 0.01
"""Spacing of the points of an object tested for the swept volume [m]."""
LEAST_WALL = 0.01
"""Least image fraction of a visible wall or rail."""
LEAST_TREAD = 0.01
"""Least image fraction of a visible tread."""
UPPER_SIDE = 5
"""Index of the upper side of a box."""
BOW_ITERATIONS = 4
"""Newton steps to intersect a bowed nosing with the chair's middle plane."""
HIDDEN_M = 0.03
"""Distance behind the visible surface beyond which a nosing counts as hidden [m]."""


Side = Literal["wall", "open"]
"""Side of a flight: with a wall or rail, or with a drop."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StairTruth:
    """Ground truth of the stair, in the quantities of ``StairMap``."""

    direction: Direction
    heading_rad: float
    edge_C: Vector3
    """Unit vector along the nosings, pointing to the chair's right."""
    normal_C: Vector3
    """Unit vector normal to the nosing plane, pointing away from the stair."""
    slope_rad: float
    rise_m: float
    run_m: float
    """Design run of the steps [m], without jitter; ``rise_m`` likewise."""
    share: float
    """Image fraction of steps."""
    nosings_B: Float[np.ndarray, "n 3"]
    """Intersections of the nosings ahead with the chair's middle plane [m], nearest first, including hidden ones and those whose
    intersection lies next to the stair. Worn nosings are treated as sharp."""
    nosing_in_view: Bool[np.ndarray, " n"]
    """Whether each intersection is on the stair, in the image and not hidden."""
    treads_in_view: int
    """Number of steps with a visible tread, the landing included. A single one can also be a doorstep."""
    end_in_view: bool
    """Whether any part of the flight's last nosing is in view."""
    left_wall_m: float | None
    """Distance from the chair's middle perpendicular to the wall or rail on the left [m]; None if not in view."""
    right_wall_m: float | None
    """Distance from the chair's middle perpendicular to the wall or rail on the right [m]; None if not in view."""
    obstacle_m: float | None
    """Distance along x to the nearest obstacle in the volume swept by the tracks [m]."""
    left_edge_m: float
    """Distance from the chair's middle to the left side of the flight, square to the flight [m]; also if not in view."""
    right_edge_m: float
    """Distance from the chair's middle to the right side of the flight, square to the flight [m]; also if not in view."""
    left_side: Side
    """What stands along the left side: a wall or rail, or nothing."""
    right_side: Side
    """What stands along the right side."""
    bow_m: float
    """Sagitta of the nosings over the width [m]; positive if the middle protrudes towards the foot."""

    @property
    def width_m(self) -> float:
        """Width of the flight [m]."""
        return self.left_edge_m + self.right_edge_m


def stair_truth(
    direction: Direction,
    flight: TiltedFlight,
    pose: Pose,
    camera: PinholeCamera,
    solids: list[SceneBox],
    exact: ExactView,
    chair: ChairDescription,
) -> StairTruth:
    """Return the ground truth of a flight from a pose of the chair."""
    right_W = np.array([0.0, -1.0 if direction == "up" else 1.0, 0.0])
    edge_B = pose.R_WB.T @ right_W
    is_step = np.array([*(solid.kind == "step" for solid in solids), False])
    staircase = flight.staircase
    nosings = _nosings(flight, pose, direction)
    on_stair = np.abs((pose.p_WB + nosings @ pose.R_WB.T)[:, 1]) <= 0.5 * staircase.width_m
    steps = staircase.steps
    up = 1.0 if direction == "up" else -1.0
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
        left_edge_m=0.5 * staircase.width_m - up * float(pose.p_WB[1]),
        right_edge_m=0.5 * staircase.width_m + up * float(pose.p_WB[1]),
        left_side=_side(staircase, solids, up),
        right_side=_side(staircase, solids, -up),
        bow_m=flight.bow_m,
    )


def _nosings(flight: TiltedFlight, pose: Pose, direction: Direction) -> Float[np.ndarray, "n 3"]:
    """Return the nosings ahead of the chair's middle, nearest first."""
    steps = _steps(flight, direction)
    aside = np.zeros(len(steps))
    for _ in range(1 if flight.bow_m == 0.0 else BOW_ITERATIONS):
        lines = [flight.nosing(step, float(y)) for step, y in zip(steps, aside, strict=True)]
        points = crossings(np.array([place for place, _ in lines]), np.array([along for _, along in lines]), pose.R_WB, pose.p_WB)
        if flight.bow_m != 0.0:
            points_W = pose.p_WB + points @ pose.R_WB.T
            aside = np.array([flight.along(step) @ (at - step.nosing_F) for step, at in zip(steps, points_W, strict=True)])
    return points[points[:, 0] > 0.0]


def _steps(flight: TiltedFlight, direction: Direction) -> list[Step]:
    """Return the steps with a tread in the order of a chair that goes up or down."""
    return [step for step in flight.staircase.steps[:: 1 if direction == "up" else -1] if not step.missing]


def _side(staircase: Staircase, solids: list[SceneBox], sign: float) -> Side:
    """Return what stands along a side of the flight: the left one going up for a sign of 1."""
    walled = staircase.walls in ("both", "left" if sign > 0.0 else "right")
    railed = any(solid.kind == "rail" and sign * solid.centre_W[1] > 0.0 for solid in solids)
    return "wall" if walled or railed else "open"


def _in_view(points_B: Float[np.ndarray, "n 3"], camera: PinholeCamera, exact: ExactView) -> Bool[np.ndarray, " n"]:
    """Return the mask of points in the image and not hidden."""
    points = (points_B - np.array(camera.mount_m)) @ camera.R_BC
    z = np.maximum(points[:, 2], 1e-6)
    u = np.round(camera.fx_px * points[:, 0] / z + camera.cx_px)
    v = np.round(camera.fy_px * points[:, 1] / z + camera.cy_px)
    inside = (points[:, 2] > 0.1) & (u >= 0) & (u < camera.width_px) & (v >= 0) & (v < camera.height_px)
    seen = np.zeros(len(points), dtype=np.bool_)
    shown = exact.depth_m[v[inside].astype(int), u[inside].astype(int)]
    seen[inside] = points[inside, 2] < np.nan_to_num(shown, nan=np.inf) + HIDDEN_M
    return seen


def _treads_in_view(solids: list[SceneBox], exact: ExactView) -> int:
    step_of = np.array([solid.index if solid.kind in ("step", "landing") else -1 for solid in solids])
    shown = step_of[exact.face[(exact.face >= 0) & (exact.face % 6 == UPPER_SIDE)] // 6]
    return int(np.count_nonzero(np.bincount(shown[shown >= 0]) > LEAST_TREAD * exact.face.size))


def _end_in_view(flight: TiltedFlight, step: Step, pose: Pose, camera: PinholeCamera, exact: ExactView) -> bool:
    aside = np.linspace(-0.5, 0.5, 21)[:, None] * flight.staircase.width_m
    points_W = step.nosing_F + aside * flight.along(step)
    return bool(_in_view((points_W - pose.p_WB) @ pose.R_WB, camera, exact).any())


def _walls(
    staircase: Staircase, solids: list[SceneBox], pose: Pose, direction: Direction, exact: ExactView
) -> tuple[float | None, float | None]:
    """Return the free widths on the left and right of the chair, to the nearest visible wall or rail."""
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


def _obstacle(solids: list[SceneBox], pose: Pose, chair: ChairDescription) -> float | None:
    """Return the distance to the nearest obstacle between the outer sides of the tracks, to a centimetre."""
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
