"""What leaves the guard: limits of the belts, of seat and flipper; holds, re-arms and sources of commands (rows 10, 12 and 21)."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from drive import Drive, spoils
from world import TICK_S, estimate, heading, imu, limits, stair

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.signals import (
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    OperatorInput,
    SeatCommand,
    SeatReading,
    TrackCommand,
    VelocityCommand,
)
from treadline.guard import Guard

STOPS = {"stop": {"stop": True}, "dead man": {"dead_man": False}}


def test_a_healthy_drive_passes_unchanged() -> None:
    drive = Drive()
    drive.asked = (0.25, 0.29)  # sum and difference of these are rounded
    drive.run(5.0)
    assert (drive.passed.left_m_s, drive.passed.right_m_s) == (0.25, 0.29)
    assert drive.guard.holding is None
    assert drive.events() == []
    assert not drive.guard.rejected
    assert drive.guard.config == limits(has_planner=True, awaits_ground=True, awaits_map=True, awaits_health=True)


def test_a_mission_may_begin_at_any_time_on_its_clock() -> None:
    """Test: the first tick is at 1000 s. Expected result: sources are waited for from then on."""
    drive = Drive()
    drive.tick = 100_000
    assert drive.run(1.0).guard.holding is None
    drive.silent = {"camera"}
    assert drive.ticks_until_held(400, lambda _: None) == pytest.approx(291, abs=2)


# Rows 2 to 4


@pytest.mark.parametrize("kind", ["heading", "map"])
def test_what_repeats_itself_under_a_moving_chair_is_frozen(kind: str) -> None:
    """Test: a camera that measures by itself says the same again and again. Expected result: refused once the belts have run
    50 mm, not before; what is new is admitted again."""
    drive = Drive(needs_heading=False)
    drive.guard.advance(0.0)
    drive.silent = {"camera", "heading", "map"}
    measured = heading(0.0, 1.0) if kind == "heading" else stair(0.0, [1.0, 1.34])
    admitted = []

    def look(drive: Drive) -> None:
        if drive.tick % 10 == 0:
            admitted.append((drive.travel_m, drive.guard.admit(replace(measured, t_s=drive.t_s))))

    drive.run(1.0, look)
    assert all(good == (travel <= 0.05) for travel, good in admitted)
    assert admitted[0][1]
    assert not admitted[-1][1]
    assert drive.guard.admit(heading(1.0, 2.0) if kind == "heading" else stair(1.0, [0.9, 1.24]))


def test_darkness_is_reported_once_and_so_is_light() -> None:
    """Test: three dark frames, then light. Expected result: two events with numbers, no speed lost."""
    drive = Drive().run(0.5)
    drive.spoil = spoils("camera", brightness=0.01)
    drive.run(0.3)
    drive.heal()
    drive.run(0.3)
    assert drive.mean_m_s == pytest.approx(0.2)
    assert drive.events() == [
        ("vision_dim", "colours of mean 0.01, contrast 0.100"),
        ("vision_clear", "colours of mean 0.40, contrast 0.100"),
    ]


@pytest.mark.parametrize(("valid_share", "frozen", "lost"), [(0.03, False, False), (0.01, False, True), (0.03, True, True)])
def test_over_a_crest_a_camera_that_lives_is_enough(valid_share: float, frozen: bool, lost: bool) -> None:
    """Test: where the plan needs no stair the camera looks over a landing in the dark, with 3 % and 1 % of depth, new and frozen.
    Expected result: the camera counts as lost without any depth, or frozen."""
    drive = Drive(blind_timeout_s=1.0)
    drive.phase, drive.needs_stair = "crest", False
    poor = {"valid_share": valid_share, "brightness": 0.0, "contrast": 0.0} | ({"fingerprint": 7} if frozen else {})
    drive.spoil = spoils("camera", **poor)
    assert (drive.run(2.0).guard.holding is not None) is lost


def test_pixels_pass_and_their_quality_speaks_for_them() -> None:
    """Test: a frame's pixels without its quality. Expected result: admitted once, but no frame for the guard."""
    drive = Drive()
    camera = PinholeCamera(width_px=2, height_px=2, fx_px=1.0, fy_px=1.0, cx_px=0.5, cy_px=0.5)
    pixels = RgbdFrame(t_s=0.0, rgb=np.zeros((2, 2, 3), np.uint8), depth_m=np.ones((2, 2), np.float32), camera=camera)
    drive.silent = {"camera"}
    drive.guard.advance(0.0)
    assert [drive.guard.admit(pixels) for _ in range(2)] == [True, False]
    assert drive.run(0.5).events()[0][0] == "slow"


