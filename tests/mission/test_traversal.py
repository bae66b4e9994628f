"""What a traversal does in its states, both ways: search, align, sides, steering, riding flipper, feed-forward, re-arming."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from stair_world import JUST_TOO_HIGH_M, STEEPER, TICK_S, World, rising_by, steps
from world import CHAIR, CONFIG, flipper, imu

from treadline.core.angles import DEG
from treadline.core.errors import SettingsError
from treadline.core.signals import FlipperReading, StairMap
from treadline.mission.mission_blocks import planner_of
from treadline.mission.mission_config import MissionConfig
from treadline.scenario.chair import read_chair

# Literals, so that a changed value in the code is detected here (docs/decisions/0019).
OVER_BELTS_DEG, FLIPPER_DEG_S, YIELDS_DEG_S, LATE_S, RIDES_DEG = 2.0, 15.0, 20.0, 0.8, -0.75
LIMIT_M_S = 0.1

BOTH_WAYS = pytest.mark.parametrize("up", [True, False], ids=["up", "down"])


def on_a_flight(*, up: bool = True, away_m: float = -0.8, **changes: Any) -> World:
    """Return a chair that wakes up on a long flight."""
    return World(up=up, nosings=steps(14), away_m=away_m, **changes)


def climbing(**changes: Any) -> World:
    """Return a chair that has begun to climb a long flight."""
    world = on_a_flight(**changes)
    world.run("climb")
    return world


def riding() -> World:
    """Return a chair that climbs with a known nosing under its belts, against which the others' heights count."""
    world = climbing()
    world.run(limit_s=2.0)
    return world


def kept_at(world: World, heading_deg: float, duration_s: float) -> World:
    """Return the chair after it has been kept at a heading."""
    for _ in range(round(duration_s / TICK_S)):
        world.heading_rad = heading_deg * DEG
        world.tick()
    return world


# --- search and align


def test_a_stair_that_comes_into_view_ends_the_search_square_to_it() -> None:
    world = World(heading_rad=-40.0 * DEG)
    world.spoil = lambda seen: seen if world.heading_rad > -20.0 * DEG else None
    world.run("align")
    # Two maps, a tenth of a second apart at 10 °/s.
    assert world.heading_rad / DEG == pytest.approx(-19.0, abs=1.5)
    assert world.run("approach").cause.startswith("square to the stair within")


@BOTH_WAYS
def test_one_map_no_heading_or_a_flight_of_the_other_direction_is_not_enough_to_go(*, up: bool) -> None:
    once = World(up=up)
    once.spoil = lambda seen: seen if once.maps == 1 else None
    other = World(up=up, spoil=lambda seen: replace(seen, direction="down" if up else "up"))
    for world in (once, other, World(up=up, knows=False)):
        world.run(limit_s=0.9)
        assert world.phases == ["search"]


@BOTH_WAYS
def test_where_there_is_no_stair_it_looks_to_both_sides_and_looks_again_when_it_is_re_armed(*, up: bool) -> None:
    world = World(up=up, spoil=lambda _: None, knows=False)
    turned = []
    while world.tick().hold is None:
        turned.append(world.heading_rad / DEG)
    assert (max(turned) > 35.0, min(turned) < -35.0) == (True, True)
    assert all(plan.speed_m_s == 0.0 and not plan.needs_stair for plan in world.plans)
    assert world.plans[-1].turn_m_s == 0.0
    plan = world.tick()
    assert (plan.hold, plan.turn_m_s != 0.0) == (None, True)


@BOTH_WAYS
@pytest.mark.parametrize("heading_deg", [-30.0, -5.0, 0.0, 30.0])
def test_it_turns_square_on_the_spot_within_ten_seconds_and_only_then_drives(heading_deg: float, *, up: bool) -> None:
    world = World(up=up, heading_rad=heading_deg * DEG)
    plan = world.run("approach")
    assert world.t_s < 10.0
    assert abs(world.heading_rad) <= 1.0 * DEG
    assert all(earlier.speed_m_s == 0.0 for earlier in world.plans[:-1])
    # The nosings stood still meanwhile; the first maps of a turn are a tick older than its heading.
    ahead = world.now.stair.first_ahead_m() if up else float(re.findall(r"edge (\d\.\d\d) m behind", plan.cause)[0]) + 0.475
    assert ahead == pytest.approx(-world.x_m if up else world.x_m - world.edge_m, abs=0.03)


