"""Keeping the seat level."""

from treadline.seat.leveller import Leveller, LevellerConfig

__all__ = ["Leveller", "LevellerConfig"]