@pytest.mark.parametrize("source", ["heading", "map"])
def test_a_camera_that_measures_headings_or_maps_stands_for_frames(source: str) -> None:
    """Test: headings alone, or maps, as readings; then such as no camera measures. Expected result: frames count as seen, slow
    after 0.3 s, with the reason."""

    class Reads(Drive):
        def send(self, source: str, message: Any) -> None:
            self.guard.admit(message) if isinstance(message, HeadingMeasurement | type(stair(0.0, []))) else super().send(
                source, message
            )

    drive = Reads(awaits_map=source == "map", watches_slip=False)
    drive.silent = {"camera", "map" if source == "heading" else "heading"}
    assert [name for name, _ in drive.run(4.0).events() if name != "map_unwatched"] == []
    lie, reason = {
        "heading": ({"heading_rad": 99.0}, "has a heading of 5672.28°"),
        "map": ({"run_m": 99.0}, "holds a distance that no camera measures"),
    }[source]
    drive.spoil = spoils(source, **lie)
    assert ("slow", f"no frame for 0.30 s: the last {reason}") in drive.run(0.5).events()


# Row 7


@pytest.mark.parametrize("fault", ["drift", "jump"])
def test_a_gyro_that_was_mended_is_reported_once(fault: Any) -> None:
    """Test: the filter has re-referenced the gyro, says so for 2 s, and again later. Expected result: two events, no HOLD."""
    drive = Drive().run(1.0)
    for since_s, lasts_s, cause in ((1.0, 2.0, "gyro drifts by 1.0 °/s"), (None, 0.5, None), (3.5, 0.5, None)):
        drive.spoil = spoils("health", fault=None if since_s is None else fault, since_s=since_s, cause=cause)
        drive.run(lasts_s)
    assert drive.guard.holding is None
    assert drive.events() == [("re-referenced", "gyro drifts by 1.0 °/s"), ("re-referenced", fault)]


def test_a_plan_that_needs_no_stair_waits_for_none() -> None:
    drive = Drive(lost_timeout_s=2.0)
    drive.phase, drive.needs_stair, drive.silent = "land", False, {"heading", "map"}
    assert drive.run(4.0).guard.holding is None


# Row 10


def test_a_clock_that_is_no_number_holds_and_moves_no_stamp() -> None:
    drive = Drive().run(1.0)
    assert drive.guard.step(math.nan, None).tracks.t_s == 0.99
    assert drive.guard.holding == "mission clock is not finite"


def test_what_no_camera_and_no_planner_says_is_rejected_and_reported_once() -> None:
    """Test: unknown words of direction and phase, and a map of 3,000 nosings ten times. Expected result: one event each, the
    tenth second later with the number of those between."""
    guard = Guard(limits())
    guard.step(2.0, None)
    guard.take_events()
    guard.on_message(MotionPlan(t_s=2.0, phase="sideways", speed_m_s=0.1))  # type: ignore[arg-type]
    guard.on_message(stair(2.0, [1.0], direction="sideways"))
    assert [event.cause for event in guard.take_events()] == [
        "MotionPlan has an unknown phase 'sideways'",
        "StairMap leads 'sideways', neither up nor down",
    ]
    for t_s in (*[2.001 + 0.001 * k for k in range(9)], 12.0):
        guard.advance(t_s)
        assert not guard.on_message(stair(t_s, [0.1 * n for n in range(3000)]))
    assert [event.cause for event in guard.take_events()] == ["StairMap holds 3000 nosings; 9 more since"]