def test_an_estimate_that_is_lost_while_it_turns_stops_the_turn() -> None:
    world = World(heading_rad=30.0 * DEG)
    world.run("align")
    world.knows = False
    world.run(limit_s=1.0)
    assert (world.plans[-1].phase, world.plans[-1].speed_m_s, world.plans[-1].turn_m_s) == ("align", 0.0, 0.0)


def test_a_rise_above_the_limit_by_less_than_its_uncertainty_is_looked_at_again_from_nearby() -> None:
    """Test: the rise is 2 mm too high until the flight is 1.4 m away. Expected result: the chair approaches and mounts."""
    world = World(away_m=2.4, spoil=rising_by(JUST_TOO_HIGH_M, until_m=1.4))
    assert world.run("mount", "refused").phase == "mount"


@BOTH_WAYS
def test_a_stair_beyond_the_limits_is_tried_where_the_mission_does_not_check_it(*, up: bool) -> None:
    world = World(up=up, spoil=STEEPER, config=replace(CONFIG, check=False))
    assert world.run("mount", "edge", "refused").phase in ("mount", "edge")


@pytest.mark.parametrize("heading_deg", [-27.0, 27.0])
def test_maps_from_before_the_heading_is_known_place_no_nosing(heading_deg: float) -> None:
    """Test: three maps of an oblique chair come before its first heading. Expected result: each nosing where it is, and once."""
    world = World(up=False, heading_rad=heading_deg * DEG, knows=False)
    world.run(limit_s=0.25)
    world.knows = True
    world.run(limit_s=0.25)
    seen = [place[0] for _, place in world.in_view()]
    assert world.now.stair.ahead_m() == pytest.approx(seen[::-1], abs=0.01)


@pytest.mark.parametrize("changes", [{"loop": "open"}, {"vision": "paper"}, {"chair": read_chair("wheelchair-fixed")}])
def test_coming_down_is_refused_without_flipper_closed_loop_or_robust_vision(changes: dict[str, Any]) -> None:
    with pytest.raises(SettingsError, match="coming down needs"):
        planner_of(MissionConfig(**({"chair": CHAIR, "direction": "down"} | changes)))


# --- a chair that wakes up on a flight


@BOTH_WAYS
def test_on_a_flight_it_stands_until_it_has_a_heading_and_its_flipper_is_laid(*, up: bool) -> None:
    world = on_a_flight(up=up, knows=False)
    world.run(limit_s=2.0)
    assert {(plan.phase, plan.speed_m_s, plan.turn_m_s) for plan in world.plans} == {("search", 0.0, 0.0)}
    world.knows = True
    plan = world.run("climb", "descend")
    assert f"flipper {world.body.angle_rad / DEG:+.0f}° off the belts" in plan.cause
    assert world.body.angle_rad <= OVER_BELTS_DEG * DEG
    assert world.t_s < 2.0 + 38.0 / FLIPPER_DEG_S + LATE_S


@BOTH_WAYS
@pytest.mark.parametrize(
    ("heading_deg", "changes", "waits_s"),
    [
        pytest.param(0.0, {"flipper_moves": False}, 38.0 / FLIPPER_DEG_S + LATE_S, id="stuck: as long as its way takes, and 0.8 s"),
        pytest.param(1.4, {}, 38.0 / FLIPPER_DEG_S, id="nearly square"),
        pytest.param(3.9, {}, 0.0, id="with a heading error: not at all"),
    ],
)
def test_it_waits_for_its_flipper_as_long_as_that_takes(
    heading_deg: float, changes: dict[str, Any], waits_s: float, *, up: bool
) -> None:
    world = on_a_flight(up=up, heading_rad=heading_deg * DEG, **changes)
    world.run("climb", "descend")
    assert world.t_s == pytest.approx(waits_s, abs=0.4)  # a laid flipper slows down over its last degrees


