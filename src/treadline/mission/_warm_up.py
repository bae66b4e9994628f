"""Synthetic frames of a staircase, on which all kernels of a run are compiled before the first real frame."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.rotations import Vector3, rotation_y, rotation_z

RISE_M, RUN_M, STEPS = 0.16, 0.30, 9
"""A flight of 28°, as the shipped scenarios have it."""
NOISE = 0.0015
"""Standard deviation of a depth, per square metre of depth: a structured-light camera's."""
RANGE_M = 6.0
"""Depth beyond which the camera has no return."""
SHADES = {"tread": 190, "riser": 90}
"""Brightness of the two kinds of surface, of 255."""


View = tuple[float, bool, int, float]
"""Pose of the chair: horizontal distance from the first nosing to mid-track [m], positive on the flight; whether the chair lies on
the flight; number of steps; heading [rad]."""
VIEWS: tuple[View, ...] = tuple(
    (*place, heading_deg * DEG)
    for place, heading_deg in itertools.product(
        ((-1.6, False, STEPS), (-1.0, False, STEPS), (0.9, True, STEPS), (1.2, True, 6)), (0.0, 8.0)
    )
)
"""Poses of the warm-up frames: before the flight, on the flight, and with the end of the flight in view, each square and turned."""


def stair_frames(camera: PinholeCamera, *, rises: bool) -> Iterator[tuple[RgbdFrame, Vector3]]:
    """Yield depth and colour images of a staircase, each with the direction of gravity in the camera.

    Every second frame is read-only: a kernel is compiled once for images that come off a wire, and once for converted ones.

    Args:
        camera: The camera on the chair.
        rises: Whether the flight that the camera looks at rises, else it falls.
    """
    rng = np.random.default_rng(0)
    for number, view in enumerate(VIEWS):
        frame, gravity_C = _frame(camera, view, rng, rises=rises)
        for image in (frame.rgb, frame.depth_m):
            image.setflags(write=number % 2 == 1)
        yield frame, gravity_C


def _frame(camera: PinholeCamera, view: View, rng: np.random.Generator, *, rises: bool) -> tuple[RgbdFrame, Vector3]:
    from_foot_m, pitched, steps, heading_rad = view
    towards = math.copysign(1.0, float(camera.R_BC[0, 2]))  # the rear camera looks back
    up = 1.0 if rises else -1.0
    slope_rad = math.atan2(RISE_M, RUN_M)
    # A chair on a flight has its front uphill, whichever way it looks.
    R_WB = rotation_z(heading_rad) @ rotation_y(-slope_rad if pitched else 0.0)
    height_m = up * RISE_M * from_foot_m / RUN_M if pitched else 0.0
    p_WC = R_WB @ np.array(camera.mount_m) + np.array([towards * from_foot_m, 0.0, height_m])
    v, u = np.mgrid[0 : camera.height_px, 0 : camera.width_px]
    rays_C = camera.pixel_to_point(u, v)
    rays_W = rays_C @ (R_WB @ camera.R_BC).T
    depth_m, shade = _cast(towards * rays_W[..., 0], rays_W[..., 2], towards * p_WC[0], p_WC[2], up * RISE_M, steps)
    depth_m = np.where(depth_m < RANGE_M, depth_m, np.nan)
    depth_m += NOISE * depth_m**2 * rng.standard_normal(depth_m.shape)
    grey = np.clip(shade + 4.0 * rng.standard_normal(shade.shape), 0.0, 255.0).astype(np.uint8)
    frame = RgbdFrame(
        t_s=0.0,
        rgb=np.repeat(grey[..., None], 3, axis=-1),
        depth_m=depth_m.astype(np.float32),
        camera=camera,
    )
    return frame, -(R_WB @ camera.R_BC)[2]


def _cast(
    along: Float[np.ndarray, "h w"], upward: Float[np.ndarray, "h w"], from_m: float, height_m: float, rise_m: float, steps: int
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Return distance and shade of the first surface on each ray: floor, risers and treads, the last of which is the landing."""
    depth = np.full(along.shape, np.inf)
    shade = np.zeros(along.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k in range(steps + 1):
            low, high = k * rise_m, (k + 1) * rise_m
            begin, end = (k - 1) * RUN_M if k else -np.inf, k * RUN_M if k < steps else np.inf
            flat = (low - height_m) / upward
            x = from_m + flat * along
            _keep(depth, shade, flat, (x >= begin) & (x < end), SHADES["tread"])
            upright = (k * RUN_M - from_m) / along
            z = height_m + upright * upward
            if k < steps:
                _keep(depth, shade, upright, (z >= min(low, high)) & (z <= max(low, high)), SHADES["riser"])
    return depth, shade


def _keep(
    depth: Float[np.ndarray, "h w"], shade: Float[np.ndarray, "h w"], at: Float[np.ndarray, "h w"], hit: np.ndarray, grey: int
) -> None:
    nearer = hit & (at > 0.0) & (at < depth)
    depth[nearer], shade[nearer] = at[nearer], grey
