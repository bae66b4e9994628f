"""How a held chair stops: braked at once for urgent causes, along a half-cosine of 0.3 s for all others.

A hard brake at 0.2 m/s pushes the passenger with about 4 m/s²; a half-cosine takes π v / 2T = 1.0 m/s² at most and v T / 2 = 30 mm
of travel. The command leads the half-cosine by the drives' lag, so that the belts follow it: of a half-cosine alone they still run
with 0.4 of their speed when the brake falls in, with the lead with 0.2. Where the lead asks for reverse, the command is zero.
"""

import math
from enum import StrEnum

from treadline.core.signals import TrackCommand

RAMP_S = 0.3
"""Duration of a ramped stop. Fits HOLD within 0.5 s of the cause (rows 1 and 9), with 0.2 s to spare for the drives' lag."""


class CauseKind(StrEnum):
    """Kinds of cause for a HOLD."""

    OPERATOR = "operator"
    LINK = "link"
    PROCESS = "process"
    CLOCK = "clock"
    LATE = "late"
    NOT_FINITE = "not finite"
    ATTITUDE = "attitude"
    BELTS = "belts"
    SLIP = "slip"
    AHEAD = "ahead"
    BOTH_SENSES = "both senses"
    SENSES = "senses"
    HEADING = "heading"
    SEAT = "seat"
    PLAN = "plan"
    STALE_PLAN = "stale plan"


URGENT = {
    CauseKind.OPERATOR: "row 21: the command is zero within a tick and the chair still within 0.10 m; a ramp takes 0.3 s",
    CauseKind.LINK: "row 21: a lost link is an operator's stop",
    CauseKind.PROCESS: "row 22: stopped 0.8 s after a process ended, of which its silence has taken 0.75 s",
    CauseKind.CLOCK: "row 10: a ramp needs a reliable clock",
    CauseKind.LATE: "row 11: stopped 0.8 s after the last command, of which its absence has taken 0.75 s; the belts stand already",
    CauseKind.NOT_FINITE: "row 6: the program that computes commands is broken; its numbers cannot be used for a ramp",
    CauseKind.ATTITUDE: "row 18: the chair tips; each centimetre of travel may add to it",
    CauseKind.BELTS: "rows 13 and 24: a faulty drive does not follow a ramp, or the brake is on already",
    CauseKind.SLIP: "row 14: roll-back of 0.30 m at most, 0.25 m of which are gone",
    CauseKind.AHEAD: "rows 17 and 25: a distance to keep, which a ramp would shorten by 30 mm",
    CauseKind.BOTH_SENSES: "row 9: held within 0.5 s, of which the silence has taken 0.3 s",
}
"""Causes that brake at once, each with its reason; rows are those of the table of hazards."""
RAMPED = {
    CauseKind.SENSES: "rows 1, 6, 7 and 8: held within 0.5 s of a limit; the other sense carries the heading over the ramp",
    CauseKind.HEADING: "row 7: belts 0.1 m/s apart turn the chair by 0.3° more over a ramp, of 5° allowed",
    CauseKind.SEAT: "row 19: the seat is frozen at once, and the ramp spares its passenger a jolt",
    CauseKind.PLAN: "the planner's own decision, at a place where the chair may stand",
    CauseKind.STALE_PLAN: "row 22: stopped 0.8 s after a process ended: its plan is 0.3 s old, the ramp takes 0.3 s",
}
"""Causes that stop along the ramp, each with its reason."""


class RampedStop:
    """Half-cosine from the belts' speeds at the first step to zero, then the brake.

    Args:
        lag_s: Time constant of the belt drives [s].
        standing_m_s: Belt speed up to which the chair stands already, and is braked at once [m/s].
    """

    def __init__(self, lag_s: float, standing_m_s: float) -> None:
        self._lag_s, self._standing_m_s = lag_s, standing_m_s
        self._began_s: float | None = None
        self._last_s = -math.inf
        self._belts_m_s = (0.0, 0.0)
        self.is_over = False

    def brake(self) -> None:
        """End the ramp: brake from now on."""
        self.is_over = True

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
        left, right = self._belts_m_s
        return TrackCommand(t_s=t_s, left_m_s=share * left, right_m_s=share * right)