def test_a_chair_that_is_held_on_a_flight_waits_for_its_flipper_once_it_is_let_go() -> None:
    world = on_a_flight(brake_on=True)
    world.run(limit_s=10.0)
    assert {plan.phase for plan in world.plans} == {"search"}
    world.brake_on = False
    world.run("climb")
    assert world.body.angle_rad <= OVER_BELTS_DEG * DEG


# --- approach and mount


def test_a_touch_begins_the_mount_whatever_the_map_says() -> None:
    """Test: the camera shows the flight 0.3 m further away. Expected result: the chair's pitch shows that it has touched."""
    world = World(spoil=lambda seen: replace(seen, nosings_B=[(x + 0.3, y, z) for x, y, z in seen.nosings_B]))
    world.run("mount")
    assert 4.0 * DEG < world.pitch_rad < 6.0 * DEG


def test_a_chair_that_does_not_get_to_the_stair_is_held_and_tries_again_when_it_is_re_armed() -> None:
    """Test: something holds the chair before the stair. Expected result: HOLD after ten seconds, said once."""
    world = World(nosings=steps(3))
    world.run("approach")
    from_s, world.slip = world.t_s, 1.0
    assert world.until_held() == "no progress in 10 s in the state 'approach'"
    assert world.t_s - from_s == pytest.approx(10.0, abs=0.6)  # the belts' first decimetre counts until frames deny it
    world.slip = 0.0
    assert world.run("mount").hold is None


def test_a_stuck_flipper_holds_the_chair_again_when_it_is_re_armed_and_it_goes_on_once_it_moves() -> None:
    world = World(nosings=steps(3), flipper_moves=False)
    for _ in range(2):
        assert "stands at 40° above the belts" in world.until_held()
        world.brake_on = True
        world.run(limit_s=1.0)
        world.brake_on = False
    world.flipper_moves = True
    assert world.run("traction").hold is None


def test_a_pulse_that_a_step_has_spoilt_is_made_again() -> None:
    world = World()
    world.run("traction")
    world.grip = 0.02
    world.run(limit_s=1.4)
    world.grip = 0.5
    plan = world.run("climb", "back_off")
    assert (plan.phase, plan.cause.endswith("of a short test drive")) == ("climb", True)


def test_a_step_that_was_hidden_by_a_thing_is_driven_once_the_thing_is_gone() -> None:
    world = on_a_flight()
    world.run("climb")
    world.spoil = lambda seen: replace(
        seen, nosings_B=[place for place in seen.nosings_B if math.dist(place, world.in_B(*world.nosings[11])) > 0.05]
    )
    assert world.until_held().startswith("a step is missing: 0.68 m from nosing to nosing")
    stood_m, world.spoil = world.x_m, lambda seen: seen
    while world.x_m < stood_m + 0.2:
        assert world.tick().hold is None or world.x_m == pytest.approx(stood_m, abs=0.03)
        assert world.t_s < 60.0


def test_a_missing_step_that_is_seen_late_stops_the_chair_under_its_front_too() -> None:
    world = climbing()
    world.now.stair.gaps_ahead_m = lambda: [(0.405, 1.075)]  # type: ignore[method-assign]
    assert world.tick().hold == "a step is missing: 0.67 m from nosing to nosing, the first 0.07 m behind the front pulley"
    world.now.stair.gaps_ahead_m = lambda: [(-1.0, -0.4)]  # type: ignore[method-assign]
    assert world.tick().hold is None


@pytest.mark.parametrize(("before_m", "share"), [(0.75, 0.2), (1.6, 0.4), (0.9, 0.0), (1.6, 0.0)])
@pytest.mark.parametrize("seed", [0, 1])
def test_nosings_that_are_missed_from_afar_are_not_missing(before_m: float, share: float, seed: int) -> None:
    """Test: a sound flight, of which maps miss each nosing beyond 1.6 m by chance; or none shows what lies between 1.9 and 2.2 m.
    Expected result: the chair comes to the edge."""
    rng = np.random.default_rng(seed)

    def miss(seen: StairMap) -> StairMap:
        far_m = -np.array(seen.nosings_B)[:, 0]
        kept = (far_m < 1.6) | (rng.random(len(far_m)) > share) if share else (far_m < 1.9) | (far_m > 2.2)
        return replace(seen, nosings_B=np.array(seen.nosings_B)[kept], ends=seen.ends and bool(kept[-1]))

    world = World(up=False, away_m=before_m, spoil=miss)
    world.run("edge")
    assert not any(plan.hold for plan in world.plans)


