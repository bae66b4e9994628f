"""Stair detection: from a depth camera frame to the heading on the stair."""

from treadline.perception._stair_shape import StairShape
from treadline.perception.detection import Stages, StairDetection
from treadline.perception.detector import DetectorConfig, FrameResult, StairDetector

__all__ = ["DetectorConfig", "FrameResult", "Stages", "StairDetection", "StairDetector", "StairShape"]
