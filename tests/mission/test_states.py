"""The tables of states: some simulated case takes each end of a state, and each state but the last has a limit."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import climbing_chair
import descending_chair
import numpy as np
import pytest
from climbing_chair import JUST_TOO_HIGH_M, Foot, rising_by
from descending_chair import EDGE_M, Landing
from world import RISE_M, SLOPE_RAD, World, steeper

from treadline.core.signals import OperatorInput, StairMap
from treadline.mission import ascent_states, descent_states
from treadline.mission.ascent_states import STATES_UP, Ascent
from treadline.mission.descent_states import STATES_DOWN, Descent

Taken = set[tuple[str, str]]


def noting(states: tuple[Any, ...], taken: Taken) -> list[Any]:
    """Return a table whose conditions note the ends that they cause."""

    def noted(name: str, when: Callable[[Any], str | None]) -> Callable[[Any], str | None]:
        def condition(situation: Any) -> str | None:
            cause = when(situation)
            if cause is not None:
                taken.add((name, when.__name__))
            return cause

        return condition

    return [replace(state, exits={noted(state.name, when): to for when, to in state.exits.items()}) for state in states]


def ends_of(states: tuple[Any, ...]) -> Taken:
    return {(state.name, when.__name__) for state in states for when in state.exits}


def after(state: str, change: Callable[[StairMap], StairMap] | int) -> Callable[[Any], None]:
    """Return a course that changes what the camera shows once a state has begun; a number: that nosing is missing."""

    def lacks(world: World, number: int) -> Callable[[StairMap], StairMap]:
        def spoil(seen: StairMap) -> StairMap:
            kept = [place for place in seen.nosings_B if math.dist(place, world.nosing_B(number)) > 0.01]
            return replace(seen, nosings_B=np.array(kept))

        return spoil

    def course(world: World) -> None:
        world.run(state, limit_s=90.0)
        world.spoil = lacks(world, change) if isinstance(change, int) else change
        until_the_end(world)

    return course


def pressed(state: str, **buttons: bool) -> Callable[[Any], None]:
    """Return a course whose operator presses a button once a state has begun."""

    def course(world: World) -> None:
        world.run(state, limit_s=90.0)
        world.planner.update(OperatorInput(t_s=world.t_s, **buttons))
        until_the_end(world)

    return course


def until_the_end(world: World) -> None:
    """Drive until the planner holds the chair or has ended."""
    end_s = world.t_s + 90.0
    while world.t_s < end_s:
        plan = world.tick()
        if plan.hold is not None or plan.phase in ("arrived", "refused"):
            return


def without(*numbers: int) -> Callable[[StairMap], StairMap]:
    """Return a camera that misses some of the nosings that it would show, counted from the nearest."""
    return lambda seen: replace(seen, nosings_B=[place for k, place in enumerate(seen.nosings_B) if k not in numbers], ends=False)


def narrow(seen: StairMap) -> StairMap:
    return replace(seen, left_wall_m=0.3, right_wall_m=0.9)


def open_left(seen: StairMap) -> StairMap:
    return replace(seen, left_side="open", left_edge_m=0.2, left_seen_m=0.2)


def stuck(world: World) -> None:
    world.run("mount", "leave", "descend", limit_s=90.0)
    world.flipper_moves, world.flipper_rad = False, 0.33 if world.DIRECTION == "up" else -0.4
    until_the_end(world)


def late_gap(world: World) -> None:
    """Show two steps below the edge until the chair is lifted, and then that the fourth is missing."""
    world.spoil = lambda seen: replace(seen, nosings_B=[p for p in seen.nosings_B if p[0] > EDGE_M - world.x_m - 0.9], ends=False)
    after("edge", 4)(world)


def at_an_angle(world: World) -> None:
    world.run("descend")
    world.heading_rad = 0.17
    world.run("climb")


def wet(world: Foot) -> None:
    """Let friction fall below the slope's tangent on the flight."""
    world.run("climb")
    world.grip = -0.2
    until_the_end(world)


def over_the_edge(seen: StairMap) -> StairMap:
    return replace(seen, nosings_B=np.vstack([[-0.3, 0.0, 0.0], seen.nosings_B]))