def test_an_edge_that_no_map_shows_is_one_step_above_the_first_nosing_in_view() -> None:
    """Test: no map shows the edge, 0.9 m behind mid-track. Expected result: the chair backs to it, as to one in view."""
    seen, hidden = (
        World(up=False, away_m=0.9),
        World(up=False, away_m=0.9, spoil=lambda seen: replace(seen, nosings_B=seen.nosings_B[1:])),
    )
    for world in (seen, hidden):
        world.run("edge")
    assert hidden.x_m == pytest.approx(seen.x_m, abs=0.02)


# --- sides


def aside(**sides: Any) -> Callable[[StairMap], StairMap]:
    return lambda seen: replace(seen, **sides)


@BOTH_WAYS
@pytest.mark.parametrize(
    ("sides", "cause"),
    [
        ({"left_edge_m": 0.35, "left_side": "open", "left_seen_m": 0.35}, "left side is open 0.35 m"),
        ({"right_edge_m": 0.30, "right_side": "open", "right_seen_m": 0.30}, "right side is open 0.30 m"),
        ({"right_edge_m": 0.30, "right_side": "open", "left_seen_m": None, "right_seen_m": None}, "right side is open 0.30 m"),
    ],
)
def test_a_flight_with_an_open_side_is_not_entered(sides: dict[str, Any], cause: str, *, up: bool) -> None:
    """Test: an open side nearer than the chair sweeps. Expected result: HOLD with the distance before the flight."""
    _is_held_before(World(up=up, spoil=aside(**sides), away_m=1.5), cause)


@pytest.mark.parametrize("up", [True, False])
@pytest.mark.parametrize(
    ("sides", "cause"),
    [
        ({"right_seen_m": 0.20}, "right side was in view up to 0.20 m"),
        ({"left_seen_m": -0.10}, "left side was in view up to 0.00 m"),
    ],
)
def test_a_flight_is_not_entered_unless_it_was_seen_to_bear_the_chair(sides: dict[str, Any], cause: str, *, up: bool) -> None:
    _is_held_before(World(up=up, spoil=aside(**sides), away_m=1.5), cause)


def _is_held_before(world: World, cause: str) -> None:
    held = world.until_held(20.0)
    assert cause in held
    assert f"needs {CHAIR.swept_half_m + 0.02:.2f} m" in held  # 2 cm: the largest error of a measured side
    assert (world.plans[-1].phase, world.before_m > 0.2) == ("approach", True)


@BOTH_WAYS
@pytest.mark.parametrize(("left_m", "right_m", "wall"), [(0.327, 0.87, "left"), (None, 0.327, "right")])
def test_a_chair_that_does_not_fit_past_a_wall_is_held_and_goes_on_once_it_has_been_moved(
    left_m: float | None, right_m: float, wall: str, *, up: bool
) -> None:
    world = World(up=up, spoil=aside(left_wall_m=left_m, right_wall_m=right_m))
    cause = world.until_held()
    # Half of the chair's width of 0.75 m.
    assert f"the {wall} wall is 0.33 m from the chair's middle, which needs 0.38 m: set the chair 0.10 m" in cause
    assert cause.endswith("right" if wall == "left" else "left")
    world.spoil = aside(left_wall_m=0.6, right_wall_m=0.6)
    world.run(limit_s=0.2)
    assert world.run("mount", "edge").hold is None


