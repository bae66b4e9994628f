"""Whether a frame is worth looking at: how bright, how sharp, how much of it has a depth, and whether it is a new one.

``RgbdFrame -> FrameQuality``. It runs before anything else looks, on each frame: numbers come from every so manieth pixel, the
fingerprint from all.
"""

import zlib

import numpy as np

from treadline.signals import FrameQuality, RgbdFrame

STRIDE_AT_240 = 8
"""Rows and columns from one pixel of the numbers to the next: 1200 pixels, so shares are good to a hundredth."""
WHITE = 255.0


def quality_of(frame: RgbdFrame) -> FrameQuality:
    """Return what tells a frame worth looking at from one that is dark, frozen or empty.

    Two images of a living camera never agree to the last bit, so a checksum tells one that is frozen.
    """
    stride = max(1, round(STRIDE_AT_240 * frame.camera.height_px / 240))
    colours = frame.rgb[::stride, ::stride].astype(np.float32)
    depths = frame.depth_m[::stride, ::stride]
    empty = not (colours.size and depths.size)
    return FrameQuality(
        t_s=frame.t_s,
        fingerprint=zlib.crc32(np.ascontiguousarray(frame.depth_m), zlib.crc32(np.ascontiguousarray(frame.rgb))),
        brightness=0.0 if empty else float(colours.mean()) / WHITE,
        contrast=0.0 if empty else float(colours.std()) / WHITE,
        valid_share=0.0 if empty else float(np.mean(np.isfinite(depths) & (depths > 0.0))),
    )
