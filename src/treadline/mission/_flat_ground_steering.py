"""Steering on flat ground: search for the stair, turn square to it, keep square while approaching. ``HeadingEstimate -> turn``.

Tracks that turn on the spot skid. The ratio of turn to belt travel is not constant, so the heading closes the loop. Turns are
given as half the belt speed difference, right minus left [m/s].
"""

import math
from dataclasses import dataclass

from treadline.core.angles import DEG
from treadline.core.signals import TICK_S, HeadingEstimate


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelConfig:
    """Gains, limits and search angles of the steering on flat ground."""

    gauge_m: float
    """Distance between the belts' centre lines [m]."""
    square_rad: float = 1.0 * DEG
    """Heading error below which the chair counts as square to the stair [rad]."""
    square_s: float = 0.5
    """Time below that error before the chair is square [s]."""
    turn_gain_per_s: float = 1.5
    """Turn rate per heading error on the spot [1/s]."""
    turn_rad_s: float = 10.0 * DEG
    """Largest turn rate on the spot [rad/s]: the camera sees the stair turn by a degree from frame to frame. From 30° the chair is
    square after 4.4 s, with 0.01 m/s² at the passenger (friction 1.0/1.0, 75 kg)."""
    turn_m_s2: float = 0.12
    """Rate of change of half the belt speed difference [m/s²]: with high friction a sudden turn breaks loose with 4 m/s²."""
    skid: float = 1.27
    """Ratio of belt speed to that of a turn without skidding: the belts drag each other sideways. Statics of the wheelchair's road
    wheels with Table I's friction (docs/decisions/0013); 1.16 to 1.40 with other friction, which the heading loop makes up for."""
    keep_m_s_rad: float = 1.5
    """Half the belt speed difference per heading error while the belts stand on several heights [m/s per rad]."""
    keep_limit_m_s: float = 0.10
    """Largest half of the belt speed difference while keeping a heading [m/s]."""
    look_s: float = 1.0
    """Time to look for a stair before the search turns [s]."""
    sweep_rad: float = 40.0 * DEG
    """Search angle to each side [rad]."""


class LevelSteering:
    """Heading loop on flat ground. The search for a stair uses the gyro instead of the heading estimate."""

    def __init__(self, config: LevelConfig) -> None:
        self._config = config
        self._square_since_s: float | None = None
        self._looked_since_s: float | None = None
        self._swept_rad = 0.0
        self._half_m_s = 0.0
        self._legs = [config.sweep_rad, -config.sweep_rad, 0.0]

    def towards(self, estimate: HeadingEstimate) -> float:
        """Return the turn on the spot that makes the chair square [m/s]."""
        config = self._config
        rate = -config.turn_gain_per_s * estimate.heading_rad
        return self._half(min(max(rate, -config.turn_rad_s), config.turn_rad_s))

    def keep(
        self,
        estimate: HeadingEstimate | None,
        target_rad: float = 0.0,
        *,
        spare_rad: float = 0.0,
        keep_m_s_rad: float | None = None,
    ) -> float:
        """Return the turn that keeps a heading while the chair drives or pitches [m/s]; 0 without an estimate.

        Args:
            estimate: Latest heading estimate, if any.
            target_rad: Heading set point.
            spare_rad: Dead band of the heading error.
            keep_m_s_rad: Gain beyond ``spare_rad``; None for the configured gain.
        """
        if estimate is None:
            return 0.0
        config = self._config
        off = target_rad - estimate.heading_rad
        gain = config.keep_m_s_rad if keep_m_s_rad is None else keep_m_s_rad
        half = gain * math.copysign(max(abs(off) - spare_rad, 0.0), off)
        return min(max(half, -config.keep_limit_m_s), config.keep_limit_m_s)

    def within(self, estimate: HeadingEstimate) -> bool:
        """Return whether the heading error is that of a square chair."""
        return abs(estimate.heading_rad) <= self._config.square_rad

    def is_square(self, estimate: HeadingEstimate, t_s: float) -> bool:
        """Return whether the chair has been square to the stair for ``square_s``."""
        if not self.within(estimate):
            self._square_since_s = None
            return False
        if self._square_since_s is None:
            self._square_since_s = t_s
        return t_s - self._square_since_s >= self._config.square_s

    def sweep(self, t_s: float, turned_rad: float) -> float:
        """Return the turn of a search to both sides [m/s].

        Args:
            t_s: Mission time.
            turned_rad: Turn since the last call, by the gyro.
        """
        config = self._config
        if self._looked_since_s is None:
            self._looked_since_s = t_s
        if t_s - self._looked_since_s < config.look_s:
            return 0.0
        self._swept_rad += turned_rad
        if self._legs and abs(self._legs[0] - self._swept_rad) < 2.0 * DEG:
            self._legs.pop(0)
        return self._half(math.copysign(config.turn_rad_s, self._legs[0] - self._swept_rad)) if self._legs else 0.0

    def has_swept(self) -> bool:
        """Return whether the search has ended; it starts again then, because a person may re-arm the chair."""
        ended = not self._legs
        if ended:
            self._legs = [self._config.sweep_rad, -self._config.sweep_rad, 0.0]
        return ended

    def rest(self) -> None:
        """Start the next turn from rest, because the belts are braked."""
        self._half_m_s = 0.0

    def _half(self, rate_rad_s: float) -> float:
        """Return half the belt speed difference for a turn rate; call at each tick of a turn."""
        wanted = 0.5 * self._config.gauge_m * self._config.skid * rate_rad_s
        change = self._config.turn_m_s2 * TICK_S
        self._half_m_s = min(max(wanted, self._half_m_s - change), self._half_m_s + change)
        return self._half_m_s