def test_what_one_map_shows_of_a_side_counts_neither_as_width_nor_as_a_wall() -> None:
    """Test: one map in five shows a wall in the way; treads seen to 0.8 m from afar, and to 0.25 m near the flight; one map alone
    that shows treads to 1 m; maps that do not measure the sides. Expected result: only the last but one holds the chair."""
    world = World()
    goes = World(spoil=lambda seen: replace(seen, left_wall_m=0.3 if goes.maps % 5 == 0 else 0.6))
    passes = World(
        spoil=lambda seen: replace(seen, **dict.fromkeys(("left_seen_m", "right_seen_m"), 0.8 if passes.x_m < -1.2 else 0.25))
    )
    unmeasured = World(spoil=aside(left_seen_m=None, right_seen_m=None))
    for world in (goes, passes, unmeasured):
        world.run("mount")
        assert all(plan.hold is None for plan in world.plans)
    once = World(spoil=lambda seen: replace(seen, left_seen_m=1.0 if once.maps == 4 else 0.2))
    assert "left side was in view up to 0.20 m" in once.until_held(20.0)


@pytest.mark.parametrize("kind", ["wall", "open"])
@pytest.mark.parametrize(
    ("left", "right", "sign"),
    [(None, None, 0), (0.43, None, -1), (None, 0.43, 1), (0.60, None, 0), (0.45, 0.75, -1), (0.75, 0.45, 1), (0.6, 0.6, 0)],
)
def test_it_steers_off_a_side_that_is_near_and_to_the_middle_between_two(
    kind: str, left: float | None, right: float | None, sign: int
) -> None:
    ends = {"left": left, "right": right}
    keys: dict[str, Any] = {f"{side}_wall_m": end_m for side, end_m in ends.items()}
    if kind == "open":
        keys = {f"{side}_edge_m": end_m for side, end_m in ends.items()} | {f"{side}_side": "open" for side in ends}
    world = climbing(spoil=aside(**keys))
    world.run(limit_s=0.5)
    heading = world.plans[-1].heading_rad
    # A wall at the left is left by turning right: a negative heading.
    assert (np.sign(heading), abs(heading) <= 2.0 * DEG) == (sign, True)
    assert world.plans[-1].turn_m_s is None  # the heading's controller steers, however the aim has changed


# --- on the flight


@pytest.mark.parametrize("heading_deg", [-10.0, 10.0])
def test_a_chair_with_a_heading_error_on_the_flight_turns_by_climbing_before_it_backs_down(heading_deg: float) -> None:
    world = on_a_flight(up=False, away_m=-2.0, heading_rad=heading_deg * DEG)
    assert "heading error" in world.run("climb").cause
    world.run("descend", limit_s=30.0)
    assert abs(world.heading_rad) < 1.0 * DEG
    assert all(plan.speed_m_s >= 0.0 for plan in world.plans[:-1])


def test_near_the_ends_a_chair_that_is_nearly_square_is_not_steered_and_its_flipper_still_rides() -> None:
    """Test: 0.9° of heading error on the flight, and slow before its foot or crest. Expected result: the controller steers on the
    flight; equal belt speeds near its end, the flipper below the belts' line in both."""
    for up in (True, False):
        world = World(up=up, nosings=steps(12), away_m=-1.4)
        world.run("climb", "descend")
        assert kept_at(world, 0.9, 1.0).plans[-1].turn_m_s is None
        while world.tick().needs_stair:
            pass
        plan = kept_at(world, 0.9, 0.2).plans[-1]
        assert (plan.turn_m_s, plan.phase) == (0.0, "climb" if up else "descend")
        assert plan.flipper is not None


@pytest.mark.parametrize(("heading_deg", "angle_deg"), [(0.3, RIDES_DEG), (-1.0, 0.625), (5.0, OVER_BELTS_DEG)])
def test_on_the_flight_the_flipper_carries_while_the_chair_is_square_and_is_lifted_for_it_to_turn(
    heading_deg: float, angle_deg: float
) -> None:
    world = riding()
    asked = [flipper_rate(world, angle * DEG, heading_deg) for angle in (angle_deg + 0.3, angle_deg - 0.3)]
    assert asked[0] < 0.0 < asked[1]


