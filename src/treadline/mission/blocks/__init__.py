"""The blocks of Fig. 2 as handlers of one signal: signals in, signals out.

The in-process loop (``mission.loop``) wires the blocks by calls, the nodes (``treadline.ros``) wire the same blocks by channels.
"""

from treadline.mission.blocks._camera_block import CameraBlock, Detection, Detector
from treadline.mission.blocks._driver_block import DriverBlock
from treadline.mission.blocks._seat_block import SeatBlock, SeatLeveller

__all__ = ["CameraBlock", "Detection", "Detector", "DriverBlock", "SeatBlock", "SeatLeveller"]
