"""The blocks of Fig. 2 as handlers of one signal: signals in, signals out.

The in-process loop (``mission.loop``) wires the blocks by calls, the nodes (``treadline.nodes``) wire the same blocks by channels.
"""

from treadline.mission.blocks.camera import CameraBlock, Detection, Detector
from treadline.mission.blocks.driver import DriverBlock
from treadline.mission.blocks.seat import SeatBlock, SeatLeveller

__all__ = ["CameraBlock", "Detection", "Detector", "DriverBlock", "SeatBlock", "SeatLeveller"]