def test_after_a_leap_a_person_may_re_arm_on_the_new_clock() -> None:
    """Test: every clock leaps back by 5 s. Expected result: HOLD; after re-arming the drive goes on."""
    drive = Drive().run(6.0)
    drive.tick -= 500
    drive.run(0.6)
    assert drive.guard.holding == "clock of OperatorInput leapt 4.99 s back"
    drive.press(rearm=True)
    drive.run(1.0)
    assert (drive.guard.holding, drive.mean_m_s) == (None, pytest.approx(0.2))


# Rows 11 and 22


@pytest.mark.parametrize(("late_s", "share"), [(0.37, 1.0), (0.60, 0.4), (0.74, 0.02667)])
def test_a_late_tick_ramps_down(late_s: float, share: float) -> None:
    """Test: the tick after 1.0 s comes late, with a new command. Expected result: a part of the speed, then all again."""
    drive = Drive(needs_heading=False).run(1.0)
    drive.tick += round(late_s / TICK_S) - 1
    assert drive.step().left_m_s == pytest.approx(0.2 * share, abs=1e-4)
    assert drive.step().left_m_s == pytest.approx(0.2)
    assert drive.guard.holding is None


def test_a_source_is_not_blamed_for_what_the_guard_missed() -> None:
    """Test: the guard itself stands for 0.5 s and hears nothing after that. Expected result: no HOLD at once; the plan, or a
    drive, is held for at the next tick."""
    drive = Drive(needs_heading=False).run(1.0)
    drive.tick += 50
    drive.silent = {"plan", "operator", "belts", "seat", "flipper", "imu"}
    drive.step()
    assert drive.guard.holding is None
    drive.run(0.02)
    assert (drive.guard.holding or "").startswith("operator link silent")


# Row 12


@pytest.mark.parametrize(("heading_deg", "mean_m_s"), [(0.0, 0.30), (4.9, 0.30), (-5.1, 0.55), (30.0, 0.55)])
def test_the_mean_speed_is_limited_more_when_square_than_when_turning(heading_deg: float, mean_m_s: float) -> None:
    """Test: belts at 0.6 and 0.8 m/s are asked. Expected result: the mean is cut, the difference stays."""
    drive = Drive(watches_slip=False)
    drive.asked, drive.heading_deg = (0.6, 0.8), heading_deg
    drive.run(0.3)
    assert drive.mean_m_s == pytest.approx(mean_m_s)
    assert drive.passed.right_m_s - drive.passed.left_m_s == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ((1.2, 0.6), (0.85, 0.25)),  # mean 0.9 yields to 0.55, the difference of 0.6 stays
        ((-0.2, 1.6), (-0.8, 1.0)),  # half the difference is 0.9: so much is left for the mean
        ((-3.0, 4.0), (-1.0, 1.0)),
        ((-0.9, -0.9), (-0.55, -0.55)),
    ],
)
def test_common_speed_yields_and_steering_keeps(asked: tuple[float, float], expected: tuple[float, float]) -> None:
    """Test: more is asked than the belts can do, at 30° of heading. Expected result: no belt above its limit, steering kept."""
    drive = Drive()
    drive.asked, drive.heading_deg = asked, 30.0
    drive.step()
    assert (drive.passed.left_m_s, drive.passed.right_m_s) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("phase", "speed", "heading_deg", "mean_m_s"),
    [
        ("approach", 0.1, 0.0, 0.145),
        ("back_off", -0.1, 0.0, 0.145),
        ("approach", 0.1, 20.0, 0.55),
        ("climb", 0.1, 0.0, 0.30),
        ("drive", 0.1, 20.0, 0.55),
        ("descend", -0.1, 0.0, 0.30),
        ("crest", 0.2, 0.0, 0.10),
        ("crest", 0.04, 0.0, 0.07),
        ("mount", 0.2, 20.0, 0.10),
        ("traction", 0.2, 0.0, 0.27),
        ("edge", 0.2, 0.0, 0.10),
        ("leave", 0.2, 0.0, 0.10),
    ],
)
def test_each_phase_has_its_speed(phase: Any, speed: float, heading_deg: float, mean_m_s: float) -> None:
    """Test: 0.6 m/s is asked in each phase. Expected result: what the plan says with a margin; ≤ 0.10 m/s where the chair
    pitches; on the flight and while it turns the limits of row 12."""
    drive = Drive()
    drive.asked, drive.heading_deg, drive.phase, drive.plan = (0.6, 0.6), heading_deg, phase, {"speed_m_s": speed}
    drive.run(0.3)
    assert drive.mean_m_s == pytest.approx(mean_m_s)


