"""The guard, the last block before the plant: passes commands, limits them, or holds the chair.

``TrackCommand, SeatCommand, FlipperCommand -> Commands``. A value that is not finite, a sensor that is silent, frozen or of another
time, belts that do not follow their command, and a planner or driver that has stopped lead to HOLD (zero speed, brake), latched
until a person re-arms. The guard computes with plain numbers, is independent of planner and driver, and makes no claim to any
safety standard.
"""

from treadline.guard._admission import ReadingAdmission
from treadline.guard._guard_config import SILENCE_S, TIPPING, GuardConfig
from treadline.guard._last_guard import LastGuard
from treadline.guard.guard import Commands, Guard

__all__ = ["SILENCE_S", "TIPPING", "Commands", "Guard", "GuardConfig", "LastGuard", "ReadingAdmission"]
