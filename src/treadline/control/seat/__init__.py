"""Seat levelling control."""

from treadline.control.seat.feed_forward import PitchLeveller
from treadline.control.seat.leveller import Leveller, LevellerConfig

__all__ = ["Leveller", "LevellerConfig", "PitchLeveller"]