@pytest.mark.parametrize(
    ("phase", "speed_m_s", "turn_m_s", "right_m_s", "brake"),
    [
        ("arrived", 0.1, None, 0.0, True),
        ("refused", 0.1, None, 0.0, True),
        ("crest", 0.0, 0.0, 0.0, False),
        ("align", 0.0, 0.1, 0.1, False),
        ("climb", 0.1, 0.0, 0.1, False),
        ("align", 0.0, None, 0.1, False),
    ],
)
def test_a_plan_that_ends_or_stands_stops_the_belts(
    phase: Any, speed_m_s: float, turn_m_s: Any, right_m_s: float, brake: bool
) -> None:
    """Test: the driver asks to turn on the spot. Expected result: belts at rest at this tick, braked at an end; a plan of turning,
    or of speed, lets it pass; no HOLD."""
    drive = Drive().run(1.0)
    drive.asked, drive.phase, drive.plan = (-0.1, 0.1), phase, {"speed_m_s": speed_m_s, "turn_m_s": turn_m_s}
    passed = drive.step()
    assert (passed.right_m_s, passed.brake, drive.guard.holding) == (pytest.approx(right_m_s), brake, None)


@pytest.mark.parametrize(("t_s", "stands"), [(0.8, False), (0.99, False), (0.995, True)])
def test_of_two_plans_the_later_counts_and_of_two_at_once_the_first(t_s: float, stands: bool) -> None:
    drive = Drive().run(1.0)
    drive.silent = {"plan"}
    drive.guard.on_message(MotionPlan(t_s=t_s, phase="crest", speed_m_s=0.0, turn_m_s=0.0))
    assert (drive.step().left_m_s == 0.0) is stands


def test_a_recording_does_not_obey_and_is_not_held_for_it() -> None:
    """Test: belts, seat and attitude of another drive, ``watches_motion = False``. Expected result: no HOLD."""
    drive = Drive(watches_motion=False)

    def spoil(_: str, said: Any) -> Any:
        match said:
            case SeatReading():
                return replace(said, pitch_rad=0.3)
            case ImuSample():
                return imu(said.t_s, 60.0 * DEG)
        return replace(said, left_m_s=-0.5, right_m_s=0.7) if hasattr(said, "brake_on") else said

    drive.spoil = spoil
    assert drive.run(3.0).guard.holding is None


def test_an_open_loop_run_needs_no_heading_but_still_needs_a_driver() -> None:
    """Test: no IMU, no camera, NaN for an estimate, a chair that tips, then no command. Expected result: commands pass, then
    HOLD."""
    drive = Drive(needs_heading=False, lost_timeout_s=2.0, awaits_ground=False)
    drive.silent = {"camera", "heading", "map", "ground"}
    drive.pitch_rad, drive.heading_deg = 50.0 * DEG, math.nan
    drive.run(4.0)
    assert drive.mean_m_s == pytest.approx(0.2)
    assert [name for name, _ in drive.events()] == ["drop_unwatched", "rejected"]  # the estimate
    drive.silent.add("driver")
    drive.run(1.0)
    assert [name for name, _ in drive.events()] == ["slow", "hold"]


# Row 14


@pytest.mark.parametrize("why", ["turning", "no estimate", "crest"])
def test_slip_is_not_asked_where_nosings_do_not_pass_as_belts_run(why: str) -> None:
    """Test: half the travel is lost while the chair turns, before a heading is known, over the crest. Expected result: no event."""
    drive = Drive()
    drive.silent = {"heading", "estimate"} if why == "no estimate" else set()
    drive.phase, drive.slip = "crest" if why == "crest" else "climb", 0.5

    def each(drive: Drive) -> None:
        if why == "turning":
            drive.heading_deg = 2.0 * drive.t_s - 3.0

    assert drive.run(3.0, each).events() == []


