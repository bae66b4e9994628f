"""Planes and lines of a frame as plane segmentation reports them, and frames of solids, for the tests of perception."""

from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.rotations import rotation_z
from treadline.perception._plane_segmentation import Ends, Line, Surface
from treadline.plant.sensors.camera import Camera
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Stair
from treadline.vehicle.staircase import build_staircase

# Literals, so that a changed value in the code is detected here.
BEYOND = 1

CAMERA = read_chair("wheelchair").camera_at(240)
DOWN_W = np.array([0.0, 0.0, -1.0])
LEG_HALF_M = np.array([0.06, 0.06, 0.4])
"""Half sizes of a leg of a table or of a person."""


def ends_at(columns: Any, rows: Any) -> Ends:
    """Return the ends of a surface in some columns, beyond which something further away is seen."""
    return Ends(columns=np.asarray(columns), rows=np.asarray(rows, dtype=float), follows=np.full(len(columns), BEYOND))


NO_ENDS = ends_at(np.arange(0), np.zeros(0))


def surface(normal: Float[np.ndarray, " 3"], distance_m: float = 2.0, sigma_rad: float = 3.5e-4, **fields: Any) -> Surface:
    """Return a plane so far away, its normal known so well."""
    return Surface(
        normal=normal / distance_m,
        covariance=(sigma_rad / distance_m) ** 2 * np.eye(3),
        blocks=np.arange(9),
        **({"centre": normal * distance_m, "upper": NO_ENDS, "lower": NO_ENDS} | fields),
    )


def line_between(ends_m: Float[np.ndarray, "2 3"], normal: Float[np.ndarray, " 3"], **fields: Any) -> Line:
    """Return a line with its ends in C, and the normal of the plane through the camera that holds it."""
    common = {"covariance": 3.5e-4**2 * np.eye(3), "count": 200}
    return Line(normal=normal / np.linalg.norm(normal), middle=ends_m.mean(axis=0), ends_m=ends_m, **(common | fields))


def frame_of(
    scene: Any, camera: PinholeCamera, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"], seed: Any, **options: Any
) -> tuple[RgbdFrame, Float[np.ndarray, " 3"]]:
    """Return what a chair's camera sees of a scene from a pose of the chair, and down in C."""
    R_WC = R_WB @ camera.R_BC
    made = Camera(scene, camera, rng=np.random.default_rng(seed), **options)
    return made.frame(0.0, R_WC, p_WB + R_WB @ np.array(camera.mount_m)), R_WC.T @ DOWN_W


def on_a_flight(seed: int, heading_deg: float, **options: Any) -> tuple[RgbdFrame, Float[np.ndarray, " 3"]]:
    """Return a frame seen from a flight of 28°, and down in C."""
    rng = np.random.default_rng(seed)
    staircase = build_staircase(Stair(slope_deg=28.0), rng)
    R_WB = staircase.R_WS @ rotation_z(heading_deg * DEG)
    return frame_of(staircase, CAMERA, R_WB, staircase.p_WS + staircase.R_WS @ np.array([1.0, 0.0, 0.0]), rng, **options)
