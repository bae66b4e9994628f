"""Stair climbing for tracked chairs: simulate, see, identify, steer and level."""

__version__ = "0.2.0"
