"""The phases of a traversal up, each way in and out, with hand-made maps, belts and IMU; crossing the crest has its own tests."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from climbing_chair import JUST_TOO_HIGH_M, Foot, Script, rising_by
from world import PIVOT_M, RISE_M, SLOPE_RAD, estimate

from treadline.core.angles import DEG
from treadline.core.signals import FlipperReading, OperatorInput, StairMap
from treadline.mission import ascent_states as ascent

# Literals, so that a changed value in the code is detected here.
OVER_BELTS_RAD = 2.0 * DEG

# Flipper and tip-over feed-forward on the flight: docs/decisions/0019.
FLIPPER_RAD_S, RIDES_RAD_S, RIDES_RAD, LAID_RAD, LATE_S = 15.0 * DEG, 20.0 * DEG, -0.75 * DEG, 2.0 * DEG, 0.8
LIMIT_M_S, BLIND_RAD = 0.1, 1.0 * DEG

SQUARE = estimate()


def climbing(**changes: Any) -> Foot:
    """Return a chair that has begun to climb a long flight."""
    world = Foot(steps=14, **changes)
    world.run("climb")
    return world


def on_a_flight(**changes: Any) -> Foot:
    """Return a chair that wakes up on a flight."""
    return Foot(x_m=3.0, z_m=5 * RISE_M, pitch_rad=SLOPE_RAD, **changes)


# --- search and align


def test_a_stair_that_comes_into_view_ends_the_search_square_to_it() -> None:
    def to_the_left(seen: StairMap) -> StairMap | None:
        return seen if world.heading_rad > -20.0 * DEG else None

    world = Foot(heading_rad=-40.0 * DEG, spoil=to_the_left)
    world.run("align")
    # Two maps, a tenth of a second apart at 10 °/s.
    assert world.heading_rad / DEG == pytest.approx(-19.0, abs=1.5)
    assert world.run("approach").cause.startswith("square to the stair within")


def test_one_map_or_no_heading_is_not_enough_to_go() -> None:
    world = Foot(spoil=lambda seen: seen if world.maps == 1 else None)
    world.run(limit_s=0.9)
    assert world.phases == ["search"]
    blind = Foot(knows=False)
    blind.run(limit_s=0.9)
    assert blind.phases == ["search"]


@pytest.mark.parametrize("heading_deg", [-30.0, -5.0, 0.0, 30.0])
def test_it_turns_square_on_the_spot_within_ten_seconds_and_only_then_drives(heading_deg: float) -> None:
    world = Foot(heading_rad=heading_deg * DEG)
    world.run("approach")
    assert world.t_s < 10.0
    assert abs(world.heading_rad) <= 1.0 * DEG
    assert all(plan.speed_m_s == 0.0 for plan in world.plans[:-1])
    # The nosings stood still meanwhile: the mission knows how far the stair is.
    assert world.run("mount").cause == f"first step {world.before_m:.2f} m ahead of the belts' front pulley"


def test_an_estimate_that_is_lost_while_it_turns_stops_the_turn() -> None:
    world = Foot(heading_rad=30.0 * DEG)
    world.run("align")
    world.knows = False
    world.run(limit_s=1.0)
    assert (world.plans[-1].phase, world.plans[-1].speed_m_s, world.plans[-1].turn_m_s) == ("align", 0.0, 0.0)


def test_a_rise_above_the_limit_by_less_than_its_uncertainty_is_looked_at_again_from_nearby() -> None:
    """Test: the rise is 2 mm too high until the flight is 1.4 m away. Expected result: the chair approaches and mounts."""
    world = Foot(first_m=2.4, spoil=rising_by(JUST_TOO_HIGH_M, until_m=1.4))
    assert world.run("approach", "refused").phase == "approach"
    assert world.run("mount", "refused").phase == "mount"


def test_a_rise_that_stays_above_the_limit_is_refused_before_the_chair_touches_the_flight() -> None:
    """Test: the rise is 2 mm too high from everywhere. Expected result: refused on the floor, not later than at the mount."""
    world = Foot(first_m=2.4, spoil=rising_by(JUST_TOO_HIGH_M))
    plan = world.run("mount", "refused")
    assert plan.phase == "refused"
    assert "steep" in plan.cause
    assert world.phases == ["search", "align", "approach", "refused"]
    assert world.before_m > 0.25 - 0.01
    assert world.pitch_rad == 0.0


def test_with_a_flipper_planner_that_does_not_come_down_a_chair_on_a_flight_drives_on_in_time() -> None:
    """Test: woken up on a flight, the flipper stuck at its rest of 40°. Expected result: the chair waits for it as long as its way
    takes and 0.8 s more, then climbs: what to do with a dead flipper is for the crest to say."""
    world = on_a_flight(flipper_moves=False)
    world.run("climb")
    assert world.t_s == pytest.approx((40.0 * DEG - LAID_RAD) / FLIPPER_RAD_S + LATE_S, abs=0.15)


@pytest.mark.parametrize("heading_deg", [0.0, 0.9, 1.4])
def test_nearly_square_a_sound_flipper_planner_is_waited_for_until_it_is_there(heading_deg: float) -> None:
    """Test: woken up on a flight. Expected result: it climbs with its flipper 2° above where it is to be; none is late."""
    world = on_a_flight(heading_rad=heading_deg * DEG)
    plan = world.run("climb")
    lifted = min(max(heading_deg - 0.5, 0.0), 1.0) * OVER_BELTS_RAD  # from half a degree of heading error on
    assert 0.0 < world.flipper_rad < lifted + LAID_RAD
    assert f"flipper {world.flipper_rad / DEG:+.0f}°" in plan.cause
    assert world.t_s < (40.0 * DEG - LAID_RAD) / FLIPPER_RAD_S + LATE_S - 0.1


def test_a_chair_that_is_held_on_a_flight_waits_for_its_flipper_planner_once_it_is_let_go() -> None:
    """Test: woken up with the brake on, for ten seconds, in which the flipper stands as well. Expected result: nothing is late;
    let go, the flipper is laid first."""
    world = on_a_flight(flipper_moves=False, brake_on=True)
    world.run(limit_s=10.0)
    assert {plan.phase for plan in world.plans} == {"search"}
    world.brake_on, world.flipper_moves = False, True
    world.run("climb")
    assert world.flipper_rad <= LAID_RAD


def test_with_a_heading_error_on_a_flight_it_does_not_wait_for_its_flipper() -> None:
    world = on_a_flight(heading_rad=5.0 * DEG)
    world.run("climb")
    assert world.t_s < 0.3


@pytest.mark.parametrize(
    ("falls_deg_s", "heading_deg", "pitch_feedforward_m_s"),
    [(4.0, 0.0, LIMIT_M_S), (-4.0, 0.0, -LIMIT_M_S), (0.5, 0.0, 0.0), (4.0, 1.6, 0.0)],
)
def test_on_the_flight_the_belts_go_with_a_square_chair_that_falls(
    falls_deg_s: float, heading_deg: float, pitch_feedforward_m_s: float
) -> None:
    """Test: its pitch goes down, or up, by 4 °/s; also at a heading at which it turns. Expected result: the plan's speed stays, and
    says what both belts add."""
    world = climbing(heading_rad=heading_deg * DEG)
    planner = world.planner
    planner._tip_over.rate_rad_s = falls_deg_s * DEG
    plan = planner.step(world.t_s, replace(SQUARE, heading_rad=heading_deg * DEG))
    assert (plan.speed_m_s, plan.turn_m_s, plan.pitch_feedforward_m_s) == (0.2, None, pitch_feedforward_m_s)


# --- approach, mount, traction


def test_it_drives_at_the_stair_slower_near_it_with_the_flipper_lowered_and_tests_the_traction() -> None:
    world = Foot()
    world.run("mount")
    near = world.before_m
    assert 0.25 - 0.01 < near < 0.25
    far = [p.speed_m_s for p, x in zip(world.plans, world.xs, strict=True) if p.phase == "approach" and x < world.first_m - 1.05]
    assert set(far[1:]) == {0.2}
    # The tip clears the first nosing by 5 cm: asin(0.21 / 0.45) = 27.8°.
    assert world.flipper_rad / DEG == pytest.approx(27.8, abs=0.5)
    world.run("traction")
    mounting = [plan for plan in world.plans if plan.phase == "mount"][1:]
    assert {plan.speed_m_s for plan in mounting} == {0.1}
    assert world.pitch_rad > SLOPE_RAD - 4.0 * DEG
    # Pitched by nearly the slope, nothing is left to clear; in line with the belts it is where it rides in time.
    assert OVER_BELTS_RAD - 0.1 * DEG < world.flipper_rad < 8.0 * DEG
    world.run(limit_s=1.0)
    assert 0.0 <= world.flipper_rad < OVER_BELTS_RAD
    # The first nosing lies where belts on two nosings lift the rear pulley off the floor.
    assert world.first_m - world.x_m < 0.0
    world.run("climb")
    assert world.phases == ["search", "align", "approach", "mount", "traction", "climb"]
    assert "slipped" in world.plans[-1].cause
    # Belts that held do not stop before they climb.
    began = len(world.plans) - 1
    world.run(limit_s=0.5)
    assert all(0.0 < plan.speed_m_s <= 0.2 for plan in world.plans[began:])


def test_a_touch_begins_the_mount_whatever_the_map_says() -> None:
    def far_off(seen: StairMap) -> StairMap:
        return replace(seen, nosings_B=[(x + 0.6, y, z) for x, y, z in seen.nosings_B])

    world = Foot(spoil=far_off)
    world.run("mount")
    assert 4.0 * DEG < world.pitch_rad < 5.0 * DEG


def test_a_chair_that_does_not_get_to_the_stair_is_held_and_tries_again_when_it_is_re_armed() -> None:
    """Test: something holds the chair before the stair. Expected result: HOLD after ten seconds, said once."""
    world = Foot()
    world.run("approach")
    from_s, world.slip = world.t_s, 1.0
    assert world.until_held() == "no progress in 10 s in the state 'approach'"
    assert world.t_s - from_s == pytest.approx(10.0, abs=0.6)  # the belts' first decimetre counts until frames deny it
    world.slip = 0.0
    assert world.run("mount").hold is None


def test_a_detector_that_does_not_measure_how_far_a_side_is_in_view_drives_on() -> None:
    """Test: no map measures how far nosings are in view; then also a near open side. Expected result: the chair mounts; HOLD at the
    open side, which is measured."""
    unmeasured = {"left_seen_m": None, "right_seen_m": None}
    Foot(spoil=lambda seen: replace(seen, **unmeasured)).run("mount")
    world = Foot(spoil=lambda seen: replace(seen, **unmeasured, left_edge_m=0.35, left_side="open"))
    assert "left side is open 0.35 m" in (world.run(limit_s=20.0).hold or "")
    assert "mount" not in world.phases


def test_a_side_seen_earlier_counts_when_it_leaves_the_view() -> None:
    """Test: treads were in view to 0.8 m from 1 m away, and to 0.25 m near the flight. Expected result: the chair mounts."""

    def spoil(seen: StairMap) -> StairMap:
        near_m = 0.8 if seen.nosings_B[0][0] > 1.2 else 0.25
        return replace(seen, left_seen_m=near_m, right_seen_m=near_m)

    world = Foot(spoil=spoil)
    world.run("mount")


def test_one_map_with_a_side_far_away_proves_no_width() -> None:
    world = Foot()

    def spoil(seen: StairMap) -> StairMap:
        return replace(seen, left_seen_m=1.0 if world.maps == 4 else 0.2)

    world.spoil = spoil
    plan = world.run(limit_s=20.0)
    assert "left side was in view up to 0.20 m" in plan.hold


def test_a_wall_that_one_map_puts_in_the_way_is_none() -> None:
    world = Foot(spoil=lambda seen: replace(seen, left_wall_m=0.3 if world.maps % 5 == 0 else 0.6))
    world.run("climb")
    assert all(plan.hold is None for plan in world.plans)


@pytest.mark.parametrize("stays_deg", [4.0, 40.0])
def test_a_flipper_planner_that_does_not_go_where_it_is_asked_holds_the_chair_on_the_floor(stays_deg: float) -> None:
    """Test: its motor is dead, or stuck, before the stair. Expected result: HOLD 0.8 s after it could be there;
    re-armed, once more."""
    world = Foot(flipper_moves=False)
    world.flipper_rad = stays_deg * DEG
    world.run("approach")
    from_s, idle_s = world.t_s, abs(stays_deg - 27.8) * DEG / FLIPPER_RAD_S + LATE_S
    assert f"stands at {stays_deg:.0f}° above the belts where 28° are asked" in world.until_held(5.0)
    assert world.t_s - from_s == pytest.approx(idle_s, abs=0.03)
    again_s = world.t_s
    world.until_held(5.0)
    assert world.t_s - again_s == pytest.approx(idle_s, abs=0.03)
    world.flipper_moves = True
    assert world.run("climb").hold is None


def test_too_little_friction_backs_off_level_and_refuses_with_the_number() -> None:
    world = Foot(grip=0.02)
    plan = world.run("back_off")
    assert plan.cause.startswith("too little friction: ")
    assert f"below {1.05 * math.tan(SLOPE_RAD):.2f}" in plan.cause
    from_m = world.x_m
    plan = world.run("refused")
    assert plan.cause.startswith("too little friction: ")
    assert world.pitch_rad < 2.0 * DEG
    assert 0.3 < from_m - world.x_m < 0.9
    backing = [plan for plan in world.plans if plan.phase == "back_off"][1:]
    assert {plan.speed_m_s for plan in backing} == {-0.1}
    world.run(limit_s=1.0)
    assert world.plans[-1].speed_m_s == 0.0


def test_a_pulse_that_a_step_has_spoilt_is_made_again() -> None:
    world = Foot()
    world.run("traction")
    world.grip = 0.02
    world.run(limit_s=1.4)
    world.grip = 0.5
    assert world.run("climb", "back_off").phase == "climb"
    assert world.plans[-1].cause.endswith("of a short test drive")


def test_belts_that_only_slip_on_the_first_nosing_end_the_mount_backed_off_and_refused() -> None:
    world = Foot(grip=-0.99)
    plan = world.run("back_off", limit_s=40.0)
    assert "without getting up" in plan.cause
    assert "traction" not in world.phases
    assert world.run("refused").cause == plan.cause


def test_a_chair_that_is_sent_back_from_far_up_backs_down_to_the_floor() -> None:
    """Test: "go back" after three metres, 40 s of backing down. Expected result: no hold on the way, refused on the floor."""
    world = climbing()
    while world.x_m < world.first_m + 3.0:
        world.tick()
    world.planner.update(OperatorInput(t_s=world.t_s, go_back=True))
    assert world.run("refused", limit_s=90.0).cause == "the operator sent the chair back"
    assert not any(plan.hold for plan in world.plans)
    assert world.pitch_rad < 2.0 * DEG


def test_a_missing_step_stops_the_chair_for_good_before_it() -> None:
    def lacks_the_fifth(seen: StairMap) -> StairMap:
        places = np.array(seen.nosings_B)
        heights = places[:, 0] * math.sin(world.pitch_rad) + places[:, 2] * math.cos(world.pitch_rad) + world.z_m
        return replace(seen, nosings_B=np.array(seen.nosings_B)[np.abs(heights - 5 * RISE_M) > 0.05])

    world = Foot(steps=10, spoil=lacks_the_fifth)
    assert world.until_held().startswith("a step is missing: 0.68 m from nosing to nosing")
    assert world.plans[-1].speed_m_s == 0.0
    # It was not missing: somebody's bag lay on it. A person takes it away and re-arms.
    world.spoil = lambda seen: seen
    assert world.run("crest").hold is None


def test_a_missing_step_that_is_seen_late_stops_the_chair_under_its_front_too() -> None:
    world = Foot()
    world.run("climb")
    where = world.planner._where
    where.gaps_ahead_m = lambda: [(PIVOT_M - 0.07, PIVOT_M + 0.6)]  # type: ignore[method-assign]
    assert world.tick().hold == "a step is missing: 0.67 m from nosing to nosing, the first 0.07 m behind the front pulley"
    where.gaps_ahead_m = lambda: [(-1.0, -0.4)]  # type: ignore[method-assign]
    assert world.tick().hold is None


# --- climb: walls and drops


@pytest.mark.parametrize("kind", ["wall", "open"])
@pytest.mark.parametrize(
    ("left", "right", "sign"),
    [(None, None, 0), (0.43, None, -1), (None, 0.43, 1), (0.60, None, 0), (0.45, 0.75, -1), (0.75, 0.45, 1), (0.6, 0.6, 0)],
)
def test_it_steers_off_a_side_that_is_near_and_to_the_middle_between_two(
    kind: str, left: float | None, right: float | None, sign: int
) -> None:
    ends = {"left": left, "right": right}
    keys = {f"{side}_wall_m": end_m for side, end_m in ends.items()}
    if kind == "open":
        keys = {f"{side}_edge_m": end_m for side, end_m in ends.items()} | {f"{side}_side": "open" for side in ends}
    world = Foot(spoil=lambda seen: replace(seen, **keys))
    world.run("climb")
    world.run(limit_s=0.5)
    heading = world.plans[-1].heading_rad
    # A wall at the left is left by turning right: a negative heading.
    assert np.sign(heading) == sign
    assert abs(heading) <= 2.0 * DEG
    assert world.plans[-1].turn_m_s is None  # the heading's controller steers, however the aim has changed


# --- climb to crest, land, arrived


@pytest.fixture
def crest(monkeypatch: pytest.MonkeyPatch) -> type[Script]:
    Script.made = []
    monkeypatch.setattr(ascent, "Crest", Script)
    return Script


def test_the_end_that_frames_show_hands_over_to_the_crest_with_its_place(crest: type[Script]) -> None:
    world = Foot(steps=6)
    world.run("crest")
    (made,) = crest.made
    front = made.ahead_m - PIVOT_M
    assert 0.25 < front < 1.9 - PIVOT_M
    assert made.loading.payload_kg == 50.0
    assert f"pitch {SLOPE_RAD / DEG:.1f}°, 90 N on the flipper's tip" in world.plans[-1].cause
    assert not world.plans[-1].needs_stair


@pytest.mark.parametrize("steps", [1, 2])
def test_at_one_or_two_steps_the_mount_is_the_crest(crest: type[Script], steps: int) -> None:
    """Test: a flight whose last nosing the front reaches before the belts lie on two. Expected result: no traction test with the
    nose in the air; the crest sequence crosses the nosing from the floor."""
    world = Foot(steps=steps, grip=0.5)
    world.run("crest")
    assert world.phases == ["search", "align", "approach", "mount", "climb", "crest"]
    assert crest.made[0].ahead_m < PIVOT_M


def test_an_end_that_no_frame_shows_is_met_where_the_last_nosing_ever_seen_is(crest: type[Script]) -> None:
    world = Foot(steps=6, spoil=lambda seen: replace(seen, ends=False))
    world.run("crest")
    (made,) = crest.made
    assert made.ahead_m - PIVOT_M == pytest.approx(0.25, abs=0.01)


@pytest.mark.usefixtures("crest")
def test_slow_before_the_crest_the_flipper_still_rides_and_small_heading_errors_are_not_steered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Test: 0.9° of heading error as the crest sequence slows down. Expected result: equal belt speeds, the flipper command of the
    flight and not that of the sequence."""
    monkeypatch.setattr(Script, "stages", ("climb", "slow"))
    world = Foot(steps=6)
    world.run("climb")
    while world.plans[-1].speed_m_s != Script.SPEED_M_S:
        world.heading_rad = 0.9 * BLIND_RAD
        world.tick()
    world.heading_rad = 0.9 * BLIND_RAD
    plan = world.tick()
    assert plan.turn_m_s == 0.0
    assert plan.flipper == world.planner._lie()
    assert plan.flipper.rate_rad_s != 0.0


