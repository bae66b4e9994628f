"""The table of states: a case for each end of a state, over the true ground, with the words that a person reads at its end."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from resting_chair import flight
from stair_world import JUST_TOO_HIGH_M, STEEPER, TICK_S, Spoil, World, rising_by, steps, without
from world import RISE_M, RUN_M

from treadline.core.angles import DEG
from treadline.core.signals import Direction, OperatorInput, StairMap
from treadline.mission import traversal
from treadline.mission.traversal import EXITS, Exit, table_of

Course = Callable[[World], Any]
Taken = set[tuple[str, str]]


@dataclass
class Case:
    """A chair and its course, the phase in which that ends, and words of the reason."""

    ends: str
    words: str
    course: Course = World.to_the_end
    world: dict[str, Any] = field(default_factory=dict)


def after(state: str, **changes: Any) -> Course:
    """Return a course in which something changes once a state has begun; a number as ``lacks``: that nosing is missing."""

    def course(world: World) -> None:
        world.run(state)
        if "lacks" in changes:
            world.spoil = lacking(world, changes["lacks"])
        else:
            for name, value in changes.items():
                setattr(world, name, value)
        world.to_the_end()

    return course


def pressed(state: str, **buttons: bool) -> Course:
    """Return a course whose operator presses a button once a state has begun."""

    def course(world: World) -> None:
        world.run(state)
        world.planner.update(OperatorInput(t_s=world.t_s, **buttons))
        world.to_the_end()

    return course


def until(state: str) -> Course:
    return lambda world: world.run(state)


def lacking(world: World, number: int) -> Spoil:
    def spoil(seen: StairMap) -> StairMap:
        there = world.in_B(*world.shown[number])
        return replace(seen, nosings_B=np.array([place for place in seen.nosings_B if math.dist(place, there) > 0.01]))

    return spoil


def near_only(reach_m: float) -> Course:
    """Return a course in which no more than so much of the flight below its edge is ever in view."""

    def course(world: World) -> None:
        world.spoil = lambda seen: replace(
            seen, nosings_B=[place for place in seen.nosings_B if place[0] > world.edge_m - world.x_m - reach_m], ends=False
        )
        world.to_the_end()

    return course


def at_an_angle(world: World) -> None:
    world.run("descend")
    world.heading_rad = 10.0 * DEG
    assert "one belt slides" in world.until_held()
    world.run("climb")
    world.run("descend")


def wet(world: World) -> None:
    """Let the belts slip back on the flight until the flipper is pressed onto its nosings."""
    world.run("climb")
    while world.x_m < 0.9:
        world.tick()
    world.grip = -0.05
    while not world.now.presses:
        world.tick()
    world.grip = 0.0
    world.to_the_end()


def stuck_over_the_crest(world: World) -> None:
    """Let the flipper stick while the chair leans on it."""
    world.run("crest")
    while world.pitch_rad > 20.0 * DEG:
        world.tick()
    world.flipper_moves = False
    world.to_the_end()


def sees_a_gap(state: str, past_m: float, *, from_m: float = -1.2) -> Course:
    """Return a course in which a step turns out to be missing beyond the edge, with the weight so far behind it."""

    def course(world: World) -> None:
        world.run(state)
        while world.body.pose.com_m[0] > world.edge_m - past_m or world.pitch_rad < 5.0 * DEG:
            world.tick()
        gap = (world.edge_m + from_m - world.x_m, world.edge_m + from_m + 0.6 - world.x_m)
        world.now.stair.gaps_ahead_m = lambda: [gap]  # type: ignore[method-assign]
        world.to_the_end()

    return course


NARROW = lambda seen: replace(seen, left_wall_m=0.3, right_wall_m=0.9)  # noqa: E731
OPEN = lambda seen: replace(seen, left_side="open", left_edge_m=0.2, left_seen_m=0.2)  # noqa: E731
TURNED = lambda seen: replace(seen, turn_rad=-30.0 * DEG, ends=False)  # noqa: E731
TURNED_ON_A_LANDING = lambda seen: replace(seen, turn_rad=1.5 if seen.ends else None)  # noqa: E731
HIGH_TOP = flight(*[(0.16, 0.30)] * 3, (0.19, 0.30))
ON, HALF_WAY = {"away_m": -1.2}, {"away_m": -1.0}
BACK = "the operator sent the chair back"

SHORT = {"nosings": steps(4)}
UP: dict[str, Case] = {
    "whole way": Case("arrived", "on the landing, pitch -?0.0°, clear of the last nosing", world={"nosings": steps(5)}),
    "single step": Case("arrived", "on the landing", world={"nosings": steps(1)}),
    "two steps": Case("arrived", "on the landing", world={"nosings": steps(2)}),
    "nothing in view": Case("search", "no stair in view, to neither side", world={"spoil": lambda _: None, "knows": False}),
    "wakes up on a flight": Case("climb", "on a flight, pitched by 28", until("climb"), ON),
    "too steep": Case("refused", "36.5°", world={"spoil": STEEPER}),
    "too steep from nearby": Case("refused", "steep", world={"away_m": 2.4, "spoil": rising_by(JUST_TOO_HIGH_M)}),
    "winders": Case("refused", "turns by 30° to the right .* without a landing", world={"spoil": TURNED}),
    "winders seen on the flight": Case("climb", "turns by 30° to the right", after("climb", spoil=TURNED), {"nosings": steps(10)}),
    "turn on a landing": Case("arrived", "on the landing", world={"nosings": steps(5), "spoil": TURNED_ON_A_LANDING}),
    "gap seen from the floor": Case("approach", "a step is missing: 0.6", world={"spoil": without(1)}),
    "gap seen at the mount": Case("mount", "a step is missing: 0.6", after("align", lacks=2)),
    "gap seen on the flight": Case("climb", "a step is missing: 0.68 m", after("align", lacks=6), {"nosings": steps(10)}),
    "wall": Case("approach", "the left wall is 0.30 m", world={"spoil": NARROW}),
    "wall seen at the mount": Case("mount", "the left wall is 0.30 m", after("mount", spoil=NARROW)),
    "open side": Case("approach", "left side is open 0.20 m", world={"spoil": OPEN}),
    "flipper stuck": Case("mount", "stands at 40° above the belts", world={"flipper_moves": False}),
    "flipper dead": Case("approach", "it does not rise|its motor is dead", world={"most_n_m": 0.0}),
    "flipper stuck at the mount": Case("mount", "it would not carry", after("mount", flipper_moves=False)),
    "no hold": Case("refused", "without getting up", world={"grip": -0.99}),
    "belts that slip at the mount": Case("refused", "without getting up", after("mount", slip=1.0)),
    "too little friction": Case("refused", "too little friction: .* below 0.56", world={"grip": 0.02}),
    "sent back on the way": Case("refused", BACK, pressed("approach", go_back=True)),
    "sent back at the mount": Case("refused", BACK, pressed("mount", go_back=True)),
    "sent back in the test": Case("refused", BACK, pressed("traction", go_back=True)),
    "sent back on the flight": Case("refused", BACK, pressed("climb", go_back=True)),
    "sent back from an unknown foot": Case("climb", "cannot go back down from here", pressed("climb", go_back=True), ON),
    "sent back over the crest": Case("crest", "cannot go back down from here", pressed("crest", go_back=True), SHORT),
    "sent back on the landing": Case("land", "cannot go back", pressed("land", go_back=True), SHORT),
    "barred by a landing that is not there": Case(
        "crest", "the landing is not there", world={"nosings": steps(4), "landing_m": 0.02}
    ),
    "belts that slip at the crest": Case("refused", "they slip on the last nosing", after("crest", slip=0.5), SHORT),
    "turned back before the crest": Case("refused", "goes back down", after("crest", slip=0.3), SHORT),
    "nothing under the flipper as it begins to climb": Case("climb", "nothing carried the flipper", after("climb", slip=1.0)),
    "flipper stuck on the landing": Case("land", "flipper stands at", after("land", flipper_moves=False), SHORT),
    "stuck over the crest": Case("crest", "not rise; send the chair back down, or re-arm it", stuck_over_the_crest, SHORT),
    "no end in view": Case("arrived", "on the landing", world={"nosings": steps(4), "shows_end": False}),
    "landing 30 mm lower than shown": Case("arrived", "on the landing", world={"nosings": steps(4), "shown": HIGH_TOP}),
    "further nosings at the crest": Case(
        "arrived", "on the landing", after("crest", shown=steps(6)), {"nosings": steps(6), "shown": steps(4)}
    ),
    "gap seen at the crest": Case(
        "climb",
        "a step is missing: 0.68 m",
        after("crest", shown=[*steps(4), *steps(8)[5:]]),
        {"nosings": steps(8), "shown": steps(4)},
    ),
    "gap under the crest": Case("crest", "a step is missing: 0.60 m", sees_a_gap("crest", -1.0, from_m=0.2), SHORT),
    "map corrected under way": Case(
        "arrived", "on the landing", after("climb", shown=steps(4)), {"nosings": steps(4), "shown": HIGH_TOP}
    ),
    "wet steps": Case("climb", "the belts slip on the flight; .*have the steps dried and re-arm", wet),
}
DOWN: dict[str, Case] = {
    "whole way": Case("arrived", "on the floor, pitch -?0.0°", world={"nosings": steps(5)}),
    "nothing in view": Case("search", "no stair in view behind", world={"spoil": lambda _: None, "knows": False}),
    "wakes up on a flight": Case("descend", "on a flight, pitched by 28", until("descend"), ON),
    "wakes up at an angle": Case("descend", "square within", until("descend"), HALF_WAY | {"heading_rad": 10.0 * DEG}),
    "slides at an angle": Case("descend", "square within", at_an_angle, HALF_WAY),
    "sent back in a turn": Case(
        "climb", "without a view of the landing", pressed("climb", go_back=True), HALF_WAY | {"heading_rad": 10.0 * DEG}
    ),
    "too steep": Case("refused", "36.5°", world={"spoil": STEEPER}),
    "too steep from nearby": Case("refused", "36.9°", after("approach", spoil=STEEPER)),
    "edge passed": Case(
        "align",
        "its edge is not behind the chair",
        world={"away_m": 0.3, "spoil": lambda seen: replace(seen, nosings_B=np.vstack([[-0.3, 0.0, 0.0], seen.nosings_B]))},
    ),
    "edge hidden": Case("align", "the edge is hidden under the camera", world={"spoil": without(0, 1)}),
    "sent back on the landing": Case("refused", BACK, pressed("approach", go_back=True)),
    "sent back at the edge": Case("edge", BACK, pressed("edge", go_back=True)),
    "sent back on the flight": Case("descend", "without a view of the landing", pressed("descend", go_back=True)),
    "wall": Case("approach", "the left wall is 0.30 m", world={"spoil": NARROW}),
    "open side": Case("approach", "left side is open 0.20 m", world={"spoil": OPEN}),
    "gap before the edge": Case("approach", "a step is missing: 0.6", after("align", lacks=5)),
    "gap below the edge": Case("descend", "a step is missing: 0.6. m .* the first 0.(49|50) m before", after("align", lacks=1)),
    "gap seen as it is lifted": Case("edge", "a step is missing.*; it stands on the landing again", sees_a_gap("edge", -0.06)),
    "gap seen too late": Case(
        "edge", "a step is missing: 0.60 m from nosing to nosing, the first .* pulley$", sees_a_gap("edge", 0.02)
    ),
    "too little in view": Case("edge", "no more of the flight is in view", near_only(1.0)),
    "flipper stuck": Case("edge", "it would not carry the chair; it stands on the landing", world={"flipper_moves": False}),
    "no floor": Case("descend", "nothing was seen beyond the last nosing", world={"shows_end": False, "nosings": steps(6)}),
    "no floor but for the operator": Case(
        "arrived", "on the floor", pressed("descend", flight_ends=True), {"shows_end": False, "nosings": steps(6)}
    ),
    "flipper stuck on the last nosings": Case(
        "leave", "flipper stands at", after("leave", flipper_moves=False), {"nosings": steps(5)}
    ),
}
CASES = {("up", name): case for name, case in UP.items()} | {("down", name): case for name, case in DOWN.items()}


@cache
def driven(direction: Direction, name: str) -> tuple[World, Taken]:
    """Return the chair at the end of a case, and the ends of states that it took."""
    taken: Taken = set()

    def noted(end: Exit) -> Exit:
        def condition(now: Any) -> str | None:
            cause = end.when(now)
            if cause is not None:
                taken.add((end.of, end.when.__name__))
            return cause

        return replace(end, when=condition)

    case = CASES[direction, name]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(traversal, "EXITS", tuple(map(noted, EXITS)))
        world = World(up=direction == "up", **case.world)
    case.course(world)
    return world, taken


def wrong(direction: Direction, name: str) -> Any:
    """Return a case with its mark, if the planner does not yet do what is expected."""
    reason = WRONG.get((direction, name))
    return pytest.param(direction, name, marks=() if reason is None else pytest.mark.xfail(reason=reason, strict=True))


WRONG: dict[tuple[Direction, str], str] = {
    ("up", "belts that slip at the mount"): "a free tip is taken for a dead motor, before the belts are judged",
}


@pytest.mark.parametrize(("direction", "name"), [wrong(*case) for case in CASES])
def test_each_case_ends_in_its_state_quietly_and_says_why(direction: Direction, name: str) -> None:
    world, _ = driven(direction, name)
    plan, case = world.plans[-1], CASES[direction, name]
    assert plan.phase == case.ends, plan.hold or plan.cause
    assert re.search(case.words, plan.hold or plan.cause), plan.hold or plan.cause
    assert world.body.fastest_rad_s < 10.0 * DEG  # 9 °/s is the largest that is planned
    if plan.phase in ("arrived", "refused"):
        assert not any(earlier.hold for earlier in world.plans)


@pytest.mark.parametrize("direction", ["up", "down"])
def test_each_end_of_a_state_is_taken_by_some_case(direction: Direction) -> None:
    ends = {(state.name, end.when.__name__) for state, exits in table_of(direction).items() for end in exits}
    taken = set[tuple[str, str]]().union(*(driven(*case)[1] for case in CASES if case[0] == direction))
    # A landing between needs two flights (``test_flights``), and one on which the stair turns sides in view (``test_turn``).
    leaves = "land" if direction == "up" else "leave"
    turns = {(leaves, "must_turn"), ("turn", "has_turned"), ("turn", "cannot_turn")}
    assert ends - taken == {(leaves, "is_on_a_landing_between"), *turns}


@pytest.mark.parametrize("direction", ["up", "down"])
def test_every_state_is_reached_once_and_has_an_exit_and_a_limit_unless_it_ends_the_traversal(direction: Direction) -> None:
    table = table_of(direction)
    for state, exits in table.items():
        is_end = state.name in ("arrived", "refused")
        assert (len(exits) == 0, math.isinf(state.limit_s)) == (is_end, is_end), state.name
    reached = {end.to for exits in table.values() for end in exits} - {"hold"} | {"search"}
    assert sorted(state.name for state in table) == sorted(reached)


# --- what the drives of the table look like


def test_up_it_drives_the_whole_way_in_order_fast_far_from_the_stair_and_slow_on_its_ends() -> None:
    world, _ = driven("up", "whole way")
    assert world.phases == ["search", "align", "approach", "mount", "traction", "climb", "crest", "land", "arrived"]
    speeds = {state: [p.speed_m_s for p in world.plans if p.phase == state][1:] for state in ("approach", "mount", "crest", "land")}
    assert speeds["approach"][0] == 0.2
    assert min(min(each) for each in speeds.values()) >= 0.0
    # 0.1 m/s along the ground, on belts pitched by less than 40°.
    assert max(max(speeds[state]) for state in ("mount", "crest", "land")) < 0.13
    # Belts that held do not stop before they climb.
    began = next(k for k, plan in enumerate(world.plans) if plan.phase == "climb")
    assert all(0.0 < plan.speed_m_s <= 0.2 for plan in world.plans[began : began + 25])
    world.run(limit_s=0.5)
    assert (world.plans[-1].speed_m_s, world.plans[-1].turn_m_s) == (0.0, 0.0)


@pytest.mark.parametrize("more_m", [-0.02, -0.01, 0.0, 0.01, 0.02])
def test_the_first_step_is_measured_and_the_belts_lie_on_two_nosings_as_the_traction_test_begins(more_m: float) -> None:
    """Test: floor covering lowers or raises the first step. Expected result: its rise is known within 2 mm, and
    while the belts speed up to 0.2 m/s the chair turns by less than 0.2°: over a change of contact it turned at 30 °/s."""
    first_m = RISE_M + more_m
    world = World(nosings=flight((first_m, RUN_M), *[(RISE_M, RUN_M)] * 7))
    world.run("traction")
    around = world.now.around
    assert around is not None
    assert around.rise_m == pytest.approx(first_m, abs=0.002)
    turned = [world.pitch_rad]
    while world.tick().phase == "traction":
        turned.append(world.pitch_rad)
    assert max(turned) - min(turned) < 0.2 * DEG


def test_before_the_foot_it_brakes_gently_and_needs_no_stair_in_view() -> None:
    """Test: backing down from half-way. Expected result: braking downhill tips a chair onto its rear, so at most 0.15 m/s²,
    to 0.1 m/s half a metre before the last nosing."""
    world = World(up=False, nosings=steps(9), away_m=-0.4)
    world.run("descend")
    while world.tick().needs_stair:
        pass
    going = [plan.speed_m_s for plan in world.plans if plan.phase == "descend"][1:]
    assert (min(going), going[-1]) == (-0.2, pytest.approx(-0.1, abs=0.015))
    assert np.diff(going).min() > -1e-9
    assert np.diff(going).max() / TICK_S < 1.2 * 0.15
    assert world.x_m / math.cos(world.pitch_rad) - 0.475 == pytest.approx(0.5, abs=0.05)


def test_down_it_slows_at_the_foot_and_stows_its_flipper_on_the_floor() -> None:
    world, _ = driven("down", "whole way")
    assert world.phases == ["search", "align", "approach", "edge", "descend", "leave", "arrived"]
    assert min(plan.speed_m_s for plan in world.plans if plan.phase == "leave") > -0.13
    # The front pulley is clear of the first nosing by the flipper's length, less what belts err in 3 m without a nosing in view.
    assert world.x_m + 0.475 < -0.45 + 0.05
    world.run(limit_s=3.0)
    assert world.body.angle_rad == pytest.approx(40.0 * DEG, abs=0.5 * DEG)


def test_too_little_friction_backs_off_slowly_to_half_a_metre_from_the_flight() -> None:
    world, _ = driven("up", "too little friction")
    backing = [(plan, x) for plan, x in zip(world.plans, world.xs, strict=True) if plan.phase == "back_off"][1:]
    assert {plan.speed_m_s for plan, _ in backing} <= {-0.1, 0.0}
    assert backing[0][1] - world.x_m == pytest.approx(0.7, abs=0.3)  # from where the belts lay on the first two nosings
    assert abs(world.pitch_rad) < 2.0 * DEG


@pytest.mark.parametrize("name", ["sent back at the edge", "gap seen as it is lifted"])
def test_set_back_on_the_landing_the_chair_is_level_behind_its_edge_with_its_flipper_up(name: str) -> None:
    world, _ = driven("down", name)
    assert abs(world.pitch_rad) < 0.1 * DEG
    assert world.before_m > 0.1
    assert world.body.angle_rad > 30.0 * DEG


@pytest.mark.parametrize(
    ("direction", "name", "before_m"),
    [("up", "open side", 0.25), ("down", "open side", 0.25), ("up", "wall", 0.25), ("up", "too steep from nearby", 0.24)],
)
def test_what_speaks_against_a_flight_holds_the_chair_on_the_floor_before_it(
    direction: Direction, name: str, before_m: float
) -> None:
    world, _ = driven(direction, name)
    assert world.before_m > before_m
    assert world.pitch_rad == pytest.approx(0.0, abs=1e-3)


def test_a_missing_step_far_below_the_edge_stops_the_chair_half_a_metre_before_it() -> None:
    world, _ = driven("down", "gap below the edge")
    rear_m = world.x_m - 0.475 * math.cos(world.pitch_rad)
    # Nosing 1 is missing: the last before it is nosing 2.
    assert rear_m - 2 * RUN_M == pytest.approx(0.5 * math.cos(world.pitch_rad), abs=0.05)
