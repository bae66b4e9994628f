"""Heading estimation from vision and gyro, sensor fault detection, and camera mount monitoring."""

from treadline.estimation._fault_detection import StuckGyroDetector, StuckRule
from treadline.estimation._mount_monitor import MountMonitor
from treadline.estimation.heading_filter import FilterConfig, HeadingFilter
from treadline.estimation.offset import OffsetEstimator
