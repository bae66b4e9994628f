"""Frame quality: brightness, contrast, valid depth fraction and fingerprint.

``RgbdFrame -> FrameQuality``. It precedes all other processing of a frame: statistics use every n-th pixel, the fingerprint the
whole depth image. The heading uses depth; colours are evaluated only if depth is scarce, because rendering them is expensive.
"""

import zlib

import numpy as np

from treadline.core.camera_images import RgbdFrame
from treadline.core.signals import FrameQuality

ENOUGH = 0.4
"""Valid depth fraction above which colours are not evaluated, and a frame without planes does not lack depth."""


def quality_of(frame: RgbdFrame, obstacle_m: float | None = None) -> FrameQuality:
    """Return the quality measures of a frame.

    Two depth images of a working camera never agree in all bits, so a checksum detects a frozen one.

    Args:
        obstacle_m: Distance from mid-track to the nearest obstacle on the ground in the frame [m]; None without one.
    """
    # 1200 pixels, so that fractions are accurate to a hundredth.
    stride = max(1, round(frame.camera.height_px / 30))
    depths = frame.depth_m[::stride, ::stride]
    share = float(np.mean(np.isfinite(depths) & (depths > 0.0))) if depths.size else 0.0
    fingerprint = zlib.crc32(np.ascontiguousarray(frame.depth_m).data)
    brightness, contrast = 0.5, 0.25  # mean and standard deviation relative to white, of a frame whose colours are not evaluated
    if share < ENOUGH:
        colours = frame.rgb[::stride, ::stride].astype(np.float32) / np.iinfo(np.uint8).max
        brightness, contrast = (float(colours.mean()), float(colours.std())) if colours.size else (0.0, 0.0)
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
