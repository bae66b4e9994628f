"""The phases of a traversal down, each way in and out, with hand-made maps, belts and IMU; the edge has its own tests."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from descending_chair import EDGE_M, STEPS, Landing, Script
from world import CHAIR, PIVOT_M, RISE_M, RUN_M, SLOPE_RAD, TICK_S, World, estimate

from treadline.core.angles import DEG
from treadline.core.errors import SettingsError
from treadline.core.signals import MotionPlan, StairMap
from treadline.mission import descent_states as descent
from treadline.mission.mission_blocks import planner_of
from treadline.mission.mission_config import MissionConfig
from treadline.scenario.chair import read_chair

# Flipper and tip-over feed-forward on the flight: docs/decisions/0019.
FLIPPER_RAD_S, LETS_DOWN_RAD_S, LAID_RAD, LATE_S, CLEAR_M = 15.0 * DEG, 4.0 * DEG, 2.0 * DEG, 0.8, 0.05
RIDES_RAD, LIMIT_M_S, BLIND_RAD = -2.5 * DEG, 0.1, 1.0 * DEG


@pytest.fixture
def edge(monkeypatch: pytest.MonkeyPatch) -> type[Script]:
    Script.made, Script.stages = [], ("press", "lift", "settle", "leave", "done")
    monkeypatch.setattr(descent, "Edge", Script)
    return Script


def test_a_chair_that_wakes_up_on_a_flight_backs_down_with_its_flipper_planner_laid() -> None:
    """Test: on the flight, the flipper at its rest; sound, and stuck. Expected result: it stands until the flipper is laid, or
    late."""
    world = Landing(x_m=EDGE_M - 1.2)
    plan = world.run("descend")
    assert world.flipper_rad < LAID_RAD
    assert f"flipper {world.flipper_rad / DEG:+.0f}°" in plan.cause
    assert all(plan.speed_m_s == 0.0 for plan in world.plans[:-1])
    stuck = Landing(x_m=EDGE_M - 1.2, flipper_moves=False)
    stuck.run("descend")
    assert stuck.t_s == pytest.approx((stuck.flipper_rad - LAID_RAD) / FLIPPER_RAD_S + LATE_S, abs=0.15)


@pytest.mark.usefixtures("edge")
@pytest.mark.parametrize("heading_deg", [-30.0, 0.0, 30.0])
def test_it_turns_square_on_the_landing_before_it_backs(heading_deg: float) -> None:
    world = Landing(heading_rad=heading_deg * DEG)
    plan = world.run("approach")
    assert world.t_s < 10.0
    assert abs(world.heading_rad) < 1.0 * DEG
    assert all(plan.speed_m_s == 0.0 for plan in world.plans)
    behind = re.search(r"edge (\d\.\d\d) m behind", plan.cause)
    # The first maps of a turn are a tick older than its heading.
    assert float(behind[1]) == pytest.approx(world.x_m - EDGE_M - PIVOT_M, abs=0.015)


def test_an_edge_under_the_chair_holds_it() -> None:
    world = Landing(x_m=EDGE_M + 0.3)
    # A camera of a chair that stands over the edge: it shows the edge all the same.
    world.spoil = lambda seen: replace(seen, nosings_B=np.vstack([[-0.3, 0.0, 0.0], seen.nosings_B]))
    assert world.until_held(5.0) == "square to the flight, and its edge is not behind the chair"
    assert all(plan.speed_m_s == 0.0 for plan in world.plans)
    assert world.tick().hold is not None  # it stands there still: to re-arm alone does not help


def test_the_edge_sequence_gets_place_and_slope_of_the_flight_and_each_update(edge: type[Script]) -> None:
    world = Landing()
    world.run("approach")
    (made,) = edge.made
    assert made.behind_m == pytest.approx(1.6, abs=0.02)
    assert made.around.steepest[0] == pytest.approx(SLOPE_RAD, abs=1e-3)
    assert made.loading.payload_kg == 50.0
    world.run("edge")
    assert made.behind_m == pytest.approx(world.x_m - EDGE_M, abs=0.02)
    assert world.plans[-1].cause == "press: 90 N on the flipper's tip"
    assert world.plans[-1].flipper is not None
    assert not world.plans[-1].needs_stair


@pytest.mark.parametrize(
    ("stage", "eases"), [("press", False), ("lift", False), ("settle", True), ("leave", True), ("lower", False)]
)
@pytest.mark.parametrize("way", [1.0, -1.0], ids=["onto its front", "onto its rear"])
def test_at_the_edge_the_belts_go_with_a_fall_once_the_chair_rests_on_nosings(
    edge: type[Script], stage: str, way: float, *, eases: bool
) -> None:
    """Test: over the edge the chair falls by 4 °/s. Expected result: the plan's own speed goes along, for the guard to limit it;
    not while the flipper turns the chair, or lets it down."""
    edge.stages = (stage,)
    world = Landing()
    world.run("edge")
    world.planner._tip_over.rate_rad_s = way * 4.0 * DEG
    plan = world.planner.step(world.t_s, estimate(world.t_s))
    assert plan.speed_m_s == pytest.approx(-0.1 + way * (LIMIT_M_S if eases else 0.0))
    assert plan.pitch_feedforward_m_s == 0.0


@pytest.mark.usefixtures("edge")
def test_the_whole_way_down_slows_at_the_foot_and_ends_on_the_floor() -> None:
    world = Landing()
    world.run("arrived", limit_s=120.0)
    assert world.phases == ["search", "align", "approach", "edge", "descend", "leave", "arrived"]
    assert world.plans[-1].cause.startswith("on the floor, pitch 0.0°")
    # The front pulley is clear of the first nosing by 10 cm.
    assert world.x_m + PIVOT_M == pytest.approx(-CHAIR.tracks.approach_m, abs=0.02)
    going = [plan.speed_m_s for plan in world.plans if plan.phase == "descend"][1:]
    assert (going[0], going[-1]) == (-0.2, -0.1)
    # It brakes gently, for a chair that brakes downhill is tipped onto its rear.
    brakes = np.diff(going) / TICK_S
    assert brakes.min() >= 0.0
    assert brakes.max() < 1.1 * 0.15
    # Half a metre before the last nosing it is slow, and no stair need be seen.
    slow = [plan for plan in world.plans if plan.phase == "descend" and plan.speed_m_s == -0.1]
    assert len(slow) * TICK_S * 0.1 == pytest.approx(0.5, abs=0.03)
    assert not any(plan.needs_stair for plan in slow[1:])
    assert {plan.speed_m_s for plan in world.plans if plan.phase == "leave"} == {-0.1}
    world.run(limit_s=0.5)
    assert (world.plans[-1].speed_m_s, world.plans[-1].turn_m_s) == (0.0, 0.0)


@pytest.mark.usefixtures("edge")
def test_it_leaves_with_its_flipper_planner_just_above_a_step_and_stows_it_on_the_floor() -> None:
    world = Landing()
    world.run("descend", limit_s=60.0)
    while world.tick().needs_stair:
        pass
    assert world.flipper_rad == pytest.approx(RIDES_RAD, abs=0.5 * DEG)
    world.run("arrived", limit_s=30.0)
    tip_m = CHAIR.tracks.approach_m * math.sin(world.flipper_rad)
    assert tip_m == pytest.approx(RISE_M + CLEAR_M, abs=0.005)
    world.run(limit_s=3.0)
    assert world.flipper_rad == pytest.approx(CHAIR.tracks.approach_angle_deg * DEG, abs=0.5 * DEG)


@pytest.mark.usefixtures("edge")
def test_near_the_last_nosing_a_chair_that_is_nearly_square_is_not_steered() -> None:
    """Test: 0.9° of heading error, slow before the last nosing, with no stair in view, and before. Expected result: equal belt
    speeds there; before, the controller steers."""
    world = Landing()
    world.run("descend", limit_s=60.0)
    world.heading_rad = 0.9 * BLIND_RAD
    assert world.tick().turn_m_s is None
    while world.tick().needs_stair:
        pass
    world.heading_rad = 0.9 * BLIND_RAD
    assert world.tick().turn_m_s == 0.0


@pytest.mark.usefixtures("edge")
def test_off_the_last_nosings_the_flipper_rides_on_and_is_then_lifted_gently() -> None:
    """Test: off the last nosings with three of them under the belts, then with its front 0.25 m before the last but one. Expected
    result: the flipper rides on, 2.5° below the belts' line. Then it is lifted, at 4 °/s from below that line, whatever its motor
    measures, and at 15 °/s from above it."""
    world = Landing()
    world.run("leave", limit_s=120.0)
    assert world.flipper_rate(RIDES_RAD) == pytest.approx(0.0, abs=0.1 * DEG)
    assert world.flipper_rate(0.1 * DEG) < 0.0
    while world.x_m / math.cos(SLOPE_RAD) + PIVOT_M - math.hypot(RUN_M, RISE_M) > 0.24:
        world.tick()
    assert world.flipper_rate(-1.0 * DEG, -30.0) == LETS_DOWN_RAD_S
    assert world.flipper_rate(-1.0 * DEG, 5.0) == LETS_DOWN_RAD_S
    assert world.flipper_rate(0.1 * DEG) == FLIPPER_RAD_S


@pytest.mark.usefixtures("edge")
def test_a_flipper_that_carries_much_gives_way_before_its_motor_is_at_its_limit() -> None:
    """Test: 180 N·m on the flipper as the chair leaves. Expected result: it rises to where both are in balance."""
    world = Landing(tip_n_m=-180.0)
    world.run("leave", limit_s=120.0)
    world.run("arrived", limit_s=30.0)
    tip_m = CHAIR.tracks.approach_m * math.sin(world.flipper_rad - 4.0 * DEG)
    assert tip_m == pytest.approx(RISE_M + CLEAR_M, abs=0.005)


@pytest.mark.usefixtures("edge")
def test_a_nosing_beyond_which_nothing_was_ever_seen_is_not_driven_over() -> None:
    """Test: no frame shows the flight's end. Expected result: slow, and HOLD a quarter of a metre before the lowest nosing seen."""
    world = Landing(shows_end=False)
    plan = held(world, lambda _, seen: seen)
    assert plan.phase == "descend"
    assert plan.hold == "nothing was seen beyond the last nosing, 0.25 m before the rear pulley"
    assert world.plans[-2].speed_m_s == -0.1


