"""Monitors of the guard by themselves: what the rules' faults do not reach, at values that are exact in binary."""

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from world import belts, flipper, frame, heading, imu, known, limits, stair

from treadline.core.angles import DEG
from treadline.core.rotations import rotation_z
from treadline.core.signals import FreeGround, ImuSample, MotionPlan, SeatReading, TrackCommand
from treadline.guard import Guard, GuardConfig, ReadingAdmission
from treadline.guard._attitude_limits import SeatMonitor
from treadline.guard._belt_monitor import BeltMonitor
from treadline.guard._frame_monitor import FrameMonitor
from treadline.guard._gyro_only_turn import GyroOnlyTurn
from treadline.guard._half_cosine_stop import Stop
from treadline.guard._obstacle_monitor import AheadMonitor, gap_between
from treadline.guard._sightings import Sightings
from treadline.guard._slip_monitor import SlipMonitor
from treadline.guard._stamps import Stamps
from treadline.guard._swept_outline import SweptOutline
from treadline.guard.stop_latch import Latch

NOW = known(limits())

FLIGHT_RAD_M = 1.0 / 0.65


LEVEL_RAD_M = 0.789 / 0.65


OVER_RAD_M = 0.26 / 0.65


def test_the_shipped_limits_are_those_of_the_table() -> None:
    """Test: the defaults that no rule's case meets closely. Expected result: the numbers of the table of hazards."""
    config = limits()
    deg = math.pi / 180.0
    assert (config.alive_least, config.dark, config.contrast_least, config.valid_least_dark) == (0.02, 0.02, 0.008, 0.3)
    assert (config.slip_turn_rad, config.gyro_drift_rad_s) == (0.25 * deg, 1.5 * deg)
    assert (config.blind_turn_rad, config.blind_turn_s, config.roll_back_m) == (3.0 * deg, 6.0, 0.25)
    assert (config.gap_clear_m, config.obstacle_clear_m, config.stopping_s) == (0.2, 0.34, 0.4)
    assert (config.heartbeat_timeout_s, config.clock_jump_s, config.ahead_s, config.lasting_s) == (0.75, 1.0, 0.1, 0.5)
    assert all(field.default is (field.name[:6] != "awaits") for field in fields(config) if field.type is bool)


def test_a_stamp_may_be_off_by_its_limits_and_not_by_more() -> None:
    """Test: stamps at the limits and beyond, ahead, back, old. Expected result: rejected only beyond; a leap only beyond its own;
    nothing before the first tick, and events for none that was merely repeated or overtaken."""
    stamps = Stamps(limits(ahead_s=0.125, blind_timeout_s=4.0))
    ahead, back = "TrackReading stamped 1.12 s ahead of the clock", "TrackReading stamped 1.12 s before the last one"
    leaps = [f"clock of TrackReading leapt 1.12 s {way}" for way in ("ahead", "back")]
    assert not stamps.accept(belts(1.0))  # before the first tick
    assert (stamps.leap, stamps.rejection) == (None, None)
    for now_s, message, leap, rejection in (
        (1.0, belts(1.125), None, ""),
        (1.0, belts(2.0), None, "TrackReading stamped 1.00 s ahead of the clock"),
        (1.0, belts(2.125), leaps[0], ahead),
        (1.0, belts(0.125), None, None),
        (1.0, belts(1.125), None, None),
        (1.0, belts(0.0), leaps[1], back),
        (1.0, belts(0.125), None, ""),  # the new clock goes on
        (1.0, flipper(0.5, 0.1), None, ""),  # each kind has its own
        (4.25, belts(0.25), None, ""),
        (4.5, belts(0.375), None, "TrackReading is 4.12 s old"),
    ):
        stamps.advance(now_s)
        assert stamps.accept(message) is (rejection == "")
        assert stamps.leap == leap
        assert rejection in ("", stamps.rejection)
    assert stamps.accept(flipper(0.5, 0.1), "a second sender")
    assert stamps.rejected == {"TrackReading": 7}


def test_a_node_admits_what_the_guard_admits() -> None:
    """Test: readings that are sound, repeated, and not finite. Expected result: an admission alone answers as the guard does."""
    admission, guard = ReadingAdmission(limits()), Guard(limits())
    admission.advance(0.0)
    guard.advance(0.0)
    signals = [belts(0.0, 0.1, 0.1), belts(0.0, 0.1, 0.1), belts(0.01, math.nan, 0.1), belts(0.02, 0.1, 0.1)]
    assert (
        [admission.admit(signal) for signal in signals] == [guard.admit(signal) for signal in signals] == [True, False, False, True]
    )


def test_the_latch_reports_each_change_once() -> None:
    latch = Latch(limits())
    latch.hold(1.0, Stop.RAMP, None)
    assert latch.cause is None
    latch.hold(2.0, Stop.RAMP, "first")
    latch.hold(3.0, Stop.RAMP, "second")
    assert (latch.cause, latch.held_s) == ("first", 2.0)
    latch.release(4.0)
    for k, kind in enumerate(("a", "a", "b", "", "")):
        latch.slow(5.0 + k, kind, f"cause {k}")
    events = [(event.t_s, event.name, event.cause) for event in latch.take()]
    assert events[1:] == [
        (4.0, "rearmed", "by a person, after: first"),
        *[(5.0 + k, name, f"cause {k}") for k, name in ((0, "slow"), (2, "slow"), (3, "resumed"))],
    ]
    assert latch.take() == []