def test_a_way_driven_back_on_purpose_is_not_rolled_back() -> None:
    """Test: up the flight for 1.5 s, then 0.5 m back as a plan has it, without a map, and up again. Expected result: no event."""
    drive = Drive(awaits_map=False).run(1.5)
    drive.events()
    for phase, speed_m_s, seconds, unseen in (("back_off", -0.2, 2.5, {"map"}), ("climb", 0.2, 2.0, set[str]())):
        drive.asked, drive.phase, drive.plan, drive.silent = (speed_m_s, speed_m_s), phase, {"speed_m_s": speed_m_s}, unseen
        drive.run(seconds)
    assert drive.events() == []


# Row 19, seat and flipper


@pytest.mark.parametrize(("error_deg", "steady"), [(0.0, True), (2.0, True), (-2.0, True), (2.1, False), (-2.1, False)])
@pytest.mark.parametrize("phase", ["climb", "crest"])
def test_near_level_the_seat_moves_slowly_where_the_pitch_is_steady(error_deg: float, steady: bool, phase: Any) -> None:
    """Test: a seat on either side of 2°, on the flight and where the chair pitches. Expected result: 0.02 m/s near level on the
    flight, so that it does not follow each rocking; else all that its actuator gives, 0.06 m/s."""
    drive = Drive()
    drive.phase, drive.spoil = phase, spoils("seat", pitch_rad=error_deg * DEG)
    limit = 0.02 if steady and phase == "climb" else 0.06
    for asked in (0.02, 0.06, 5.0, -0.06, -5.0):
        drive.seat_m_s = asked
        assert drive.run(0.02).seat.rate_m_s == math.copysign(min(abs(asked), limit), asked)


def test_a_seat_that_is_held_for_is_left_alone_and_one_that_is_sound_goes_on_under_a_hold() -> None:
    drive = Drive()
    drive.seat_m_s = 0.02
    drive.run(0.5).press(stop=True)
    assert drive.run(0.1).seat.rate_m_s == 0.02
    drive.spoil = spoils("seat", pitch_rad=6.0 * DEG)
    assert drive.run(1.1).seat.rate_m_s == 0.0


@pytest.mark.parametrize("stamp_s", [math.nan, 1e6, -1e6])
def test_a_seat_command_of_another_time_does_not_move_the_seat_and_an_old_one_not_for_long(stamp_s: float) -> None:
    """Test: seat rates stamped wrongly; then a leveller that dies. Expected result: zero rate; zero after 0.1 s."""
    drive = Drive().run(1.0)
    drive.run(0.5, lambda drive: drive.guard.propose(SeatCommand(t_s=stamp_s, rate_m_s=5.0)))
    assert drive.seat == SeatCommand(t_s=drive.passed.t_s, rate_m_s=0.0)
    assert [name for name, _ in drive.events()] == ["rejected"]
    for asked_m_s, seconds, rate_m_s in ((0.02, 0.1, 0.02), (None, 0.1, 0.02), (None, 0.02, 0.0)):
        drive.seat_m_s = asked_m_s
        assert drive.run(seconds).seat.rate_m_s == rate_m_s


@pytest.mark.parametrize("name", ["belts", "seat", "flipper"])
def test_what_a_chair_does_not_have_is_not_waited_for_nor_what_no_command_moves(name: str) -> None:
    """Test: belts, seat or flipper report nothing, in a chair that has none, or in a recording. Expected result: no HOLD, and no
    rate for what is not there."""
    without = {"seat": {"seat_rate_m_s": None}, "flipper": {"flipper_rate_rad_s": None}, "belts": {"watches_motion": False}}[name]
    for changes in (without, {"watches_motion": False}):
        drive = Drive(**changes)
        drive.silent, drive.seat_m_s = {name}, 0.01
        drive.run(2.0)
        assert drive.seat.rate_m_s == (drive.guard.config.seat_rate_m_s is not None) * 0.01
        assert drive.flipper is not None
        assert drive.flipper.rate_rad_s == (drive.guard.config.flipper_rate_rad_s is not None) * 0.1
        assert drive.guard.holding is None


