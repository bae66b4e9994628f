"""Whether a frame is worth looking at: how bright, how sharp, how much of it has a depth, and whether it is a new one.

``RgbdFrame -> FrameQuality``. It runs before anything else looks, on each frame: numbers come from every n-th pixel, the
fingerprint from the whole depth image. The heading comes from depth; colours are asked only where depth is scarce, for they cost.
"""

import zlib

import numpy as np
from jaxtyping import Float

from treadline.perception.level import obstacle_on_the_level
from treadline.perception.sight import SWEPT_HALF_M
from treadline.signals import FrameQuality, RgbdFrame

STRIDE_AT_240 = 8
"""Rows and columns from one pixel of the numbers to the next: 1200 pixels, so shares are good to a hundredth."""
WHITE = 255.0
ENOUGH = 0.4
"""Share of a depth image from which on nobody asks what the colours are like."""
UNASKED = (0.5, 0.25)
"""Brightness and contrast of colours that were not looked at."""


def quality_of(
    frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None = None, swept_half_m: float = SWEPT_HALF_M
) -> FrameQuality:
    """Return what tells a frame worth looking at from one that is dark, frozen or empty, and whether something is in the way.

    Two depth images of a living camera never agree to the last bit, so a checksum tells one that is frozen.

    Args:
        gravity_C: Unit vector that points down, in the camera's frame; without it nobody looks for what stands on the ground.
        swept_half_m: What the chair sweeps to either side.
    """
    stride = max(1, round(STRIDE_AT_240 * frame.camera.height_px / 240))
    depths = frame.depth_m[::stride, ::stride]
    share = float(np.mean(np.isfinite(depths) & (depths > 0.0))) if depths.size else 0.0
    fingerprint = zlib.crc32(np.ascontiguousarray(frame.depth_m).data)
    brightness, contrast = UNASKED
    if share < ENOUGH:
        brightness, contrast = _light_of(frame, stride)
        # Depth images without a depth are all alike; the colours still tell a living camera.
        fingerprint = zlib.crc32(np.ascontiguousarray(frame.rgb).data, fingerprint)
    return FrameQuality(
        t_s=frame.t_s,
        fingerprint=fingerprint,
        brightness=brightness,
        contrast=contrast,
        valid_share=share,
        obstacle_m=None if gravity_C is None or share == 0.0 else obstacle_on_the_level(frame, gravity_C, swept_half_m),
    )


def _light_of(frame: RgbdFrame, stride: int) -> tuple[float, float]:
    """Return mean and standard deviation of the colours, of white."""
    colours = frame.rgb[::stride, ::stride].astype(np.float32)
    return (float(colours.mean()) / WHITE, float(colours.std()) / WHITE) if colours.size else (0.0, 0.0)
