"""Operator actions during a run: the ``[[operator]]`` tables of a scenario.

The operator holds a handset with a dead-man switch and buttons for stop, re-arm, "this is the end" and "go back"; the handset
reports ten times per second.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from treadline.core.settings import Settings
from treadline.core.signals import ROUNDING_S, TICK_S

REPORT_TICKS = 10
REPORT_S = REPORT_TICKS * TICK_S
"""Report period of the handset [s]."""


class OperatorAct(Settings):
    """One operator action: a press of a button, or a released dead-man switch."""

    kind: Literal["stop", "release", "rearm", "flight_ends", "go_back"]
    """Action: press stop; release the dead-man switch; press re-arm, which ends a hold; declare the last known nosing the last of
    the flight; send the chair back to where it began."""
    at_s: Annotated[float, Field(ge=0.0)] = 10.0
    """Start time of the action."""
    for_s: Annotated[float, Field(ge=0.2, le=3600.0)] = 0.5
    """Duration of the press or release: at least two handset reports."""

    def active(self, t_s: float) -> bool:
        """Return whether the action is in progress at ``t_s``."""
        return self.at_s <= t_s + ROUNDING_S < self.at_s + self.for_s


def does(acts: Sequence[OperatorAct], kind: str, t_s: float) -> bool:
    """Return whether an action of the given kind is in progress at ``t_s``."""
    return any(act.kind == kind and act.active(t_s) for act in acts)


def rearms_until_s(acts: Sequence[OperatorAct]) -> float:
    """Return the end of the last re-arm action [s]; a later hold ends the run."""
    return max((act.at_s + 2.0 * REPORT_S for act in acts if act.kind == "rearm"), default=-math.inf)


def act_problem(acts: Sequence[OperatorAct]) -> str | None:
    """Return an error message for the first re-arm without effect, or None."""
    for number, act in enumerate(acts):
        if act.kind != "rearm":
            continue
        for other_number, other in enumerate(acts):
            if other_number == number or not other.at_s <= act.at_s < other.at_s + other.for_s + REPORT_S:
                continue
            until_s = other.at_s + other.for_s
            meanwhile = f"but operator.{other_number} ({other.kind}) lasts until {until_s:g} s"
            return (
                f"operator.{number}: a re-arm at {act.at_s:g} s, {meanwhile}; a re-arm counts from {until_s + REPORT_S:g} s on, "
                "one report of the handset later"
            )
    return None
