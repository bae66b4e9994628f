"""A chair at the landing's edge for tests of the crest and edge sequences: it follows its commands, and no stair is simulated."""

import math
from typing import Any, ClassVar

from world import belts, flipper, imu

from treadline.control.flipper import FlipperGeometry
from treadline.core.angles import DEG

GEOMETRY = FlipperGeometry(pivot_m=0.475, radius_m=0.07, length_m=0.45)
FLIPPER_N = 0.5 * 3.0 * 9.81
"""Weight of the flipper of 3 kg, as far as its tip carries it."""


class Chassis:
    """A chair whose tip load and pitch rate the test gives; a subclass says where the flipper stops."""

    AHEAD: ClassVar[float]
    """1 if the nosing lies ahead of mid-track, -1 if behind."""

    def __init__(self, sequence: Any, nosing_m: float, pitch_deg: float) -> None:
        self.sequence, self.nosing_m, self.pitch_deg = sequence, nosing_m, pitch_deg
        self.angle_rad, self.speed_m_s, self.t_s = 40.0 * DEG, 0.0, 0.0

    def stopped(self, tip_n: float) -> float:
        """Return the flipper's angle, given the load on its tip."""
        raise NotImplementedError

    def run(self, duration_s: float, tip_n: float = 0.0, pitch_deg_s: float = 0.0) -> Any:
        """Continue under a constant tip load and return the last command."""
        for _ in range(round(duration_s / 0.01)):
            self.t_s += 0.01
            self.pitch_deg += pitch_deg_s * 0.01
            lever = 0.45 * math.cos(self.angle_rad + self.pitch_deg * DEG)
            command = self.sequence.step(
                imu(self.t_s, self.pitch_deg * DEG),
                flipper(self.t_s, self.angle_rad, (FLIPPER_N - tip_n) * lever),
                belts(self.t_s, self.speed_m_s, self.speed_m_s),
            )
            self.speed_m_s = command.speed_m_s
            self.nosing_m -= self.AHEAD * self.speed_m_s * 0.01
            self.angle_rad += command.flipper.rate_rad_s * 0.01
            self.angle_rad = self.stopped(tip_n)
        return command

    def until(self, stage: str, tip_n: float = 0.0, pitch_deg_s: float = 0.0) -> Any:
        """Continue until a stage begins."""
        for _ in range(3000):
            command = self.run(0.01, tip_n, pitch_deg_s)
            if command.stage == stage:
                return command
        raise AssertionError(f"still in stage {command.stage!r} after 30 s")
