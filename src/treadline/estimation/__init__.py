"""Heading between frames: vision, gyro and their disagreement."""

from treadline.estimation.filter import FilterConfig, HeadingFilter
from treadline.estimation.offset import OffsetEstimator

__all__ = ["FilterConfig", "HeadingFilter", "OffsetEstimator"]