@pytest.mark.parametrize(
    ("brightness", "contrast", "valid", "usable", "dark"),
    [
        (0.25, 0.125, 0.25, True, False),
        (0.25, 0.125, 0.1875, False, False),
        (0.125, 0.125, 0.5, True, False),
        (0.0625, 0.125, 0.5, True, True),
        (0.0625, 0.125, 0.4375, False, True),
        (0.875, 0.125, 0.4375, True, False),
        (0.9375, 0.125, 0.4375, False, True),
        (0.5, 0.0625, 0.4375, True, False),
        (0.5, 0.03125, 0.4375, False, True),
    ],
)
def test_a_frame_is_judged_at_its_limits(brightness: float, contrast: float, valid: float, usable: bool, dark: bool) -> None:
    """Test: values on a limit and next to it. Expected result: on the limit it is good."""
    watch = FrameMonitor(limits(valid_least=0.25, valid_least_dark=0.5, dark=0.125, contrast_least=0.0625))
    seen = frame(0.0, fingerprint=1, brightness=brightness, contrast=contrast, valid_share=valid)
    assert watch.accept_frame(seen) is usable
    assert (watch.refused == "") is usable
    assert watch.is_dark is dark


def test_a_camera_lives_on_its_least_share_of_depth_or_by_its_colours_if_its_image_is_new() -> None:
    """Test: in the dark, shares on the limit and below, and the same frame again; colours without depth, and the same again."""
    watch = FrameMonitor(limits(alive_least=0.125, valid_least=0.5))
    for number, colours, share, alive in (
        (0, 0.0, 0.125, True),
        (1, 0.0, 0.0625, False),
        (2, 0.0, 0.75, True),
        (2, 0.0, 0.75, False),
        (3, 0.5, 0.0, True),
        (3, 0.5, 0.0, False),
    ):
        watch.accept_frame(frame(0.0, fingerprint=number, brightness=colours, contrast=0.2 * colours, valid_share=share))
        assert watch.is_alive is alive, (number, share)


def test_a_frame_that_is_no_image_shows_that_no_camera_is_alive() -> None:
    """Test: after a good frame, frames whose shares are not numbers. Expected result: dead, though each is another."""
    admission = ReadingAdmission(limits())
    admission.advance(0.0)
    watch = admission.frames
    assert not watch.is_dark  # before any frame
    assert watch.accept_frame(frame(0.0, fingerprint=0, brightness=0.5, contrast=0.1, valid_share=0.8))
    for k in range(1, 4):
        assert not admission.admit(frame(0.001 * k, fingerprint=k, brightness=0.5, contrast=math.nan, valid_share=math.nan))
        assert not watch.is_alive
    assert not admission.admit(heading(0.003))


def test_what_is_said_again_is_frozen_beyond_a_way_and_not_at_it() -> None:
    """Test: one value over 0.0625 m of belt, backwards too, and over more. Expected result: frozen beyond."""
    for sign in (1.0, -1.0):
        watch = FrameMonitor(limits(frozen_travel_m=0.0625))
        assert watch.accept_measurement("map", 0.0, 1, 4.0)
        assert watch.accept_measurement("map", 0.5, 1, 4.0 + sign * 0.0625)
        assert not watch.accept_measurement("map", 1.0, 1, 4.0 + sign * 0.125)
        assert watch.refused == "is frozen"
        assert watch.accept_measurement("heading", 1.0, 1, 4.125)
        assert watch.accept_measurement("map", 1.5, 2, 4.0 + sign * 0.125)
        assert watch.accept_measurement("map", 2.0, 2, 4.0 + sign * 0.1875)
        assert watch.refused == ""
        # Two old values in turn are no new ones, until they are three seconds old.
        assert watch.accept_measurement("map", 2.5, 1, 4.0 + sign * 0.25)
        assert not watch.accept_measurement("map", 3.0, 2, 4.0 + sign * 0.375)
        assert not watch.accept_measurement("map", 3.5, 1, 4.0 + sign * 0.375)
        assert watch.accept_measurement("map", 7.0, 2, 4.0 + sign * 0.375)


def test_a_belt_is_expected_to_lag_within_its_acceleration() -> None:
    """Test: from rest, 1 m/s and -0.1 m/s are asked; then the brake. Expected result: a lag's exponential, cut to the acceleration,
    and the brake's deceleration to zero and no further, both ways."""
    watch, lag = BeltMonitor(limits(drive_lag_s=0.25, drive_acceleration_m_s2=2.0)), math.exp(-0.25)
    asked = known(limits(), passed=TrackCommand(t_s=0.0, left_m_s=1.0, right_m_s=-0.1))
    watch.hear(belts(0.0, 0.0, 0.0), asked)
    for k, expected in ((1, [0.125, -0.1 * (1.0 - lag)]), (2, [0.25, -0.1 * (1.0 - lag * lag)])):
        watch.hear(belts(k / 16, 0.0, 0.0), asked)
        assert watch.expected_m_s == pytest.approx(expected)
    watch.hear(belts(1.0, 1.0, -0.75), asked)  # after a gap the readings count
    for k, braked in ((1, (0.375, -0.125)), (2, (0.0, 0.0))):
        watch.hear(belts(1.0 + k / 16, 0.0, 0.0), known(limits(), passed=TrackCommand.stop(0.0)))
        assert watch.expected_m_s == braked


