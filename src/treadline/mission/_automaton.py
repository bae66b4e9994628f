"""States of a traversal as data: one table per direction says what the chair does in each state, and what ends the state.

``situation -> MotionPlan``. A behaviour and a condition are functions of the situation; the first line of their docstrings is
what the documentation draws (``docs/tools/automaton.py``).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, Literal, TypeVar

from treadline.core.signals import MotionPlan, Phase
from treadline.mission._situation import FlightSituation

S_contra = TypeVar("S_contra", bound=FlightSituation, contravariant=True)


Exits = Mapping[Callable[[S_contra], str | None], Phase | Literal["hold"]]
"""Next state, or a hold, by the condition that ends a state."""


@dataclass(frozen=True, slots=True)
class State(Generic[S_contra]):
    """One state of a traversal."""

    name: Phase
    behaviour: Callable[[S_contra], MotionPlan]
    limit_s: float
    """Time without coming further after which the chair is held [s]; infinite where it stands for good."""
    exits: Exits[S_contra] = field(default_factory=dict)
    """Ends of the state; the first condition that returns an observation counts."""
    begins: Callable[[S_contra], None] | None = None
    """What is prepared when the state begins."""
    back: bool = False
    """Whether the chair drives back, against the traversal."""


class Automaton(Generic[S_contra]):
    """Runs a table of states.

    Args:
        states: The table.
    """

    def __init__(self, states: Sequence[State[S_contra]]) -> None:
        self._states = {state.name: state for state in states}

    def step(self, situation: S_contra) -> MotionPlan:
        """Return the plan of this tick; a new state acts in the tick in which it begins."""
        for _ in self._states:
            state = self._states[situation.phase]
            ends = ((when(situation), to) for when, to in state.exits.items())
            cause, to = next(((cause, to) for cause, to in ends if cause is not None), (None, None))
            if cause is None and situation.stalled_s > state.limit_s:
                situation.try_again()
                cause, to = f"no progress in {state.limit_s:g} s in the state '{state.name}'", "hold"
            if cause is None or to is None:
                return situation.over_low_edges(state.behaviour(situation))
            if to == "hold":
                return replace(situation.still, hold=cause, needs_stair=False)
            begun = self._states[to]
            if begun.begins is not None:
                begun.begins(situation)
            situation.enter(to, cause, back=begun.back)
        return situation.still
