"""What the person in charge does during a run: the ``[[operator]]`` tables of a scenario.

The person holds a handset with a stop button, a dead-man switch and a button to re-arm; it reports ten times a second.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from treadline.settings import Settings

SAME_TIME_S = 1e-6
"""Times closer than this are one tick, whatever their last bits say."""
REPORT_S = 0.1
"""Period of the handset's reports."""


class OperatorAct(Settings):
    """One act of the person in charge: a stop, a released dead-man switch, or a re-arm after a hold."""

    kind: Literal["stop", "release", "rearm"]
    """Press stop, let go of the dead-man switch, or press re-arm, which ends a hold."""
    at_s: Annotated[float, Field(ge=0.0)] = 10.0
    """When it begins."""
    for_s: Annotated[float, Field(ge=0.2, le=3600.0)] = 0.5
    """How long the button is held, or the dead-man switch let go: at least two reports of the handset."""

    def active(self, t_s: float) -> bool:
        """Say whether the act is going on at ``t_s``."""
        return self.at_s <= t_s + SAME_TIME_S < self.at_s + self.for_s


def does(acts: Sequence[OperatorAct], kind: str, t_s: float) -> bool:
    """Say whether the person does something at ``t_s``."""
    return any(act.kind == kind and act.active(t_s) for act in acts)


def rearms_until_s(acts: Sequence[OperatorAct]) -> float:
    """Return the time from which on no re-arm is to come any more: a hold then ends the run."""
    return max((act.at_s + 2.0 * REPORT_S for act in acts if act.kind == "rearm"), default=-math.inf)


def act_problem(acts: Sequence[OperatorAct]) -> str | None:
    """Return which re-arm would mean nothing, and why; or None."""
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