def test_a_barred_edge_holds_and_says_why(edge: type[Script]) -> None:
    edge.stages = ("press", "lower", "barred")
    world = Landing()
    world.run("edge")
    assert world.until_held().startswith("the flipper could not let the chair down over the edge; it stands")
    assert world.plans[-1].phase == "edge"


def without(missing: int, from_phase: str = "", reach: float = 3.2) -> Callable[[World, StairMap], StairMap]:
    """Return what a camera makes of a flight whose nosing so many below the edge is missing; before a phase it sees two at most."""

    def spoil(world: Landing, seen: StairMap) -> StairMap:
        phase = world.plans[-1].phase if world.plans else "search"
        edge_x, edge_z = ((EDGE_M - world.x_m), STEPS * RISE_M - world.z_m)
        c, s = math.cos(world.pitch_rad), math.sin(world.pitch_rad)
        edge = edge_x * c + edge_z * s
        pitch_m = math.hypot(RISE_M, RUN_M) if world.pitch_rad > 0.0 else RUN_M
        below = np.round((edge - np.array(seen.nosings_B)[:, 0]) / pitch_m)
        kept = (below != missing) & (np.array(seen.nosings_B)[:, 0] > -reach)
        if from_phase and phase in ("search", "align", "approach") and from_phase not in world.phases:
            kept &= below < 2
        return replace(seen, nosings_B=np.array(seen.nosings_B)[kept], ends=False)

    return spoil


