"""How a held chair stops: braked at once for urgent causes, at zero speed for a person, along a half-cosine of 0.3 s else.

A hard brake at 0.2 m/s pushes the passenger with about 4 m/s²; a half-cosine takes π v / 2T = 1.0 m/s² at most and v T / 2 = 30 mm
of travel. The command leads the half-cosine by the drives' lag, so that the belts follow it: of a half-cosine alone they still run
with 0.4 of their speed when the brake falls in, with the lead with 0.2. Where the lead asks for reverse, the command is zero.
"""

import math
from enum import Enum

from treadline.core.signals import TrackCommand
from treadline.guard._guard_config import GuardConfig

RAMP_S = 0.3
"""Duration of a ramped stop. Fits HOLD within 0.5 s of the cause (rows 1 and 9), with 0.2 s to spare for the drives' lag."""


class Stop(Enum):
    """How a held chair stops."""

    BRAKE = "brake"
    """Brake at once: a ramp of 0.3 s and 30 mm would break a limit, or cannot be trusted."""
    ZERO = "zero"
    """Zero speed at once, the brake 0.3 s later: the drives' lag spares the passenger the jolt of the brake."""
    RAMP = "ramp"
    """Half-cosine: the chair may travel 30 mm more, and the passenger is spared a jolt."""


class RampedStop:
    """Half-cosine from the belts' speeds at the first step to zero, then the brake.

    A chair that stands already is braked at once.
    """

    def __init__(self, config: GuardConfig) -> None:
        self._lag_s, self._standing_m_s = config.drive_lag_s, config.mismatch_spare_m_s
        self._began_s: float | None = None
        self._last_s = -math.inf
        self._belts_m_s = (0.0, 0.0)
        self.is_over = False
        """Whether the belts are braked; may be set to end the ramp."""
        self.is_zero = False
        """Whether the speed is zero from the first step on; may be set within the ramp."""

    def step(self, t_s: float, belts_m_s: tuple[float, float]) -> TrackCommand:
        """Return the command at a tick; a clock that does not advance ends the ramp.

        Args:
            belts_m_s: Present speeds, used at the first step.
        """
        if self._began_s is None:
            self._began_s, self._belts_m_s = t_s, belts_m_s
            self.is_over = self.is_over or max(map(abs, belts_m_s)) <= self._standing_m_s
        elapsed_s = t_s - self._began_s
        self.is_over = self.is_over or not self._last_s < t_s or elapsed_s >= RAMP_S
        self._last_s = t_s
        if self.is_over:
            return TrackCommand.stop(t_s)
        phase = math.pi * elapsed_s / RAMP_S
        # The half-cosine and its lead, v + lag dv/dt: the inverse of a first-order lag.
        share = max(0.5 * (1.0 + math.cos(phase) - math.pi * self._lag_s / RAMP_S * math.sin(phase)), 0.0)
        left, right = (0.0, 0.0) if self.is_zero else self._belts_m_s
        return TrackCommand(t_s=t_s, left_m_s=share * left, right_m_s=share * right)