@pytest.mark.parametrize(("asked_rad_s", "passed_rad_s"), [(0.2, 0.2), (-9.0, -30.0 * DEG), (math.nan, None)])
def test_a_flipper_moves_within_its_limit_and_not_under_a_hold_nor_by_an_old_plan(asked_rad_s: float, passed_rad_s: Any) -> None:
    """Test: a plan with a flipper's rate, within and beyond the chair's limit, and NaN; then no plan, then HOLD. Expected result:
    passes within the limit; stopped after 0.1 s; zero."""
    drive = Drive()
    drive.spoil = lambda source, said: (
        replace(said, flipper=replace(said.flipper, rate_rad_s=asked_rad_s)) if source == "plan" else said
    )
    drive.run(0.1)
    assert (None if drive.flipper is None else drive.flipper.rate_rad_s) == passed_rad_s
    drive.silent = {"plan"}
    assert drive.run(0.12).flipper is None
    drive.silent = set()
    drive.press(stop=True)
    drive.step()
    assert drive.flipper is None or drive.flipper.rate_rad_s == 0.0


# Row 21


@pytest.mark.parametrize("press", STOPS.values(), ids=STOPS)
def test_the_operators_stop_acts_within_the_tick_and_only_a_person_re_arms(press: dict[str, bool]) -> None:
    """Test: stop, or the dead-man released; readings go on; re-arm. Expected result: zero within the tick, held until re-armed."""
    drive = Drive().run(1.0)
    drive.press(**press)
    command = drive.step()
    cause = "operator stop" if "stop" in press else "the dead-man switch is released"
    assert (command.left_m_s, command.right_m_s, drive.guard.holding) == (0.0, 0.0, cause)
    assert drive.run(2.0).passed.brake
    drive.press(rearm=True)
    drive.run(1.0)
    assert drive.mean_m_s == pytest.approx(0.2)
    assert drive.events() == [("hold", cause), ("rearmed", f"by a person, after: {cause}")]


def test_a_re_armed_chair_stands_until_somebody_drives() -> None:
    """Test: the driver dies, the guard holds, a person re-arms; later the driver is back, its first command from before. Expected
    result: not a step before."""
    drive = Drive().run(1.0)
    drive.silent = {"driver"}
    drive.run(1.6).press(rearm=True)
    drive.guard.propose(TrackCommand(t_s=drive.t_s - 0.05, left_m_s=0.2, right_m_s=0.2))
    for _ in range(50):
        drive.step()
        assert (drive.guard.holding, drive.mean_m_s) == (None, 0.0)
    drive.silent = set()
    assert drive.run(0.5).mean_m_s == pytest.approx(0.2)


def test_a_stop_counts_however_old_and_a_re_arm_does_not() -> None:
    """Test: messages that were overtaken. Expected result: an old stop holds; an old re-arm does nothing."""
    guard = Guard(limits())
    guard.advance(2.0)
    assert guard.admit(OperatorInput(t_s=1.0))
    assert not guard.admit(OperatorInput(t_s=0.9, stop=True))
    assert not guard.admit(OperatorInput(t_s=0.95, rearm=True))
    assert guard.holding == "operator stop"


def test_a_plan_that_asks_for_a_hold_is_obeyed_whatever_its_stamp_and_an_earlier_press_does_not_end_it() -> None:
    drive = Drive().run(1.0)
    drive.guard.on_message(MotionPlan(t_s=1e6, phase="climb", speed_m_s=0.2, hold="no way"))
    drive.guard.admit(OperatorInput(t_s=0.995, rearm=True))
    assert drive.run(1.0).guard.holding == "no way"


def test_to_re_arm_a_chair_that_is_not_held_changes_nothing() -> None:
    """Test: re-arm while driving without frames. Expected result: no event, no clock restarted."""
    drive = Drive().run(2.01)
    drive.silent = {"camera"}
    drive.run(1.0).press(rearm=True)
    assert drive.ticks_until_held(300, lambda _: None) == pytest.approx(200, abs=2)
    assert [name for name, _ in drive.events()] == ["slow", "hold"]