def held(world: Landing, missing: Callable[[World, StairMap], StairMap]) -> MotionPlan:
    world.spoil = lambda seen: missing(world, seen)
    world.until_held(90.0)
    return world.plans[-1]


@pytest.mark.usefixtures("edge")
@pytest.mark.parametrize("missing", [1, 3])
def test_a_step_that_is_missing_below_the_edge_keeps_the_chair_on_the_landing(missing: int) -> None:
    """Test: one of the first three nosings below the edge is missing, and seen to be. Expected result: it stands on the landing."""
    world = Landing()
    plan = held(world, without(missing))
    assert plan.phase == "approach"
    assert re.match(r"a step is missing: 0\.6\d m from nosing to nosing, the first \d\.\d\d m before the rear pulley", plan.hold)


def test_a_step_that_is_seen_to_be_missing_while_the_chair_is_lifted_turns_it_back(edge: type[Script]) -> None:
    """Test: what lies below the second nosing comes into view while the flipper lifts, and there a step is missing. Expected
    result: the flipper lets the chair down again, and then it holds."""
    edge.stages = ("press", "lift", "lift", "lift", "lift", "lift", "lift", "settle", "done")
    world = Landing()
    plan = held(world, without(2, "edge"))
    assert plan.phase == "edge"
    assert edge.made[0].stages == ("lower", "barred")
    assert plan.hold.startswith("a step is missing: 0.6")
    assert "; it stands" in plan.hold


