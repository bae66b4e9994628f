"""Heading estimation from vision and gyro, sensor fault detection, and camera mount calibration."""

from treadline.estimation.filter import FilterConfig, HeadingFilter
from treadline.estimation.health import HeadingHealth
from treadline.estimation.mount import MountCalibrator, MountConfig, MountEstimate, calibrated
from treadline.estimation.mount_monitor import MountMonitor
from treadline.estimation.offset import OffsetEstimator

__all__ = [
    "FilterConfig",
    "HeadingFilter",
    "HeadingHealth",
    "MountCalibrator",
    "MountConfig",
    "MountEstimate",
    "MountMonitor",
    "OffsetEstimator",
    "calibrated",
]
