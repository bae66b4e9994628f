"""Seat levelling control."""

from treadline.seat.feed_forward import PitchLeveller
from treadline.seat.leveller import Leveller, LevellerConfig

__all__ = ["Leveller", "LevellerConfig", "PitchLeveller"]