def test_a_step_that_is_seen_to_be_missing_too_late_to_turn_back_stops_the_chair_there(edge: type[Script]) -> None:
    edge.stages = ("settle",) * 50
    world = Landing()
    plan = held(world, without(2, "edge"))
    assert plan.phase == "edge"
    assert "; it stands" not in plan.hold
    assert (plan.speed_m_s, plan.flipper) == (0.0, None)


@pytest.mark.usefixtures("edge")
@pytest.mark.parametrize(("before_m", "share"), [(0.75, 0.2), (1.0, 0.4), (1.6, 0.4)])
def test_nosings_that_are_missed_from_afar_are_not_missing(before_m: float, share: float) -> None:
    """Test: a sound flight, of which maps miss each nosing beyond 1.6 m by chance. Expected result: the chair comes to the edge."""
    for seed in range(2):
        rng = np.random.default_rng(seed)

        def miss(seen: StairMap, rng: np.random.Generator = rng) -> StairMap:
            kept = (np.array(seen.nosings_B)[:, 0] > -1.6) | (rng.random(len(seen.nosings_B)) > share)
            return replace(seen, nosings_B=np.array(seen.nosings_B)[kept], ends=seen.ends and bool(kept[-1]))

        world = Landing(x_m=EDGE_M + before_m, spoil=miss)
        world.run("edge")
        assert not any("is missing" in (plan.hold or "") for plan in world.plans)


@pytest.mark.usefixtures("edge")
@pytest.mark.parametrize("before_m", [0.9, 1.6])
def test_a_nosing_that_no_frame_shows_from_afar_is_not_missing(before_m: float) -> None:
    """Test: a sound flight, of which no map shows what lies between 1.9 and 2.2 m. Expected result: the chair comes to the edge."""

    def hide(seen: StairMap) -> StairMap:
        far = -np.array(seen.nosings_B)[:, 0]
        return replace(seen, nosings_B=np.array(seen.nosings_B)[(far < 1.9) | (far > 2.2)])

    world = Landing(x_m=EDGE_M + before_m, spoil=hide)
    world.run("edge")
    assert not any(plan.hold for plan in world.plans)


@pytest.mark.usefixtures("edge")
def test_an_edge_that_no_map_shows_is_one_step_above_the_first_nosing_in_view() -> None:
    """Test: no map shows the edge, 0.9 m behind mid-track. Expected result: the chair backs to it, as to one in view."""
    seen, hidden = (
        Landing(x_m=EDGE_M + 0.9),
        Landing(x_m=EDGE_M + 0.9, spoil=lambda seen: replace(seen, nosings_B=seen.nosings_B[1:])),
    )
    for world in (seen, hidden):
        world.run("edge")
    assert hidden.x_m == pytest.approx(seen.x_m, abs=0.02)


def test_let_down_on_the_landing_again_the_chair_stows_its_flipper_before_it_holds(edge: type[Script]) -> None:
    """Test: the flipper's tip is on the landing when the edge is barred. Expected result: no HOLD until the flipper is at its
    rest, or has had its time, if it is dead."""
    edge.stages = ("press", "lower", "barred")
    for dead in (False, True):
        world = Landing(flipper_moves=not dead, tips=False)
        world.run("edge")
        world.flipper_rad = -0.1
        began_s = world.t_s
        world.until_held(20.0)
        assert (world.t_s - began_s < 46.0 / 15.0 + 1.05) or not dead  # 0.8 s after a sound flipper would be there, and two stages
        assert dead == (world.flipper_rad < 0.0)


def test_a_chair_is_not_backed_onto_a_flight_that_it_has_not_seen(edge: type[Script]) -> None:
    """Test: while the flipper lifts, no more than a metre below the edge comes into view. Expected result: let down again, HOLD."""
    edge.stages = ("press", "lift", "lift", "lift", "settle", "done")
    world = Landing()
    seen_m = 1.0

    def short(_: World, seen: StairMap) -> StairMap:
        return replace(seen, nosings_B=[place for place in seen.nosings_B if place[0] > EDGE_M - world.x_m - seen_m], ends=False)

    plan = held(world, short)
    assert edge.made[0].stages == ("lower", "barred")
    assert plan.hold.startswith("no more of the flight is in view than the chair needs to lie on, nor its end; it stands")