def test_a_belt_may_differ_by_its_share_for_a_time() -> None:
    """Test: 0.5 m/s asked; a quarter and 1/16 m/s are allowed; on the limit, below, for the time and for less. Expected result:
    a cause for what lasts, and none where it comes and goes."""
    asked = known(limits(), speed_m_s=0.5)

    def run(*lefts: float) -> str | None:
        watch = BeltMonitor(limits(deviation=0.25, mismatch_spare_m_s=0.0625, mismatch_s=0.25))
        watch.hear(belts(0.0, 0.5, 0.5), asked)
        for k, left in enumerate(lefts, start=1):
            watch.hear(belts(k / 16, left, 0.5), asked)
        return watch.cause(NOW)

    assert run(*[0.3125] * 9) is None
    assert run(*[0.6875] * 9) is None
    assert run(*[0.25] * 4) is None
    assert run(*[0.25] * 5) == "left track is stalled: 0.25 m/s where 0.50 is expected"
    assert run(*[0.25] * 4, *[0.5] * 4, *[0.25] * 4) is None
    assert run(*[0.25, 0.25, 0.25, 0.25, 0.5] * 5) is not None  # four readings in five


def test_a_belt_that_should_stand_runs_away_in_either_direction() -> None:
    for speed_m_s in (0.5, -0.5):
        watch = BeltMonitor(limits(mismatch_s=0.25))
        watch.hear(belts(0.0, 0.0, 0.0), known(limits(), speed_m_s=0.0))
        for k in range(1, 9):
            watch.hear(belts(k / 16, speed_m_s, 0.0), known(limits(), speed_m_s=0.0))
        assert (watch.cause(NOW) or "").startswith("left track runs away")


def slipping(config: GuardConfig, *steps: tuple[float, float, float], turn_rad: float = 0.0) -> SlipMonitor:
    """Feed maps an eighth of a second apart: each step is the belts' travel, what of it the nosings do not show, how often."""
    watch = SlipMonitor(config)
    t_s, travel, slid = 1.0, 0.0, 0.0
    places = [1.0, 1.5, 2.0, 2.5]
    watch.look(t_s, places, travel, 0.0)
    for driven, lost, times in steps:
        for _ in range(int(times)):
            t_s, travel, slid = t_s + 0.125, travel + driven, slid + lost
            there = [1.0 + (place + slid - travel) % 2.0 for place in places]
            watch.look(t_s, sorted(there), travel, turn_rad * (t_s - 1.0))
    return watch


@pytest.mark.parametrize(("came", "slips"), [(1.0, False), (1.5, False), (2.0, False), (0.5, True), (2.5, True)])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_chair_that_travels_between_its_belts_does_not_slip(came: float, slips: bool, way: float) -> None:
    """Test: belts of 0.1 and 0.2 m/s, forward and backward, in the dead zone of steering; the nosings show a multiple of the slower
    belt's travel. Expected result: a cause outside the two belts alone."""
    watch = SlipMonitor(limits())
    for k in range(20):
        travel = 0.0125 * k * way
        watch.look(0.125 * k, [1.0 - came * travel, 1.5 - came * travel], travel, 0.0, travel)
    assert (watch.cause(NOW) is not None) == slips


def test_a_chair_that_catches_up_with_its_belts_is_not_held_and_one_that_does_not_is() -> None:
    """Test: slip of 1.5 falls by half each three eighths of a second down to 0.38; it falls to 0.5 and stays there. Expected
    result: no cause, though it lasts 1.4 s; a cause half a second after the last fall."""
    falls = ((0.0625, 0.09375, 4), (0.0625, 0.046875, 3), (0.0625, 0.0234375, 3), (0.0625, 0.01, 2))
    assert slipping(limits(), *falls[:2]).slip > 0.3
    assert slipping(limits(), *falls).cause(NOW) is None
    # The window has half forgotten the worst after three maps; it is 0.75 then, and 0.5 is no fall by 40 % from there.
    assert slipping(limits(), *falls[:1], (0.0625, 0.03125, 6)).cause(NOW) is None
    assert slipping(limits(), *falls[:1], (0.0625, 0.03125, 7)).cause(NOW) is not None


def test_belts_that_are_slowed_down_do_not_hide_that_a_chair_catches_up() -> None:
    """Test: all of 1/16 m an eighth of a second is lost, then, belts at half the speed, all of 1/32 m but 1/128; the same with
    belts that keep their speed, the chair its loss. Expected result: the first has another half second, the second has not."""
    slowed, not_slowed = (0.03125, 0.0234375), (0.0625, 0.0546875)
    assert slipping(limits(), (0.0625, 0.0625, 5), (*slowed, 6)).cause(NOW) is None
    assert slipping(limits(), (0.0625, 0.0625, 5), (*slowed, 7)).cause(NOW) is not None
    assert slipping(limits(), (0.0625, 0.0625, 5), (*not_slowed, 3)).cause(NOW) is not None


def test_slip_at_its_limit_is_none_nor_is_it_below_the_noise() -> None:
    """Test: exactly a quarter lost; much lost of a very short way; little lost. Expected result: no slip."""
    assert slipping(limits(normal_slip=0.25), (0.0625, 0.015625, 12)).slip == 0.0
    assert slipping(limits(normal_slip=0.25), (0.0625, 0.0166, 12)).slip > 0.25
    assert slipping(limits(normal_slip=0.25), (0.0074, 0.0064, 12)).slip == 0.0
    assert slipping(limits(normal_slip=0.25), (0.0076, 0.0064, 12)).slip > 0.8
    assert slipping(limits(normal_slip=0.25), (0.0078125, 0.0037, 12)).slip == 0.0
    assert slipping(limits(normal_slip=0.25), (0.0078125, 0.0039, 12)).slip > 0.4


