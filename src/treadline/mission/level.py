"""On floor and landing: find the stair, turn square to it, keep square while driving at it.

Tracks that turn on the spot skid; how far they turn for what the belts do is no constant, so the turn is closed on the heading.
"""

import math
from dataclasses import dataclass

from treadline.angles import DEG
from treadline.signals import TICK_S, HeadingEstimate


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelConfig:
    """How the chair moves where nothing can tip it."""

    gauge_m: float
    square_rad: float = 1.0 * DEG
    """Within this the chair counts as square to the stair …"""
    square_s: float = 0.5
    """… once it has been for so long."""
    turn_gain_per_s: float = 1.5
    turn_rad_s: float = 7.5 * DEG
    """Faster, belts of high friction chatter: 110 kg on friction 1.0 feel 3.6 to 4.7 m/s² at 10 °/s, 2.0 at this. From
    30° the chair is within 3° after 7.7 s at most."""
    turn_m_s2: float = 0.12
    """How fast the belts are set apart: a turn that begins at once breaks loose with a jolt of 4 m/s² where friction is high."""
    skid: float = 1.4
    """Belt speed over what rolling without skidding would need: one track drags the other."""
    keep_m_s_rad: float = 1.5
    """Half the belts' difference per heading error while the belts are on more than one level."""
    keep_limit_m_s: float = 0.10
    look_s: float = 1.0
    """To look for a stair before turning to find one."""
    sweep_rad: float = 40.0 * DEG


class LevelSteering:
    """Steering on the level, closed on the estimate; the search for a stair is closed on the gyro alone."""

    def __init__(self, config: LevelConfig) -> None:
        self._config = config
        self._square_since_s: float | None = None
        self._looked_since_s: float | None = None
        self._swept_rad = 0.0
        self._half_m_s = 0.0
        self._legs = [config.sweep_rad, -config.sweep_rad, 0.0]

    def towards(self, estimate: HeadingEstimate, target_rad: float = 0.0) -> float:
        """Return half the belts' difference that turns the chair on the spot to a heading."""
        config = self._config
        rate = config.turn_gain_per_s * (target_rad - estimate.heading_rad)
        return self._half(min(max(rate, -config.turn_rad_s), config.turn_rad_s))

    def keep(
        self,
        estimate: HeadingEstimate | None,
        target_rad: float = 0.0,
        *,
        spare_rad: float = 0.0,
        keep_m_s_rad: float | None = None,
    ) -> float:
        """Return half the belts' difference that keeps a heading while the chair drives or pitches; gently.

        Args:
            spare_rad: How far off the chair may be.
            keep_m_s_rad: Gain beyond ``spare_rad``, in place of the configured one.
        """
        if estimate is None:
            return 0.0
        config = self._config
        off = target_rad - estimate.heading_rad
        gain = config.keep_m_s_rad if keep_m_s_rad is None else keep_m_s_rad
        half = gain * math.copysign(max(abs(off) - spare_rad, 0.0), off)
        return min(max(half, -config.keep_limit_m_s), config.keep_limit_m_s)

    def is_square(self, estimate: HeadingEstimate, t_s: float) -> bool:
        """Say whether the chair has been square to the stair for long enough."""
        if abs(estimate.heading_rad) > self._config.square_rad:
            self._square_since_s = None
            return False
        if self._square_since_s is None:
            self._square_since_s = t_s
        return t_s - self._square_since_s >= self._config.square_s

    def sweep(self, t_s: float, turned_rad: float) -> float | None:
        """Return half the belts' difference of a search to either side; None when all has been looked at.

        Args:
            turned_rad: Since the last call, by the gyro.
        """
        config = self._config
        if self._looked_since_s is None:
            self._looked_since_s = t_s
        if t_s - self._looked_since_s < config.look_s:
            return 0.0
        self._swept_rad += turned_rad
        if self._legs and abs(self._legs[0] - self._swept_rad) < 2.0 * DEG:
            self._legs.pop(0)
        if not self._legs:
            self._legs = [config.sweep_rad, -config.sweep_rad, 0.0]  # a person may re-arm, and it looks again
            return None
        return self._half(math.copysign(config.turn_rad_s, self._legs[0] - self._swept_rad))

    def rest(self) -> None:
        """Begin the next turn from rest: the belts are braked."""
        self._half_m_s = 0.0

    def _half(self, rate_rad_s: float) -> float:
        """Return half the belts' difference for a rate of turn; called at each tick of a turn."""
        wanted = 0.5 * self._config.gauge_m * self._config.skid * rate_rad_s
        change = self._config.turn_m_s2 * TICK_S
        self._half_m_s = min(max(wanted, self._half_m_s - change), self._half_m_s + change)
        return self._half_m_s