@pytest.mark.usefixtures("edge")
def test_a_step_that_seems_missing_far_below_the_edge_lets_it_come_nearer_before_it_stops() -> None:
    """Test: the sixth nosing below is missing. Expected result: over the edge, and HOLD 0.5 m before the nosing above."""
    world = Landing()
    plan = held(world, without(6))
    assert plan.phase == "descend"
    assert world.x_m - PIVOT_M * math.cos(SLOPE_RAD) - (EDGE_M - 5 * RUN_M) == pytest.approx(0.5 * math.cos(SLOPE_RAD), abs=0.03)


@pytest.mark.parametrize("heading_deg", [-10.0, 10.0])
def test_a_chair_that_turns_against_its_belts_is_held_and_turns_by_climbing_after_a_re_arm(heading_deg: float) -> None:
    world = Landing(x_m=0.5 * EDGE_M)
    world.run("descend")
    world.heading_rad = heading_deg * DEG
    plan = world.tick()
    assert plan.hold is not None
    assert "one belt slides" in plan.hold
    assert world.tick().phase == "climb"
    world.run("descend")
    assert abs(world.heading_rad) < 1.0 * DEG


@pytest.mark.parametrize("heading_deg", [-10.0, 10.0])
def test_a_chair_with_a_heading_error_on_the_flight_turns_by_climbing_before_it_backs_down(heading_deg: float) -> None:
    world = Landing(x_m=0.5 * EDGE_M, heading_rad=heading_deg * DEG)
    assert "heading error" in world.run("climb").cause
    assert world.run("descend", limit_s=30.0).cause.startswith("square within")
    assert abs(world.heading_rad) < 1.0 * DEG
    assert all(plan.speed_m_s >= 0.0 for plan in world.plans[:-1])


@pytest.mark.parametrize("changes", [{"loop": "open"}, {"vision": "paper"}, {"chair": read_chair("wheelchair-fixed")}])
def test_coming_down_is_refused_without_flipper_closed_loop_or_robust_vision(changes: dict[str, Any]) -> None:
    config = MissionConfig(**({"chair": CHAIR, "direction": "down"} | changes))
    with pytest.raises(SettingsError, match="coming down needs"):
        planner_of(config)


@pytest.mark.usefixtures("edge")
@pytest.mark.parametrize("stuck_s", [0.4, math.inf])
def test_it_leaves_the_stair_only_with_its_flipper_planner_lifted(stuck_s: float) -> None:
    """Test: on its way down the flipper does not move, for 0.4 s near the last nosing, or for good. Expected result: it waits
    until it is lifted and goes on; it holds before the front pulley leaves the last nosing but one, for at its own angle the
    section would drop off."""
    world = Landing()
    plan = world.run("descend", limit_s=120.0)
    world.flipper_rad, world.flipper_moves = 0.0, False
    stood_s = 0.0
    while plan.hold is None and plan.phase != "arrived":
        plan = world.tick()
        stood_s += TICK_S * (plan.speed_m_s == 0.0)
        world.flipper_moves = stood_s > stuck_s
        low = plan.phase != "arrived" and world.flipper_rad < world.planner._stepping_rad - 5.0 * DEG - 0.02
        assert plan.speed_m_s == 0.0 or not low or world.x_m + PIVOT_M - RUN_M > 0.0
    if stuck_s < math.inf:
        assert plan.phase == "arrived"
        assert 0.0 < stood_s < 2.5
        return
    assert "flipper does not rise" in plan.hold
    assert plan.phase == "leave"
    assert world.x_m + PIVOT_M - RUN_M > 0.0
    world.flipper_moves = True  # after a person has looked
    assert world.tick().hold is None
    world.run("arrived", limit_s=20.0)


@pytest.mark.parametrize("heading_deg", [-27.0, 27.0])
def test_maps_from_before_the_heading_is_known_place_no_nosing(heading_deg: float) -> None:
    """Test: three maps of an oblique chair come before its first heading. Expected result: each nosing where it is, and once."""
    world = Landing(heading_rad=heading_deg * DEG, knows=False)
    world.run(limit_s=0.25)
    heading_rad, world.knows = world.heading_rad, True
    world.run(limit_s=0.25)
    seen = [place[0] for k in range(STEPS) if world.in_view((place := world.nosing_B(k))[0])]
    assert abs(world.heading_rad - heading_rad) < 1.0 * DEG
    assert world.planner._where.ahead_m() == pytest.approx(seen, abs=0.01)
