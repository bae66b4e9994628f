"""Planner of a traversal: one table says for both directions what the chair does in each state, and what ends it.

Paper: Section II.A (the track on the stair, the variable angle of attack); the phases are not in the paper (docs/decisions/0019).
``ImuSample, TrackReading, FlipperReading, StairMap, OperatorInput, HeadingEstimate -> MotionPlan``. Measurements of camera, IMU,
belts and flipper end each phase; the plan carries the reason, which the mission logs as an event. Going down the chair faces
uphill, and the rear camera sees the edge, the flight below and the floor at its foot. The first line of the docstring of a
behaviour or condition is what the documentation draws (``docs/tools/automaton.py``).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

from treadline.core.signals import Direction, FreeGround, HeadingEstimate, MotionPlan, Phase
from treadline.mission import _before_the_flight as before
from treadline.mission import _on_the_flight as on
from treadline.mission import _over_the_end as over
from treadline.mission import _turn as turning
from treadline.mission._motions import Motions
from treadline.mission._situation import WAYS, Situation
from treadline.mission._situation_tracker import SituationTracker
from treadline.mission.mission_config import MissionConfig
from treadline.mission.planner import PlannerInput


@dataclass(frozen=True, slots=True)
class Exit:
    """One end of a state."""

    of: Phase
    when: Callable[[Situation], str | None]
    """Condition: returns the observation that ends the state, or None."""
    to: Phase | Literal["hold"]
    only: Direction | None = None
    """Direction in which the exit exists; None: both."""
    then: Callable[[Situation], Situation] | None = None
    """What is remembered as the exit is taken."""


@dataclass(frozen=True, slots=True)
class State:
    """One state of a traversal."""

    name: Phase
    behaviour: Callable[[Situation, Motions], MotionPlan]
    limit_s: float = math.inf
    """Time without coming further after which the chair is held [s]; infinite where it stands for good."""
    only: Direction | None = None
    """Direction in which the state exists; None: both."""
    back: bool = False
    """Whether the chair drives back, against the traversal."""


class Traversal:
    """Planner of one traversal.

    Args:
        config: Mission, of which direction, chair, payload, speed and number of flights count.
    """

    def __init__(self, config: MissionConfig) -> None:
        self._tracker = SituationTracker(config, WAYS[config.direction])
        self._motions = Motions(config)
        self._crosser, self._turner = over.Crosser(), turning.Turner(config.landings)
        self._table = {state.name: (state, exits) for state, exits in table_of(config.direction).items()}

    def update(self, signal: PlannerInput) -> None:
        """Update with one signal."""
        if isinstance(signal, FreeGround):
            self._turner.update(signal)
            return
        self._motions.update(signal)
        self._tracker.update(signal)

    @property
    def to_go_m(self) -> float | None:
        """Distance along the belts from mid-track to the last nosing of the flight [m]; None while its end is not known."""
        now, stair = self._tracker.now, self._tracker.now.stair
        ends, ahead_m = (stair.top_ends, stair.top_ahead_m()) if now.is_up else (stair.bottom_ends, stair.bottom_ahead_m())
        return max(now.way.sign * ahead_m, 0.0) if ends and ahead_m is not None else None

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Return the plan of this tick; a new state acts in the tick in which it begins."""
        tracker, motions = self._tracker, self._motions
        tracker.begin_tick(t_s, estimate)
        tracker.now = self._turner.step(self._crosser.step(tracker.now))
        for _ in self._table:
            tracker.judge()
            now = tracker.now = motions.watch(tracker.now)
            state, exits = self._table[now.phase]
            ends = ((end.when(now), end) for end in exits)
            cause, end = next(((cause, end) for cause, end in ends if cause is not None), (None, None))
            if end is None and now.stalled_s > state.limit_s:
                tracker.try_again()
                return _held(now, f"no progress in {state.limit_s:g} s in the state '{state.name}'")
            if end is None or cause is None:
                return motions.over_low_edges(now, state.behaviour(now, motions))
            if end.then is not None:
                tracker.now = end.then(now)
            if end.to == "hold":
                return _held(now, cause)
            if end.to == "search":
                self._face_next_flight()
            tracker.enter(end.to, cause, back=self._table[end.to][0].back)
        return tracker.now.still

    def _face_next_flight(self) -> None:
        """Begin with the flight across the landing."""
        self._motions.face_flight(self._tracker.now.stair.travel_m)
        self._tracker.face_next_flight()
        self._crosser, self._turner = over.Crosser(), turning.Turner(self._tracker.now.config.landings)


def table_of(direction: Direction) -> dict[State, list[Exit]]:
    """Return the states of one direction, each with its exits."""
    states = [state for state in STATES if state.only in (None, direction)]
    return {state: [end for end in EXITS if end.of == state.name and end.only in (None, direction)] for state in states}


def _held(now: Situation, cause: str) -> MotionPlan:
    """Return the plan that holds the chair."""
    return replace(now.still, hold=cause, needs_stair=False)