@pytest.mark.usefixtures("crest")
@pytest.mark.parametrize(("stage", "eases"), [("reach", True), ("carry", False), ("lead", False)])
def test_as_it_reaches_for_the_landing_the_belts_go_with_a_fall(
    monkeypatch: pytest.MonkeyPatch, stage: str, *, eases: bool
) -> None:
    """Test: standing on the last nosing the chair falls by 4 °/s. Expected result: the plan's own speed goes along, for the guard
    to limit it; not once the tip carries, nor in a fall that the flipper leads."""
    monkeypatch.setattr(Script, "stages", ("climb", "slow", stage))
    world = Foot(steps=6)
    world.run("crest")
    world.planner._tip_over.rate_rad_s = 4.0 * DEG
    plan = world.planner.step(world.t_s, SQUARE)
    assert plan.speed_m_s == pytest.approx(Script.SPEED_M_S + (LIMIT_M_S if eases else 0.0))
    assert plan.pitch_feedforward_m_s == 0.0


@pytest.mark.usefixtures("crest")
def test_the_crest_follows_its_stages_and_arrives_level() -> None:
    world = Foot(steps=6)
    world.run("land")
    world.run(limit_s=0.5)
    # Done, but still pitched: not there.
    assert world.plans[-1].phase == "land"
    world.first_m = 99.0  # the floor is level from now on
    world.run("arrived")
    assert world.phases[-3:] == ["crest", "land", "arrived"]
    assert world.plans[-1].cause.startswith("on the landing, pitch 0.0°")
    world.run(limit_s=0.5)
    assert (world.plans[-1].speed_m_s, world.plans[-1].turn_m_s) == (0.0, 0.0)


