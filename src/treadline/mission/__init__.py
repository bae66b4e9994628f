"""Mission: planner, plug-ins, and the loop that connects the blocks, one tick at a time.

Contract: ``mission_blocks.build_blocks(MissionConfig) -> Blocks``; ``loop.Mission`` ticks them; the nodes of ``ros`` wire the same
blocks of Fig. 2, which this package exports.
"""

from treadline.mission._blocks import (
    CameraBlock,
    Detection,
    Detector,
    DriverBlock,
    GravityAtExposure,
    SeatBlock,
    SeatLeveller,
)

__all__ = ["CameraBlock", "Detection", "Detector", "DriverBlock", "GravityAtExposure", "SeatBlock", "SeatLeveller"]