STATES = (
    State("search", before.look, limit_s=40.0),
    State("align", before.turn_square, limit_s=30.0),
    State("approach", over.approach, limit_s=10.0),
    State("mount", before.go_at_the_stair, limit_s=20.0, only="up"),
    State("traction", on.try_the_traction, limit_s=20.0, only="up"),
    State("climb", on.climb, limit_s=20.0, only="up"),
    State("crest", over.go_over, limit_s=40.0, only="up"),
    State("land", over.go_over, limit_s=20.0, only="up"),
    State("back_off", on.back_off, limit_s=30.0, only="up", back=True),
    State("edge", over.go_over, limit_s=60.0, only="down"),
    State("climb", on.turn_by_climbing, limit_s=60.0, only="down", back=True),
    State("descend", on.descend, limit_s=20.0, only="down"),
    State("leave", over.leave, limit_s=20.0, only="down"),
    State("turn", turning.turn, limit_s=60.0),
    State("arrived", over.stand),
    State("refused", over.stand),
)
"""States of a traversal: what the chair does, and how long without coming further (docs/decisions/0019).

Each limit is longer than the longest way of its state: 160° at 10 °/s or 2.5 m at 0.1 m/s in the search, half a turn in ``align``,
0.1 m at 0.1 m/s where the belts drive, and the patience of the follower, 8 s; over the edge the chair
may also be lifted and let down again.
"""
EXITS = (
    Exit("search", on.has_a_heading_error, "climb", only="down"),
    Exit("search", before.starts_on_the_flight, "climb", only="up"),
    Exit("search", before.starts_on_the_flight, "descend", only="down"),
    Exit("search", before.sees_the_stair, "align"),
    Exit("search", before.found_nothing, "hold"),
    Exit("align", before.is_unfit, "refused"),
    Exit("align", before.is_past_the_edge, "hold", only="down"),
    Exit("align", before.hides_the_edge, "hold", only="down"),
    Exit("align", before.is_square, "approach"),
    Exit("approach", before.is_sent_back, "back_off", only="up"),
    Exit("approach", before.is_sent_back, "refused", only="down"),
    Exit("approach", before.is_barred_by_a_gap, "hold", only="up"),
    Exit("approach", before.is_too_narrow, "hold"),
    Exit("approach", over.is_barred, "hold", only="up"),
    Exit("approach", before.has_an_open_side, "hold"),
    Exit("approach", before.must_not_enter, "refused"),
    Exit("approach", before.reaches_the_first_step, "mount", only="up"),
    Exit("approach", over.lacks_a_step, "hold", only="down"),
    Exit("approach", over.presses, "edge", only="down"),
    Exit("mount", before.is_sent_back, "back_off"),
    Exit("mount", before.is_barred_by_a_gap, "hold"),
    Exit("mount", before.is_too_narrow, "hold"),
    Exit("mount", before.gets_no_hold, "back_off"),
    Exit("mount", over.is_barred, "hold"),
    Exit("mount", before.mounts_the_crest, "climb"),
    Exit("mount", before.lies_on_two_nosings, "traction"),
    Exit("traction", before.is_sent_back, "back_off"),
    Exit("traction", on.holds, "climb"),
    Exit("traction", on.slips, "back_off"),
    Exit("climb", before.is_sent_back, "back_off", only="up"),
    Exit("climb", on.cannot_go_back, "hold", only="up", then=on.answered),
    Exit("climb", before.is_barred_by_a_gap, "hold", only="up"),
    Exit("climb", on.loses_grip, "hold", only="up"),
    Exit("climb", over.reaches_down, "crest", only="up"),
    Exit("climb", over.is_barred, "hold", only="up"),
    Exit("crest", on.cannot_go_back, "hold", then=on.answered),
    Exit("crest", before.is_barred_by_a_gap, "hold"),
    Exit("crest", over.turns_back, "back_off"),
    Exit("crest", over.is_barred, "hold"),
    Exit("crest", over.rides_again, "climb"),
    Exit("crest", over.lands, "land"),
    Exit("land", on.cannot_go_back, "hold", then=on.answered),
    Exit("land", turning.must_turn, "turn"),
    Exit("land", over.is_on_a_landing_between, "search"),
    Exit("land", over.has_arrived, "arrived"),
    Exit("land", over.is_barred, "hold"),
    Exit("back_off", on.is_backed_off, "refused"),
    Exit("edge", over.lacks_a_step, "hold"),
    Exit("edge", over.is_not_let_down, "hold"),
    Exit("edge", over.lies_on_the_flight, "descend"),
    Exit("climb", on.cannot_go_back, "hold", only="down", then=on.answered),
    Exit("climb", on.has_turned, "descend", only="down"),
    Exit("descend", on.cannot_go_back, "hold", then=on.answered),
    Exit("descend", on.slides_off_heading, "hold", then=on.noted),
    Exit("descend", on.has_a_heading_error, "climb"),
    Exit("descend", before.is_barred_by_a_gap, "hold"),
    Exit("descend", on.saw_no_floor, "hold"),
    Exit("descend", on.tips_onto_the_floor, "leave"),
    Exit("leave", turning.must_turn, "turn"),
    Exit("leave", over.is_on_a_landing_between, "search"),
    Exit("leave", over.has_arrived, "arrived"),
    Exit("leave", over.is_barred, "hold"),
    Exit("turn", turning.has_turned, "search"),
    Exit("turn", turning.cannot_turn, "hold"),
)
"""Ends of the states; of those of one state the first one whose condition returns an observation counts."""