Case = tuple[Callable[[], World], Callable[[Any], None], tuple[str, ...]]
UP: dict[str, Case] = {
    "whole way": (lambda: Foot(steps=5), until_the_end, ()),
    "nothing in view": (lambda: Foot(spoil=lambda _: None, knows=False), until_the_end, ()),
    "wakes up on a flight": (lambda: Foot(x_m=3.0, z_m=5 * RISE_M, pitch_rad=SLOPE_RAD), lambda world: world.run("climb"), ()),
    "too steep": (lambda: Foot(spoil=steeper), until_the_end, ()),
    "too steep from nearby": (lambda: Foot(first_m=2.4, spoil=rising_by(JUST_TOO_HIGH_M)), until_the_end, ()),
    "gap seen from the floor": (lambda: Foot(spoil=without(1)), until_the_end, ()),
    "gap seen at the mount": (Foot, after("align", 2), ()),
    "gap seen on the flight": (lambda: Foot(steps=14), after("align", 6), ()),
    "wall": (lambda: Foot(spoil=narrow), until_the_end, ()),
    "wall seen at the mount": (Foot, after("mount", narrow), ()),
    "open side": (lambda: Foot(spoil=open_left), until_the_end, ()),
    "flipper stuck": (lambda: Foot(flipper_moves=False), until_the_end, ()),
    "flipper stuck at the mount": (Foot, stuck, ()),
    "no hold": (lambda: Foot(grip=-0.99), until_the_end, ()),
    "too little friction": (lambda: Foot(grip=0.02), until_the_end, ()),
    "sent back on the way": (Foot, pressed("approach", go_back=True), ()),
    "sent back at the mount": (Foot, pressed("mount", go_back=True), ()),
    "sent back in the test": (Foot, pressed("traction", go_back=True), ()),
    "sent back on the flight": (lambda: Foot(steps=8), pressed("climb", go_back=True), ()),
    "sent back from an unknown foot": (
        lambda: Foot(x_m=3.0, z_m=5 * RISE_M, pitch_rad=SLOPE_RAD),
        pressed("climb", go_back=True),
        (),
    ),
    "sent back over the crest": (lambda: Foot(steps=5), pressed("crest", go_back=True), ()),
    "sent back on the landing": (lambda: Foot(steps=5), pressed("land", go_back=True), ()),
    "low": (lambda: Foot(steps=2), until_the_end, ()),
    "barred": (lambda: Foot(steps=5), until_the_end, ("climb", "slow", "reach", "barred")),
    "barred, the foot not known": (
        lambda: Foot(steps=8, x_m=3.0, z_m=5 * RISE_M, pitch_rad=SLOPE_RAD),
        until_the_end,
        ("climb", "slow", "reach", "barred"),
    ),
    "wet steps": (lambda: Foot(steps=8), wet, ()),
    "on a nosing": (lambda: Foot(steps=5), until_the_end, ("slow", "reach", "slow", "reach", "carry", "lead", "land", "done")),
}
DOWN: dict[str, Case] = {
    "whole way": (Landing, until_the_end, ()),
    "nothing in view": (lambda: Landing(spoil=lambda _: None, knows=False), until_the_end, ()),
    "wakes up on a flight": (lambda: Landing(x_m=EDGE_M - 1.2), lambda world: world.run("descend"), ()),
    "wakes up at an angle": (lambda: Landing(x_m=0.5 * EDGE_M, heading_rad=0.17), lambda world: world.run("descend"), ()),
    "slides at an angle": (lambda: Landing(x_m=0.5 * EDGE_M), at_an_angle, ()),
    "sent back in a turn": (lambda: Landing(x_m=0.5 * EDGE_M, heading_rad=0.17), pressed("climb", go_back=True), ()),
    "too steep": (lambda: Landing(spoil=steeper), until_the_end, ()),
    "too steep from nearby": (Landing, after("approach", steeper), ()),
    "edge passed": (lambda: Landing(x_m=EDGE_M + 0.3, spoil=over_the_edge), until_the_end, ()),
    "edge hidden": (lambda: Landing(spoil=without(0, 1)), until_the_end, ()),
    "flipper too short": (Landing, until_the_end, ("refuses",)),
    "sent back on the landing": (Landing, pressed("approach", go_back=True), ()),
    "sent back on the flight": (Landing, pressed("descend", go_back=True), ()),
    "wall": (lambda: Landing(spoil=narrow), until_the_end, ()),
    "open side": (lambda: Landing(spoil=open_left), until_the_end, ()),
    "gap before the edge": (Landing, after("align", 5), ()),
    "gap at the edge": (Landing, late_gap, ("settle",) * 50),
    "barred": (Landing, until_the_end, ("press", "lift", "barred")),
    "no floor": (lambda: Landing(shows_end=False), until_the_end, ()),
    "flipper stays low": (Landing, stuck, ()),
}


def test_each_end_of_a_state_is_taken_by_some_case_up(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: Taken = set()
    monkeypatch.setattr(ascent_states, "STATES_UP", noting(STATES_UP, taken))
    monkeypatch.setattr(ascent_states, "Crest", climbing_chair.Script)
    for make, course, stages in UP.values():
        monkeypatch.setattr(climbing_chair.Script, "stages", stages or ("climb", "slow", "reach", "carry", "lead", "land", "done"))
        world = make()
        world.planner = Ascent(climbing_chair.CONFIG)
        course(world)
    assert ends_of(STATES_UP) - taken == ELSEWHERE_UP


def test_each_end_of_a_state_is_taken_by_some_case_down(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: Taken = set()
    monkeypatch.setattr(descent_states, "STATES_DOWN", noting(STATES_DOWN, taken))
    monkeypatch.setattr(descent_states, "Edge", descending_chair.Script)
    for make, course, stages in DOWN.values():
        monkeypatch.setattr(descending_chair.Script, "stages", stages or ("press", "lift", "settle", "leave", "done"))
        world = make()
        world.planner = Descent(descending_chair.CONFIG)
        course(world)
    assert ends_of(STATES_DOWN) - taken == ELSEWHERE_DOWN


ELSEWHERE_UP: Taken = {("land", "is_on_a_landing_between")}
ELSEWHERE_DOWN: Taken = {("leave", "is_on_a_landing_between"), ("descend", "is_barred_by_a_gap")}
"""Ends that need two flights (``test_flights``), or a step that goes missing far below the edge (``test_descent``)."""


def test_every_state_that_is_no_end_of_a_traversal_has_an_exit_and_a_limit() -> None:
    for state in (*STATES_UP, *STATES_DOWN):
        is_end = state.name in ("arrived", "refused")
        assert (len(state.exits) == 0, math.isinf(state.limit_s)) == (is_end, is_end), state.name