def test_slip_that_ends_is_forgotten_and_begins_anew() -> None:
    """Test: slip for 5 maps, none for 4, slip for 5. Expected result: no cause; none while it turns or has a heading error."""
    config = limits(normal_slip=0.25, slip_turn_rad=0.0625, square_rad=0.125)
    lost, none = (0.0625, 0.03125), (0.0625, 0.0)
    assert slipping(config, (*lost, 5), (*none, 4), (*lost, 5)).cause(NOW) is None
    assert slipping(config, (*lost, 5), (*none, 4), (*lost, 12)).cause(NOW) is not None
    assert slipping(config, (*lost, 8), turn_rad=0.125).cause(NOW) is not None
    assert slipping(config, (*lost, 12), turn_rad=0.140625).slip == 0.0
    assert slipping(config, (*lost, 12), turn_rad=-0.140625).slip == 0.0
    assert slipping(replace(config, square_rad=0.0625), (*lost, 8), turn_rad=0.125).cause(NOW) is None


@pytest.mark.parametrize(("lost_m", "slips"), [(0.0058, False), (0.0070, False), (0.0140, True), (0.0625, True)])
def test_a_chair_that_slides_is_held_although_it_turns_and_one_that_skids_is_not(lost_m: float, slips: bool) -> None:
    """Test: belts of 0.65 m gauge at 1/16 m/s, a turn of 0.08 rad/s, which skids by 6.5 mm an eighth of a second at most; what the
    nosings do not show. Expected result: a cause beyond it. Three wet steps let a chair slide a metre, turning by half a degree."""
    assert (slipping(limits(), (0.0078125, lost_m, 8), turn_rad=0.08).cause(NOW) is not None) == slips


@pytest.mark.parametrize("lost", ["late", "empty", "others"])
def test_nosings_out_of_view_do_not_make_good_for_what_was_rolled_back(lost: str) -> None:
    """Test: the chair slides back by 0.1875 m; while the belts drive 0.125 m its nosings go out of view and come back where they
    were, or others do; it slides on by 0.0625 m, and by as much again. Expected result: a cause with the last of it, for 0.31 m in
    all; none if another way begins meanwhile."""
    t_s = 2.0 if lost == "late" else 1.625
    there = np.array([1.1875, 1.6875, 2.1875, 2.6875]) - (0.275 if lost == "others" else 0.0)
    for anew in ("", "begin", "restart"):
        watch = slipping(limits(normal_slip=9.0), (0.0, 0.0625, 3))
        if lost == "empty":
            watch.look(1.5, [], 0.125, 0.0)
        if anew:
            watch.begin() if anew == "begin" else watch.restart(NOW)
        watch.look(t_s, list(there), 0.125, 0.0)
        watch.look(t_s + 0.125, list(there + 0.0625), 0.125, 0.0)
        assert watch.cause(NOW) is None
        watch.look(t_s + 0.25, list(there + 0.125), 0.125, 0.0)
        assert watch.cause(NOW) == (None if anew else "rolled back 0.31 m")


def test_what_slides_back_unseen_counts_as_far_as_nosings_are_matched() -> None:
    """Test: belts that stand; after a second without nosings these are 0.1 m further off, three times. Expected result: a cause for
    0.3 m; none for a chair that climbs unseen, nor for one that stands while its nosings come and go by 5 mm of noise."""
    slid, climbs, stands = SlipMonitor(limits()), SlipMonitor(limits()), SlipMonitor(limits())
    for k in range(4):
        slid.look(float(k), [1.0 + 0.1 * k, 1.5 + 0.1 * k], 0.0, 0.0)
        climbs.look(float(k), [1.0, 1.5], 0.2 * k, 0.0)
    for k in range(200):
        stands.look(float(k), [1.0 + 0.005 * (k % 2)], 0.0, 0.0)
    assert slid.cause(NOW) == "rolled back 0.30 m"
    assert climbs.cause(NOW) is None
    assert stands.cause(NOW) is None


def test_a_place_counts_by_the_share_of_the_frames_that_show_it() -> None:
    """Test: places in one of two, three and four frames, one that moves, two at once. Expected result: there with a gain of three
    from a share of a third; what is out of view is kept, and what a nearer place hides; forgotten once it is passed."""
    for every, is_there in ((1, True), (2, True), (3, True), (40, False)):
        watch = Sightings(3, 4, 12)
        for k in range(121):
            watch.look(2.0 if k % every == 0 else None, 0.0, 3.0)
        assert (watch.nearest_m() is not None) == is_there, every
    watch = Sightings(3, 4, 12)
    for k in range(9):
        watch.look(2.0 - 0.125 * k, 0.0, 3.0)
    assert watch.nearest_m() == 1.0
    for _ in range(20):
        watch.look(None, 1.25, 3.0)  # too near to be in view
    assert watch.nearest_m() == 1.0
    watch.look(0.5, 0.0, 0.5)
    watch.look(0.5, 0.0, 0.5)
    assert watch.nearest_m() == 0.5
    watch.forget(0.75)
    assert watch.nearest_m() == 1.0
    for _ in range(12):
        watch.look(None, 0.0, 3.0)
    assert watch.nearest_m() is None
    assert watch.is_empty


LENGTHS = limits(
    front_m=1.0, rear_m=0.5, obstacle_clear_m=0.25, gap_clear_m=0.125, stopping_s=0.5, track_span_m=1.0, track_on_stair_m=1.0
)  # fmt: skip


def test_a_gap_lies_behind_the_last_good_nosing() -> None:
    """Test: spacings just within and beyond the span, two nosings, three, the gap before or behind the short step, on a slope.
    Expected result: the nosing before the wider spacing, and the span."""
    assert gap_between([], 1.0) is None
    assert gap_between([(place, 0.0) for place in (1.0,)], 1.0) is None
    assert gap_between([(place, 0.0) for place in (1.0, 2.0)], 1.0) is None
    assert gap_between([(place, 0.0) for place in (1.0, 2.125)], 1.0) == (1.0, 1.125)
    assert gap_between([(place, 0.0) for place in (1.0, 1.5, 2.0)], 1.0) is None
    assert gap_between([(place, 0.0) for place in (1.0, 1.5, 2.125)], 1.0) == (1.5, 1.125)
    assert gap_between([(place, 0.0) for place in (1.0, 1.75, 2.125)], 1.0) == (1.0, 1.125)
    assert gap_between([(place, 0.0) for place in (1.0, 1.75, 2.5)], 1.0) == (1.0, 1.5)
    assert gap_between([(place, 0.0) for place in (0.5, 1.0, 1.5, 2.25)], 1.0) == (1.5, 1.25)
    assert gap_between([(1.0, 0.0), (1.75, 1.0)], 1.0) == (1.0, 1.25)


