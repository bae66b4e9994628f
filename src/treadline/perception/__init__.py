"""From a depth camera's frame to the heading on the stair."""

from treadline.perception.detector import DetectorConfig, StairDetector
from treadline.perception.sight import Sight, Stages, StairShape

__all__ = ["DetectorConfig", "Sight", "Stages", "StairDetector", "StairShape"]
