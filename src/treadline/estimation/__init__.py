"""Heading between frames: vision, gyro and their disagreement; and how the camera sits on the chair."""

from treadline.estimation.filter import FilterConfig, HeadingFilter
from treadline.estimation.health import HeadingHealth
from treadline.estimation.mount import MountCalibrator, MountConfig, MountEstimate, calibrated
from treadline.estimation.offset import OffsetEstimator

__all__ = [
    "FilterConfig",
    "HeadingFilter",
    "HeadingHealth",
    "MountCalibrator",
    "MountConfig",
    "MountEstimate",
    "OffsetEstimator",
    "calibrated",
]
