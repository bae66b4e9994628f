"""States of a traversal as data: one table per direction says what the chair does in each state, and what ends the state.

``situation -> MotionPlan``. A behaviour and a condition are functions of the situation; the first line of their docstrings is
what the documentation draws (``docs/tools/automaton.py``).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Generic, Literal, Protocol, TypeVar

from treadline.core.signals import MotionPlan, Phase


class Situation(Protocol):
    """What a table of states needs to know of a traversal."""

    phase: Phase

    @property
    def still(self) -> MotionPlan:
        """Plan of this tick that stops the belts."""

    @property
    def stalled_s(self) -> float:
        """Time with released brakes since the state began, or since the chair last came further [s]."""

    def enter(self, phase: Phase, cause: str) -> None:
        """Begin a state."""

    def try_again(self) -> None:
        """Restart the time of the state: a person who re-arms the chair allows another try."""


S_contra = TypeVar("S_contra", bound=Situation, contravariant=True)


@dataclass(frozen=True, slots=True)
class Exit(Generic[S_contra]):
    """End of a state: a condition, and the next state or a hold."""

    when: Callable[[S_contra], str | None]
    """Returns the observation with its value, or None while the condition does not hold."""
    to: Phase | Literal["hold"]


@dataclass(frozen=True, slots=True)
class State(Generic[S_contra]):
    """One state of a traversal."""

    name: Phase
    behaviour: Callable[[S_contra], MotionPlan]
    limit_s: float
    """Time without coming further after which the chair is held [s]; infinite where it stands for good."""
    exits: tuple[Exit[S_contra], ...] = ()
    """Ends of the state; the first whose condition holds is taken."""
    begins: Callable[[S_contra], None] | None = None
    """What is prepared when the state begins."""


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
            cause, to = next(((cause, end.to) for end in state.exits if (cause := end.when(situation)) is not None), (None, None))
            if cause is None and situation.stalled_s > state.limit_s:
                situation.try_again()
                cause, to = f"no progress in {state.limit_s:g} s ({state.name}): the belts slip, or something is in the way", "hold"
            if cause is None or to is None:
                return state.behaviour(situation)
            if to == "hold":
                return replace(situation.still, hold=cause, needs_stair=False)
            situation.enter(to, cause)
            if (begins := self._states[to].begins) is not None:
                begins(situation)
        return situation.still