@pytest.mark.parametrize(("rise_m", "run_m"), [(0.16, 0.30), (0.19, 0.44), (0.15, 0.50), (0.17, 0.52)])
def test_a_flight_that_check_admits_has_no_gap_until_a_step_of_it_is_missing(rise_m: float, run_m: float) -> None:
    """Test: flights whose two steps are shorter than the track of 1.4 m, uneven by 12 mm, whole and without the third step."""
    off_m = (0.0, 0.012, -0.012, 0.0, 0.012)
    nosings = [(1.0 + k * run_m + off, 0.0, k * rise_m) for k, off in enumerate(off_m)]
    for places, slows in ((nosings, False), (nosings[:2] + nosings[3:], True)):
        watch = ahead(limits(), places=places, rise_m=rise_m, run_m=run_m)
        assert (watch.restriction(NOW) is not None) == slows


def test_a_gap_counts_from_its_fifth_map_and_fades() -> None:
    """Test: maps with a gap and without, with one elsewhere, and with nothing there. Expected result: known after five more
    for than against; what is out of view is kept."""
    gap, whole = [1.0, 1.5, 2.25], [1.0, 1.5, 2.0]
    watch = AheadMonitor(LENGTHS)

    def looks(places: list[tuple[float, float]], maps: int = 1) -> bool:
        for _ in range(maps):
            watch.hear(stair(0.0, places), NOW)
        return watch.restriction(NOW) is not None

    assert not looks(gap, 4)
    assert looks(gap)
    assert looks([])
    assert looks([1.6875, 2.0, 2.25])
    assert not looks(whole)
    assert looks(gap, 15)
    assert looks(whole, 5)  # counted up to ten
    assert not looks([1.625, 2.0, 2.5])  # nosings that go on from where the gap should begin, give or take
    # Past it once the track lies beyond: 1.5 m from where it began, less than the chair's end is ahead.
    watch = ahead(LENGTHS, places=gap)
    assert [watch.restriction(known(LENGTHS, travel_m=travel_m)) is None for travel_m in (1.375, 1.5)] == [False, True]


def ahead(config: GuardConfig, **changes: Any) -> AheadMonitor:
    """Return the monitor after five maps of one thing ahead, at no travel."""
    places = changes.pop("places", [])
    watch = AheadMonitor(config)
    for _ in range(5):
        watch.hear(stair(0.0, places, **changes), NOW)
    return watch


@pytest.mark.parametrize(("last_m", "stops"), [(1.0, True), (1.1, False), (1.5, False)])
def test_a_step_before_the_flights_last_nosing_is_no_obstacle_on_the_landing(last_m: float, stops: bool) -> None:
    """Test: frames from a flight show something 1.2 m away, the last nosing of the map before it and beyond it. Expected result:
    held before the former alone; a tread of open risers held a chair on its flight."""
    watch = ahead(LENGTHS, places=[0.8, last_m])
    for _ in range(2):
        watch.hear(frame(0.0, obstacle_m=1.2), NOW)
    assert (watch.cause(known(LENGTHS, speed_m_s=0.25)) is not None) == stops


@pytest.mark.parametrize(("then", "obstacle_m", "stops"), [((1.3, 1.8), 1.0, False), ((2.0, 2.5), 1.3, True)])
def test_a_nosing_that_left_the_view_is_a_step_of_its_flight_and_of_no_other(
    then: tuple[float, float], obstacle_m: float, stops: bool
) -> None:
    """Test: nosings 0.8 to 1.4 m away, then a map that overlaps them, or one of another flight; frames show something before the
    new map. Expected result: a step of the former, an obstacle before the latter."""
    watch = ahead(LENGTHS, places=[0.8, 1.4])
    watch.hear(stair(0.0, list(then)), NOW)
    for _ in range(2):
        watch.hear(frame(0.0, obstacle_m=obstacle_m), NOW)
    assert (watch.cause(known(LENGTHS, speed_m_s=0.25)) is not None) == stops


def test_a_gap_counts_from_where_nosings_are_seen_well() -> None:
    """Test: gaps that begin 1.9 m from mid-track and further. Expected result: slow for the nearer one alone."""
    assert ahead(LENGTHS, places=[1.4, 1.9, 2.65]).restriction(NOW) is not None
    assert ahead(LENGTHS, places=[1.45, 1.95, 2.7]).restriction(NOW) is None


def tilted(pitch: float, roll: float) -> tuple[float, float, float, float]:
    """Return the quaternion of a roll after a pitch, front up."""
    c, s, cr, sr = math.cos(-pitch / 2), math.sin(-pitch / 2), math.cos(roll / 2), math.sin(roll / 2)
    return c * cr, c * sr, s * cr, -s * sr


