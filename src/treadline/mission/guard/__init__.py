"""The last block before the plant: lets a command pass, limits it, or holds.

``TrackCommand -> TrackCommand``. It trusts nobody: what is not finite, a sensor that is silent, frozen or of another time, belts
that do not do as they are told, or a driver that no longer answers ends in HOLD (zero speed, brake), which stays until a person
re-arms. It computes with plain numbers, stands apart from planner and driver, and makes no claim to any safety standard.
"""

from treadline.mission.guard.config import GuardConfig
from treadline.mission.guard.guard import Guard

__all__ = ["Guard", "GuardConfig"]
