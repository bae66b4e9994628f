"""Depth by matching windows of pixels: active stereo, and what a window does at depth edges."""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from treadline.core.images import PinholeCamera
from treadline.plant.sensors.camera import matching_kernels
from treadline.plant.sensors.camera.depth_errors import FILL_SPREAD, SENSOR_WIDTH_PX, ActiveStereo

JUMP_PX = 1.0
"""Smallest disparity difference between neighbouring sensor pixels that counts as a jump [px]: both sides of a smaller one match
together. On the steepest surface in range, a tread 0.3 m below a Kinect 1, neighbours differ by B/h = 0.25 px."""


def straddling(disparity: Float32[np.ndarray, "h w"], width_px: int, jump_px: float) -> Bool[np.ndarray, "h w"]:
    """Return the mask of pixels whose window contains a depth jump: a window of w pixels straddles a jump at w - 1 places.

    Args:
        width_px: Width of the window [px of this image].
        jump_px: Smallest disparity difference between neighbouring pixels that counts as a jump.
    """
    # A jump is marked at the first pixel of the pair, or at the lower index.
    jump = np.zeros(disparity.shape, dtype=np.uint8)
    jump[:, :-1] |= np.abs(np.diff(disparity, axis=1)) > jump_px
    jump[:-1] |= np.abs(np.diff(disparity, axis=0)) > jump_px
    size = max(width_px - 1, 1)
    return np.asarray(cv2.dilate(jump, np.ones((size, size), dtype=np.uint8), anchor=(size // 2, size // 2)) > 0)


def stereo_depth(
    sensor: ActiveStereo,
    camera: PinholeCamera,
    exact_m: Float[np.ndarray, "h w"],
    face: Int[np.ndarray, "h w"],
    albedos: Float[np.ndarray, " b"],
    normal: Float32[np.ndarray, " n"],
    places: Int[np.ndarray, " 4"],
) -> Float32[np.ndarray, "h w"]:
    """Return the depth that a stereo camera measures.

    Args:
        normal: Normal numbers, correlated over the matching window.
        places: Start positions of this frame's random numbers.
    """
    scale = camera.width_px / SENSOR_WIDTH_PX
    disparity = np.nan_to_num(sensor.strength_px_m / exact_m).astype(np.float32)
    size = 2 * round(0.5 * (sensor.window_px - 1) * scale) + 1
    near = cv2.dilate(disparity, np.ones((size, size), dtype=np.uint8)) if size > 1 else disparity
    # On a plane the largest disparity of a window differs as well: only an edge between two pixels makes a window fail.
    fattened = straddling(disparity, size + 1, JUMP_PX / scale) & (near - disparity > JUMP_PX / scale)
    measured = np.empty(exact_m.shape, dtype=np.float32)
    matching_kernels.stereo(
        exact_m,
        face,
        disparity,
        np.where(fattened, near, np.float32(-1.0)),
        scale,
        camera.fx_px,
        camera.fy_px,
        camera.cx_px,
        camera.cy_px,
        albedos,
        sensor.strength_px_m,
        sensor.sigma_px,
        sensor.step_px,
        sensor.near_m,
        sensor.far_m,
        1.0 / sensor.fill_m**2,
        FILL_SPREAD,
        normal,
        places,
        measured,
    )
    return measured