SEAT_LIMITS = limits(seat_rad=0.25, seat_s=1.0)
EIGHTHS = [k / 8 for k in range(8)]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("config", "errors", "cause"),
    [
        (SEAT_LIMITS, [(k / 8, 0.25) for k in range(20)], None),  # on the limit
        (SEAT_LIMITS, [(t_s, 0.5) for t_s in EIGHTHS], None),
        (SEAT_LIMITS, [(t_s, 0.5) for t_s in (*EIGHTHS, 1.0)], "28.6° off level for 1.0 s"),
        # It grows by 2°, and by more: at once.
        (SEAT_LIMITS, [(0.0, 0.5), (0.125, 0.5 + 2.0 * DEG)], None),
        (SEAT_LIMITS, [(0.0, 0.5), (0.125, 0.5 + 2.0 * DEG), (0.25, 0.54)], "30.9° off level for 0.2 s"),
        # It shrinks by more than 2°: the time begins again; by less, or by the limit itself: it goes on.
        (SEAT_LIMITS, [*[(t_s, 0.5) for t_s in EIGHTHS], (1.0, 0.4375), (1.9375, 0.4375)], None),
        (SEAT_LIMITS, [*[(t_s, 0.5) for t_s in EIGHTHS], (1.0, 0.4375), (2.0, 0.4075)], "23.3° off level for 1.0 s"),
        (replace(SEAT_LIMITS, level_rad=0.0625), [(0.0, 0.5), (0.5, 0.4375), (1.0, 0.4375)], "25.1° off level for 1.0 s"),
    ],
)
def test_a_seats_error_counts_from_when_it_stopped_shrinking(
    config: GuardConfig, errors: list[tuple[float, float]], cause: str | None, sign: float
) -> None:
    watch = SeatMonitor(config)
    for t_s, error_rad in errors:
        watch.hear(SeatReading(t_s=t_s, pitch_rad=sign * error_rad, stroke_m=0.05), NOW)
    assert watch.cause(NOW) == (None if cause is None else f"seat is {'-' * (sign < 0.0)}{cause}")
    watch.restart(NOW)
    assert watch.cause(NOW) is None


def moved(t_s: float, orientation: tuple[float, ...], pitch_rate_rad_s: float) -> ImuSample:
    return replace(imu(t_s), orientation=orientation, angular_velocity_rad_s=(0.0, -pitch_rate_rad_s, 0.0))


def plan(phase: Any, *, needs_stair: bool = False) -> MotionPlan:
    return MotionPlan(t_s=0.0, phase=phase, speed_m_s=0.1, needs_stair=needs_stair)


def side(*ends: Sequence[float]) -> FreeGround:
    """Return the ground of a frame with one side in view."""
    return FreeGround(t_s=0.0, view="front", blind_m=0.5, seen_m=2.0, sides_B=tuple((x, y, 0.0) for x, y in ends))


def test_the_outline_of_a_turn_keeps_from_every_side_in_view() -> None:
    """Test: 300 sides at random, each as 2,001 points, and turns by up to 60° about a centre 0.2 m ahead of mid-track. Expected
    result: a cause where a point is within 5 cm of the chair, but for sides within 2 mm of that."""
    rng = np.random.default_rng(63)
    config = limits(turn_outline_m=(0.6, 0.5, 0.4), turn_centre_m=0.2)
    causes = 0
    for ends, turn_rad in zip(rng.uniform(-1.2, 1.2, (300, 2, 2)), rng.uniform(-1.0, 1.0, 300), strict=True):
        watch, now = SweptOutline(config), known(config, plan=plan("turn"))
        watch.hear(imu(0.0), now)
        watch.hear(side(*ends), now)
        for k in range(1, 11):
            watch.hear(replace(imu(0.1 * k), angular_velocity_rad_s=(0.0, 0.0, turn_rad)), now)
        points = ends[0] + np.linspace(0.0, 1.0, 2001)[:, None] * (ends[1] - ends[0]) - (0.2, 0.0)
        x, y = (points @ rotation_z(turn_rad)[:2, :2]).T
        inside_m = np.minimum(np.minimum(x + 0.85, 0.35 - x), 0.45 - np.abs(y)).max()  # from the centre
        if abs(inside_m) > 0.002:
            assert (watch.cause(now) is not None) == (inside_m > 0.0)
        causes += inside_m > 0.0
    assert 100 < causes < 200


@pytest.mark.parametrize(
    ("turned_deg", "off_m", "is_same"), [(8.0, 0.07, True), (12.0, 0.07, False), (0.0, 0.09, True), (0.0, 0.11, False)]
)
def test_the_newest_sighting_of_a_side_counts(turned_deg: float, off_m: float, is_same: bool) -> None:
    """Test: a wall 1 cm too near, then one further off and turned. Expected result: one wall within 10° and 10 cm, its newer place
    counts; beyond, the former wall still stands there."""
    config = limits(turn_outline_m=(0.5, 0.5, 0.4))
    watch, now = SweptOutline(config), known(config, plan=plan("turn"))
    watch.hear(imu(0.0), now)
    watch.hear(side((0.54, -0.5), (0.54, 0.5)), now)
    assert watch.cause(now) is not None
    along_m = 0.2 * math.tan(turned_deg * DEG)
    watch.hear(side((0.54 + off_m - along_m, -0.2), (0.54 + off_m + along_m, 0.2)), now)
    assert (watch.cause(now) is None) == is_same


@pytest.mark.parametrize(("view", "lead_m"), [("front", 1.0), ("rear", 0.5)])
def test_an_obstacle_is_held_for_nearer_than_its_distance_wherever_the_chair_was_when_it_was_seen(view: Any, lead_m: float) -> None:
    """Test: something 2 m from mid-track, and the chair drives towards it. Expected result: at 0.25 m/s a chair keeps 0.25 m and
    stops within 0.125 m; it goes on 1 cm earlier, and has no obstacle in the other direction."""
    way, config = {"front": 1.0, "rear": -1.0}[view], replace(LENGTHS, view=view)
    watch = AheadMonitor(config)
    for _ in range(2):
        watch.hear(frame(0.0, obstacle_m=2.0), NOW)
    for left_m, stops in ((0.385, False), (0.365, True)):
        now = known(config, speed_m_s=0.25 * way, travel_m=way * (2.0 - lead_m - left_m))
        assert (watch.cause(now) is not None) == stops
    assert watch.cause(now) == "obstacle 0.36 m ahead"
    assert watch.cause(replace(now, passed=known(config, speed_m_s=-0.25 * way).passed)) is None