def flipper_rate(world: World, angle_rad: float, heading_deg: float = 0.0, torque_n_m: float = 0.0) -> float:
    """Return the rate that the planner asks of a flipper."""
    world.planner.update(flipper(world.t_s, angle_rad, torque_n_m))
    asked = world.planner.step(world.t_s, replace(world.now.estimate, heading_rad=heading_deg * DEG)).flipper
    return float(asked.rate_rad_s)


@pytest.mark.parametrize("load", [0.1, 0.5])
def test_a_flipper_that_rides_on_the_nosings_gives_way_to_them_as_a_spring_and_a_damper(load: float) -> None:
    """Test: a tenth, and half, of its motor's torque on the flipper of a chair that climbs. Expected result: it gives way at as
    much of 20 °/s; it comes to rest half as many degrees higher; twice its torque drives it up at its fastest."""
    world = riding()
    most_n_m, fastest_deg_s = 200.0, 30.0  # of the wheelchair's flipper
    rides_rad = RIDES_DEG * DEG
    assert flipper_rate(world, rides_rad, 0.0, -load * most_n_m) / DEG == pytest.approx(load * YIELDS_DEG_S, abs=0.05)
    assert flipper_rate(world, rides_rad + load * 10.0 * DEG, 0.0, -load * most_n_m) / DEG == pytest.approx(0.0, abs=0.05)
    assert flipper_rate(world, rides_rad, 0.0, -2.0 * most_n_m) / DEG == pytest.approx(fastest_deg_s)


def test_a_flipper_shorter_than_from_nosing_to_nosing_does_not_ride() -> None:
    """Test: nosings 0.5 m apart for a flipper of 0.45 m. Expected result: it yields only to more than half of its torque, for it
    would drop off each nosing and have none to ride on until the next."""
    world = climbing()
    world.now.stair.run_m = 0.48
    assert flipper_rate(world, RIDES_DEG * DEG, 0.0, -40.0) == pytest.approx(0.0, abs=1e-9)


def test_without_a_flippers_reading_the_flipper_is_left_alone() -> None:
    world = on_a_flight()
    update = world.planner.update
    world.planner.update = lambda signal: None if isinstance(signal, FlipperReading) else update(signal)  # type: ignore[method-assign]
    world.run("climb")
    assert all(plan.flipper is None for plan in world.plans)


# --- feed-forward against tipping


def falling(world: World, rate_deg_s: float) -> Any:
    """Return the plan as the IMU reports a pitch rate for longer than the planner's filter, positive as the front drops."""
    world.planner.update(imu(world.t_s + 0.1, world.pitch_rad, rates_rad_s=(0.0, rate_deg_s * DEG, 0.0)))
    return world.planner.step(world.t_s, world.now.estimate)


@pytest.mark.parametrize(
    ("falls_deg_s", "heading_deg", "added_m_s"), [(4.0, 0.0, LIMIT_M_S), (-4.0, 0.0, -LIMIT_M_S), (0.5, 0.0, 0.0), (4.0, 1.6, 0.0)]
)
def test_on_the_flight_the_belts_go_with_a_square_chair_that_falls(
    falls_deg_s: float, heading_deg: float, added_m_s: float
) -> None:
    """Test: its pitch goes down, or up, by 4 °/s; also at a heading at which it turns. Expected result: the plan's speed stays, and
    says what both belts add."""
    world = kept_at(climbing(), heading_deg, TICK_S)
    plan = falling(world, falls_deg_s)
    assert (plan.speed_m_s, plan.turn_m_s, plan.pitch_feedforward_m_s) == (0.2, None, added_m_s)


@BOTH_WAYS
def test_over_the_end_the_belts_follow_the_way_alone_whatever_the_gyro_says(*, up: bool) -> None:
    """Test: over the crest and the edge, its tip free, the chair falls by 4 °/s. Expected result: the plan's speed is the way's."""
    world = World(up=up, nosings=steps(4))
    world.run("crest", "edge")
    while not (world.now.crossing.command.is_unloaded and world.pitch_rad > 27.0 * DEG):
        world.tick()
    plan = falling(world, 4.0)
    assert (plan.speed_m_s, plan.pitch_feedforward_m_s) == (world.now.crossing.command.speed_m_s, 0.0)
