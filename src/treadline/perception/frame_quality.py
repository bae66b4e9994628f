"""Frame quality: brightness, contrast, valid depth fraction and fingerprint.

``RgbdFrame -> FrameQuality``. It precedes all other processing of a frame: statistics use every n-th pixel, the fingerprint the
whole depth image. The heading uses depth; colours are evaluated only if depth is scarce, because rendering them is expensive.
"""

import zlib

import numpy as np

from treadline.core.camera_images import RgbdFrame
from treadline.core.signals import FrameQuality

STRIDE_AT_240 = 8
"""Subsampling for the statistics at 240 rows [px]: 1200 pixels, so fractions are accurate to a hundredth."""
WHITE = 255.0
"""Largest colour value."""
ENOUGH = 0.4
"""Valid depth fraction above which colours are not evaluated."""
UNASKED = (0.5, 0.25)
"""Brightness and contrast reported without evaluation."""


def quality_of(frame: RgbdFrame, obstacle_m: float | None = None) -> FrameQuality:
    """Return the quality measures of a frame.

    Two depth images of a working camera never agree in all bits, so a checksum detects a frozen one.

    Args:
        obstacle_m: Distance from mid-track to the nearest obstacle on the ground in the frame [m]; None without one.
    """
    stride = max(1, round(STRIDE_AT_240 * frame.camera.height_px / 240))
    depths = frame.depth_m[::stride, ::stride]
    share = float(np.mean(np.isfinite(depths) & (depths > 0.0))) if depths.size else 0.0
    fingerprint = zlib.crc32(np.ascontiguousarray(frame.depth_m).data)
    brightness, contrast = UNASKED
    if share < ENOUGH:
        brightness, contrast = _light_of(frame, stride)
        # Depth images without any return are identical; the colours still show a working camera.
        fingerprint = zlib.crc32(np.ascontiguousarray(frame.rgb).data, fingerprint)
    return FrameQuality(
        t_s=frame.t_s,
        fingerprint=fingerprint,
        brightness=brightness,
        contrast=contrast,
        valid_share=share,
        obstacle_m=obstacle_m,
    )


def _light_of(frame: RgbdFrame, stride: int) -> tuple[float, float]:
    """Return mean and standard deviation of the colours, relative to white."""
    colours = frame.rgb[::stride, ::stride].astype(np.float32)
    return (float(colours.mean()) / WHITE, float(colours.std()) / WHITE) if colours.size else (0.0, 0.0)