@pytest.mark.parametrize(("shown", "stops"), [([1, 0, 0, 1], True), ([1, 0, 0, 0, 1], False)])
def test_an_obstacle_in_every_third_frame_is_there_from_its_second(shown: list[int], stops: bool) -> None:
    watch = AheadMonitor(LENGTHS)
    for is_shown in shown:
        watch.hear(frame(0.0, **({"obstacle_m": 1.3} if is_shown else {})), NOW)
    assert (watch.cause(known(LENGTHS, speed_m_s=0.25)) is not None) == stops


@pytest.mark.parametrize(("travel_m", "is_kept"), [(0.1, False), (0.2, True)])
def test_an_obstacle_below_the_view_is_kept(travel_m: float, is_kept: bool) -> None:
    """Test: something 1.35 m from mid-track in four frames, and twelve that show nothing, from 1.25 and 1.15 m. Expected result:
    what the camera should show, from 1.2 m on, fades; what it cannot is kept."""
    watch = AheadMonitor(LENGTHS)
    for _ in range(4):
        watch.hear(frame(0.0, obstacle_m=1.35), NOW)
    for _ in range(12):
        watch.hear(frame(0.0), known(LENGTHS, travel_m=travel_m))
    assert (watch.cause(known(LENGTHS, speed_m_s=0.25, travel_m=travel_m)) is not None) == is_kept


@pytest.mark.parametrize("view", ["front", "rear"])
@pytest.mark.parametrize(("further_m", "stops"), [(0.0, False), (-0.1, False), (0.3, True), (None, True)])
def test_in_a_turn_a_side_in_view_is_no_obstacle_and_what_stands_before_it_is(
    view: Any, further_m: float | None, stops: bool
) -> None:
    """Test: something 0.3 m from the chair, before the turn and in it, and a slanting wall there, behind it, or none in view."""
    way, place_m = {"front": (1.0, 1.3), "rear": (-1.0, 0.8)}[view]
    config = replace(LENGTHS, view=view, turn_outline_m=(0.5, 0.5, 0.4))
    watch, in_turn = AheadMonitor(config), known(config, plan=plan("turn"), speed_m_s=0.25 * way)
    ends = () if further_m is None else ((place_m + further_m, -0.5, 0.0), (place_m + further_m + 0.4, 1.5, 0.0))
    aside = ((0.2, 1.0, 0.0), (0.9, 1.0, 0.0))
    wall = tuple((way * x, y, z) for x, y, z in (*ends, *aside))
    for now in (NOW, NOW, in_turn, in_turn):
        watch.hear(FreeGround(t_s=0.0, view=view, blind_m=0.5, seen_m=1.0, sides_B=wall), now)
        watch.hear(stair(0.0, [], obstacle_m=place_m), now)  # of a flight, which is not ahead in a turn
        watch.hear(frame(0.0, obstacle_m=place_m), now)
    assert (watch.cause(in_turn) is not None) == stops


def test_a_side_of_one_landing_is_forgotten_on_the_next() -> None:
    """Test: a wall 0.3 m ahead in a turn, then a flight, then a turn without a side in view."""
    config, level = limits(turn_outline_m=(0.5, 0.5, 0.4)), tilted(0.0, 0.0)
    watch, in_turn, on_flight = SweptOutline(config), known(config, plan=plan("turn")), known(config, plan=plan("climb"))
    watch.hear(moved(0.0, level, 0.0), in_turn)
    watch.hear(FreeGround(t_s=0.0, view="front", blind_m=0.5, seen_m=2.0, sides_B=((0.3, -1.0, 0.0), (0.3, 1.0, 0.0))), in_turn)
    assert watch.cause(in_turn) == "an edge or a wall comes within 0.05 m of the chair that turns"
    assert watch.cause(on_flight) is None
    for t_s, now in ((0.1, on_flight), (0.2, in_turn)):
        watch.hear(moved(t_s, level, 0.0), now)
    assert watch.cause(in_turn) is None


def turning(apart_m_s: float, phase: Any, ticks: int, watch: GyroOnlyTurn | None = None) -> GyroOnlyTurn:
    """Let the belts run apart for so many sixteenths of a second."""
    if watch is None:
        watch = GyroOnlyTurn(limits(blind_turn_rad=0.5, blind_turn_s=4.0, gyro_drift_rad_s=1.0, silence_s=0.0625))
        watch.hear(belts(7.0, 0.0, 0.0), NOW)
    for _ in range(ticks):
        ran(watch, 1 / 16, apart_m_s, plan(phase))
    return watch


def ran(watch: GyroOnlyTurn, after_s: float, apart_m_s: float, followed: MotionPlan | None) -> None:
    """Let a belt reading come some time after the last one."""
    watch.hear(belts(watch._t_s + after_s, 0.0, apart_m_s), known(limits(), plan=followed))


def test_what_the_belts_did_while_nobody_reported_is_no_turn() -> None:
    """Test: a reading, and a fast one after a second of silence, on the flight. Expected result: no cause; it begins anew."""
    watch = turning(0.0, "climb", 1)
    ran(watch, 1.0, 1.0 / FLIGHT_RAD_M, plan("climb"))
    assert watch.cause(NOW) is None
    assert turning(0.25 / FLIGHT_RAD_M, "climb", 32, watch).cause(NOW) is None
    assert turning(0.25 / FLIGHT_RAD_M, "climb", 1, watch).cause(NOW) is not None


