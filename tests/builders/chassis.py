"""A chair at the landing's edge for tests of the crest and edge sequences: it follows its commands, and no stair is simulated."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

from world import belts, flipper, imu

from treadline.control.flipper import FlipperGeometry
from treadline.core.angles import DEG
from treadline.estimation.known_nosings import KnownNosing, KnownNosings

GEOMETRY = FlipperGeometry(pivot_m=0.475, radius_m=0.07, length_m=0.45)
FLIPPER_N = 0.5 * 3.0 * 9.81
"""Weight of the flipper of 3 kg, as far as its tip carries it."""


def known(pitch_rad: float, top_m: float, slopes_rad: Sequence[float]) -> KnownNosings:
    """Return nosings 0.34 m apart, the uppermost ``top_m`` ahead, with the slopes between them from there down."""
    nosings, (ahead_m, above_m) = [], (top_m, 0.0)
    for slope_rad in (*slopes_rad, 0.0):
        nosings.append(KnownNosing(ahead_m, above_m, 0.001))
        ahead_m -= 0.34 * math.cos(slope_rad - pitch_rad)
        above_m -= 0.34 * math.sin(slope_rad - pitch_rad)
    zero_m = max(nosing.above_m for nosing in nosings)
    return KnownNosings(pitch_rad, tuple(n._replace(above_m=n.above_m - zero_m) for n in nosings[::-1]))


class Chassis:
    """A chair whose tip load and pitch rate the test gives; a subclass says where the flipper stops."""

    AHEAD: ClassVar[float]
    """1 if the nosing lies ahead of mid-track, -1 if behind."""
    mapped_m: float = 0.0
    """Error of the nosings' places on the map [m]."""
    rise_m: float = 0.0
    """Height of the lowest nosing above the floor [m]."""

    def __init__(self, sequence: Any, nosing_m: float, pitch_deg: float, slopes_rad: Sequence[float]) -> None:
        self.sequence, self.nosing_m, self.pitch_deg, self.slopes_rad = sequence, nosing_m, pitch_deg, slopes_rad
        self.angle_rad, self.speed_m_s, self.t_s = 40.0 * DEG, 0.0, 0.0

    def stopped(self, tip_n: float) -> float:
        """Return the flipper's angle, given the load on its tip."""
        raise NotImplementedError

    def known(self) -> KnownNosings:
        """Return the nosings as the map shows them."""
        return known(self.pitch_deg * DEG, self.AHEAD * self.nosing_m + self.mapped_m, self.slopes_rad)

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
                replace(self.known(), rise_m=self.rise_m),
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