def test_without_a_flippers_reading_the_crest_waits_and_the_flipper_is_left_alone() -> None:
    world = Foot(steps=6)
    silent = world.planner.update
    world.planner.update = lambda signal: None if isinstance(signal, FlipperReading) else silent(signal)  # type: ignore[method-assign]
    world.run("climb")
    assert all(plan.flipper is None for plan in world.plans)


@pytest.mark.parametrize(("heading_deg", "angle_deg"), [(0.3, -0.75), (-1.0, 0.625), (5.0, 2.0)])
def test_on_the_flight_the_flipper_carries_while_the_chair_is_square_and_is_lifted_for_it_to_turn(
    heading_deg: float, angle_deg: float
) -> None:
    world = climbing()
    for _ in range(400):
        world.heading_rad = heading_deg * DEG
        world.tick()
    assert world.plans[-1].phase == "climb"
    assert world.flipper_rad / DEG == pytest.approx(angle_deg, abs=0.1)


@pytest.mark.parametrize("load", [0.1, 0.5])
def test_a_flipper_that_rides_on_the_nosings_gives_way_to_them_as_a_spring_and_a_damper(load: float) -> None:
    """Test: a tenth, and half, of its motor's torque on the flipper of a chair that climbs. Expected result: it gives way at as
    much of 20 °/s; it comes to rest half as many degrees higher; twice its torque drives it up at its fastest."""
    world = climbing()
    world.heading_rad = 0.0
    for _ in range(400):
        world.tick()
    most_n_m, fastest_rad_s = 200.0, 30.0 * DEG  # of the wheelchair's flipper
    assert world.flipper_rate(RIDES_RAD, -load * most_n_m) == pytest.approx(load * RIDES_RAD_S)
    assert world.flipper_rate(RIDES_RAD + load * 10.0 * DEG, -load * most_n_m) == pytest.approx(0.0, abs=1e-9)
    assert world.flipper_rate(RIDES_RAD, -2.0 * most_n_m) == pytest.approx(fastest_rad_s)


def test_a_flipper_planner_shorter_than_from_nosing_to_nosing_does_not_ride() -> None:
    """Test: nosings 0.5 m apart for a flipper of 0.45 m, and as far apart as in a house. Expected result: held, for it would
    drop off each nosing and have none to ride on until the next; and a fifth of the motor's torque turns it where it rides."""
    for run_m, rate_rad_s in ((0.48, 0.0), (0.3, 0.2 * RIDES_RAD_S)):
        world = climbing()
        world.planner._where.run_m = run_m
        assert world.flipper_rate(RIDES_RAD, -40.0) == pytest.approx(rate_rad_s, abs=1e-9)