# Row 25


def test_a_map_that_comes_twice_counts_once() -> None:
    """Test: one map as a reading, and again as what was made of it. Expected result: no obstacle yet; a second one holds."""
    drive = Drive().run(1.0)
    once = stair(drive.t_s - 0.001, drive.nosings(), obstacle_m=0.5)
    drive.silent = {"map"}
    assert drive.guard.admit(once)
    drive.guard.on_message(once)
    assert drive.run(0.5).guard.holding is None
    drive.guard.admit(stair(drive.t_s - TICK_S, [], obstacle_m=0.4))
    drive.step()
    assert drive.guard.holding == "obstacle -0.60 m ahead"


# Velocity commands


def joystick(drive: Drive) -> None:
    """Drive at 0.1 m/s, with a command each tenth of a second, 5 ms under way."""
    if drive.tick % 10 == 0:
        drive.guard.propose(VelocityCommand(t_s=drive.t_s - 0.005, speed_m_s=0.1, turn_rad_s=0.0))


def idle() -> Drive:
    """Return a chair on the floor without a traversal."""
    drive = Drive(awaits_map=False, watches_slip=False)
    drive.phase, drive.needs_stair, drive.pitch_rad = "arrived", False, 0.0
    drive.run(0.2).events()
    return drive


def test_velocities_drive_while_no_traversal_is_under_way() -> None:
    """Test: a driver without a goal that still asks for 0.2 m/s, velocities of 0.1 m/s, a traversal, and its end. Expected result:
    each source in its time; after a change belts at rest until a new command comes; no hold."""
    drive = idle()
    for phase, source, speed_m_s in (("arrived", "velocity", 0.1), ("land", "driver", 0.2), ("arrived", "velocity", 0.1)):
        drive.phase = phase
        drive.run(0.01, joystick)
        assert (drive.guard.source, drive.mean_m_s) == (source, 0.0)
        assert drive.run(1.0, joystick).mean_m_s == pytest.approx(speed_m_s)
    assert drive.guard.holding is None
    assert [name for name, _ in drive.events()] == ["source"] * 3


def test_velocities_that_fall_silent_stop_the_chair_and_no_person_has_to_re_arm_it() -> None:
    """Test: the last velocity at 1.2 s. Expected result: the belts ramp down from 1.6 s on and stand, braked, at 1.96 s; no hold; a
    planner that falls silent meanwhile is held for."""
    drive = idle().run(1.01, joystick)
    assert drive.run(0.3).mean_m_s == pytest.approx(0.1)
    assert 0.0 < drive.run(0.3).mean_m_s < 0.06
    drive.run(0.16)
    assert (drive.guard.source, drive.passed.brake, drive.mean_m_s) == ("driver", True, 0.0)
    assert drive.run(1.0).guard.holding is None
    drive.silent = {"plan"}
    assert (drive.run(0.35, joystick).guard.holding or "").startswith("plan silent")


@pytest.mark.parametrize("late_s", [-0.2, 3.1, math.nan])
def test_a_velocity_of_another_time_drives_nothing(late_s: float) -> None:
    """Test: velocities 0.2 s ahead of the clock, 3.1 s old, of no time. Expected: the chair stands; rejected and reported."""
    drive = idle()
    drive.run(4.0, lambda drive: drive.guard.propose(VelocityCommand(t_s=drive.t_s - late_s, speed_m_s=0.1, turn_rad_s=0.0)))
    assert (drive.guard.source, drive.mean_m_s) == ("driver", 0.0)
    assert drive.guard.rejected["VelocityCommand"] > 300
    assert [name for name, _ in drive.events()] == ["rejected"]


def test_an_estimate_of_the_past_is_not_used() -> None:
    drive = Drive().run(1.0)
    drive.guard.step(drive.t_s, estimate(0.5, 30.0 * DEG))
    drive.asked = (0.6, 0.6)
    assert drive.run(0.02).mean_m_s == pytest.approx(0.30)  # square: 0.55 m/s at 30°