def test_a_slow_turn_leaves_the_window() -> None:
    """Test: 0.125 rad/s, of which four seconds count. Expected result: never a cause; by a hundredth faster, one."""
    assert turning(0.1249 / FLIGHT_RAD_M, "climb", 200).cause(NOW) is None
    assert turning(0.126 / FLIGHT_RAD_M, "climb", 200).cause(NOW) is not None


def test_a_sight_or_another_phase_begins_anew_and_a_turn_is_judged_where_no_stair_should_be_seen() -> None:
    """Test: 0.25 rad/s for 1.5 s, a stair seen 0.5 s ago, 1.5 s; the same with a search between; then where a stair should be seen.
    Expected result: no cause; the reading after which none should be seen any more brings one."""
    apart = 0.25 / FLIGHT_RAD_M
    watch = turning(apart, "climb", 24)
    watch.hear(heading(watch._t_s - 0.5), NOW)  # the last eight readings are later
    assert turning(apart, "climb", 25, watch).cause(NOW) is None
    turning(apart, "search", 1, watch)
    assert turning(apart, "climb", 24, watch).cause(NOW) is None
    for _ in range(40):
        ran(watch, 1 / 16, apart, plan("climb", needs_stair=True))
    assert watch.cause(NOW) is None
    assert turning(apart, "climb", 1, watch).cause(NOW) is not None
    watch = turning(apart, "climb", 24)
    watch.hear(heading(watch._t_s - 0.5), NOW)
    assert turning(apart, "climb", 26, watch).cause(NOW) is not None
    none = GyroOnlyTurn(limits())
    ran(none, 0.0, 1.0, None)
    ran(none, 100.0, 1.0, None)
    assert none.cause(NOW) is None


@pytest.mark.parametrize(
    ("pitch_rad", "per_metre"),
    [
        (0.0, LEVEL_RAD_M),
        (0.034, LEVEL_RAD_M),
        (-0.034, LEVEL_RAD_M),
        (0.036, OVER_RAD_M),
        (-0.036, OVER_RAD_M),
        (2.0, OVER_RAD_M),
    ],
)
def test_how_far_belts_turn_a_chair_is_another_matter_on_the_level_and_over_a_nosing(pitch_rad: float, per_metre: float) -> None:
    """Test: 0.3 rad/s over the crest, on either side of 2° of pitch. Expected result: a cause within two seconds, as far as the
    belts turn the chair there."""
    watch = GyroOnlyTurn(limits(blind_turn_rad=0.5, blind_turn_s=4.0, gyro_drift_rad_s=1.0))
    watch.hear(moved(0.0, tilted(pitch_rad, 0.0) if pitch_rad < 1.0 else (1.0, 0.0, -1.1, 0.0), 0.0), NOW)
    turning(0.3 / per_metre, "crest", 27, watch)
    assert watch.cause(NOW) is None
    turning(0.3 / per_metre, "crest", 1, watch)
    assert watch.cause(NOW) is not None


def test_yaw_and_roll_are_no_pitch_and_a_first_sample_is_no_swing() -> None:
    """Test: a chair that lies level, yawed by 120° and rolled by 0.1 rad; its first sample a shock. Expected result: judged as on
    the level from the first reading on."""
    c, s, cr, sr = math.cos(math.pi / 3), math.sin(math.pi / 3), math.cos(0.05), math.sin(0.05)
    watch = GyroOnlyTurn(limits(blind_turn_rad=0.5, blind_turn_s=4.0, gyro_drift_rad_s=1.0))
    watch.hear(moved(0.0, (c * cr, c * sr, s * sr, s * cr), 1.0), NOW)
    assert turning(0.3 / LEVEL_RAD_M, "crest", 28, watch).cause(NOW) is not None


def test_a_chair_that_swings_is_not_judged() -> None:
    """Test: pitch rates of 0.07 and 0.09 rad/s, either way, for as long as their mean needs. Expected: 4.5 °/s lies between."""
    for rate, judged in ((0.07, True), (-0.07, True), (0.09, False), (-0.09, False)):
        watch = GyroOnlyTurn(limits(blind_turn_rad=0.5, blind_turn_s=4.0, gyro_drift_rad_s=1.0))
        watch.hear(moved(0.0, tilted(0.3, 0.0), rate), NOW)
        assert turning(0.3 / OVER_RAD_M, "leave", 2, watch).cause(NOW) is None
        for k in range(1, 100):
            watch.hear(moved(k / 64, tilted(0.3, 0.0), rate), NOW)
        turning(0.3 / OVER_RAD_M, "leave", 30, watch)
        assert (watch.cause(NOW) is not None) is judged
    # The mean takes 0.2 s: a shock of one sample is no swing.
    watch = GyroOnlyTurn(limits(blind_turn_rad=0.5, blind_turn_s=4.0, gyro_drift_rad_s=1.0))
    watch.hear(moved(1.0, tilted(0.3, 0.0), 0.0), NOW)
    watch.hear(moved(1.0 + 1 / 64, tilted(0.3, 0.0), 1.0), NOW)  # 0.075 rad/s in the mean
    assert turning(0.3 / OVER_RAD_M, "leave", 29, watch).cause(NOW) is not None
    watch.restart(NOW)
    watch.hear(moved(1.0 + 2 / 64, tilted(0.3, 0.0), 0.2), NOW)  # 0.084 rad/s
    assert turning(0.3 / OVER_RAD_M, "leave", 29, watch).cause(NOW) is None
