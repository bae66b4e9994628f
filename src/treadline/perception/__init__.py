"""From a depth camera's frame to the heading on the stair."""

from treadline.perception.detector import DetectorConfig, Seen, StairDetector
from treadline.perception.sight import Sight, Stages, StairShape

__all__ = ["DetectorConfig", "Seen", "Sight", "Stages", "StairDetector", "StairShape"]
