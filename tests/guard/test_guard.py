"""What leaves the guard: limits of the belts, of seat and flipper; holds, re-arms and sources of commands (rows 10, 12 and 21)."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from drive import Drive, spoils
from world import TICK_S, belts, estimate, heading, limits, stair

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.signals import (
    FreeGround,
    HeadingMeasurement,
    MotionPlan,
    OperatorInput,
    StairMap,
    TrackCommand,
    VelocityCommand,
)
from treadline.guard import Guard

SEEN: dict[str, Callable[[Drive], Any]] = {
    "held": lambda drive: drive.guard.holding,
    "mean_m_s": lambda drive: drive.mean_m_s,
    "brake": lambda drive: drive.passed.brake,
    "seat_m_s": lambda drive: drive.seat.rate_m_s,
    "flipper": lambda drive: None if drive.flipper is None else drive.flipper.rate_rad_s,
    "source": lambda drive: drive.guard.source,
    "events": lambda drive: drive.events(),
    "names": lambda drive: [name for name, _ in drive.events()],
}
"""What a step of a table may expect; events are those since they were last asked for."""


def play(drive: Drive, *steps: tuple[dict[str, Any], float, dict[str, Any]]) -> Drive:
    """Play steps: what changes of the drive, or is pressed; for how long [s]; what is expected then."""
    for changes, seconds, expected in steps:
        for name, value in changes.items():
            drive.press(**value) if name == "press" else setattr(drive, name, value)
        drive.run(seconds)
        for name, value in expected.items():
            assert SEEN[name](drive) == (pytest.approx(value, abs=1e-4) if isinstance(value, float) else value), name
    return drive


def silent(*sources: str) -> dict[str, Any]:
    return {"silent": {*sources}}


def poor(valid_share: float) -> dict[str, Any]:
    """Return the end of a flight in the dark, with so much depth."""
    spoil = spoils("camera", valid_share=valid_share, brightness=0.0, contrast=0.0)
    return {"phase": "crest", "needs_stair": False, "spoil": spoil}


def back(phase: str, speed_m_s: float) -> dict[str, Any]:
    return {"asked": (speed_m_s, speed_m_s), "phase": phase, "plan": {"speed_m_s": speed_m_s}}


def health(fault: Any, since_s: float | None, cause: str | None = None) -> dict[str, Any]:
    return {"spoil": spoils("health", fault=fault, since_s=since_s, cause=cause)}


SOUND: dict[str, Any] = {"spoil": lambda _, said: said}
QUIET: dict[str, Any] = {"held": None, "events": []}
DIM, CLEAR = ("vision_dim", "colours of mean 0.01, contrast 0.100"), ("vision_clear", "colours of mean 0.40, contrast 0.100")
DRIFTS, STOPPED, LET_GO = "gyro drifts by 1.0 °/s", "operator stop", "the dead-man switch is released"
DRIVES: dict[str, tuple[dict[str, Any], list[tuple[dict[str, Any], float, dict[str, Any]]]]] = {
    "one that begins late on its clock, without a camera": (
        {},
        [({"tick": 100_000}, 1.0, QUIET), (silent("camera"), 2.9, {"held": None}), ({}, 0.1, {"held": "no frame for 3.0 s"})],
    ),
    "a silent estimate": ({}, [({}, 1.0, {}), (silent("estimate"), 0.4, {"held": "heading estimate silent for 0.30 s"})]),
    "an estimate without what it is made from": (
        {},
        [({}, 1.0, {}), (silent("imu", "estimate"), 0.4, {"held": "heading estimate silent for 0.30 s: no IMU sample for 0.30 s"})],
    ),
    "darkness, and light": ({}, [({"spoil": spoils("camera", brightness=0.01)}, 0.3, {}), (SOUND, 0.3, {"events": [DIM, CLEAR]})]),
    "over a crest with 3 % of depth": ({"blind_timeout_s": 1.0}, [(poor(0.03), 2.0, {"held": None})]),
    "over a crest with 1 % of depth": ({"blind_timeout_s": 1.0}, [(poor(0.01), 2.0, {"brake": True})]),
    "a gyro whose drift is mended, and which drifts again": (
        {},
        [
            (health("drift", 1.0, DRIFTS), 2.0, {}),
            (health(None, None), 0.5, {}),
            (health("jump", 3.5), 0.5, {"held": None, "events": [("re-referenced", DRIFTS), ("re-referenced", "jump")]}),
        ],
    ),
    "a plan that needs no stair": (
        {"lost_timeout_s": 2.0},
        [({"phase": "land", "needs_stair": False} | silent("heading", "map"), 4.0, {"held": None})],
    ),
    "every clock leaps back by 5 s": (
        {},
        [
            ({}, 6.0, {}),
            ({"tick": 100}, 0.6, {"held": "clock of OperatorInput leapt 4.99 s back"}),
            ({"press": {"rearm": True}}, 1.0, {"held": None, "mean_m_s": 0.2}),
        ],
    ),
    "a tick that is 0.60 s late": (
        {"needs_heading": False},
        [({}, 1.0, {}), ({"tick": 159}, 0.01, {"mean_m_s": 0.08}), ({}, 0.01, {"mean_m_s": 0.2, "held": None})],
    ),
    "a guard that stood for 0.5 s blames no source, until the next tick": (
        {"needs_heading": False},
        [
            ({}, 1.0, {}),
            ({"tick": 150} | silent("plan", "operator", "belts", "seat", "flipper", "imu"), 0.01, {"held": None}),
            ({}, 0.02, {"held": "operator link silent for 0.31 s"}),
        ],
    ),
    "a recording, whose belts do not obey": (
        {"watches_motion": False},
        [({"spoil": spoils("belts", left_m_s=-0.5)}, 1.0, {"held": None})],
    ),
    "slip before a heading is known": ({}, [(silent("heading", "estimate") | {"slip": 0.5}, 3.0, QUIET)]),
    "slip over the crest": ({}, [({"phase": "crest", "slip": 0.5}, 3.0, QUIET)]),
    "a way driven back on purpose": (
        {"awaits_map": False},
        [
            ({}, 1.5, {"names": ["map_unwatched"]}),
            (back("back_off", -0.2) | silent("map"), 2.5, QUIET),
            (back("climb", 0.2) | silent(), 2.0, QUIET),
        ],
    ),
    "a stop": (
        {},
        [
            ({}, 1.0, {}),
            ({"press": {"stop": True}}, 0.01, {"mean_m_s": 0.0, "brake": False, "held": STOPPED}),
            ({}, 2.0, {"brake": True, "held": STOPPED}),
            ({"press": {"rearm": True}}, 1.0, {"mean_m_s": 0.2}),
            ({}, 0.0, {"events": [("hold", STOPPED), ("rearmed", f"by a person, after: {STOPPED}")]}),
        ],
    ),
    "a dead-man switch that is released": (
        {},
        [({}, 1.0, {}), ({"press": {"dead_man": False}}, 0.01, {"mean_m_s": 0.0, "held": LET_GO}), ({}, 2.0, {"brake": True})],
    ),
    "a second re-arm within a second": (
        {},
        [
            ({"press": {"stop": True}}, 0.6, {}),
            ({"press": {"rearm": True}}, 0.1, {"held": None}),
            ({"press": {"stop": True}}, 0.6, {"names": ["hold", "rearmed", "hold"]}),
            ({"press": {"rearm": True}}, 0.1, {"held": STOPPED, "events": [("rearm_refused", "the last re-arm was 0.7 s ago")]}),
        ],
    ),
    "a re-arm of a chair that is not held changes nothing": (
        {},
        [
            ({}, 2.01, {}),
            (silent("camera"), 1.0, {}),
            ({"press": {"rearm": True}}, 1.95, {"names": ["slow"]}),
            ({}, 0.1, {"names": ["hold"]}),
        ],
    ),
    "a seat that is held for is left alone, a sound one goes on under a hold": (
        {},
        [
            ({"seat_m_s": 0.02}, 0.5, {}),
            ({"press": {"stop": True}}, 0.1, {"seat_m_s": 0.02}),
            ({"spoil": spoils("seat", pitch_rad=6.0 * DEG)}, 1.1, {"seat_m_s": 0.0}),
        ],
    ),
    "a leveller that dies": (
        {},
        [({"seat_m_s": 0.02}, 0.1, {}), ({"seat_m_s": None}, 0.1, {"seat_m_s": 0.02}), ({}, 0.02, {"seat_m_s": 0.0})],
    ),
    "a flipper, without a plan, and under a hold": (
        {},
        [
            ({}, 0.1, {"flipper": 0.1}),
            (silent("plan"), 0.12, {"flipper": None}),
            (silent() | {"press": {"stop": True}}, 0.01, {"flipper": 0.0}),
        ],
    ),
}
"""Limits of a drive, and its steps."""


@pytest.mark.parametrize("name", DRIVES)
def test_a_drive_goes_as_expected(name: str) -> None:
    changes, steps = DRIVES[name]
    play(Drive(**changes), *steps)


@pytest.mark.parametrize(
    ("phase", "plan", "heading_deg", "asked", "passed", "brake"),
    [
        ("climb", (0.2,), 0.0, (0.25, 0.29), (0.25, 0.29), False),  # their sum and difference are rounded
        # Of mean and difference the mean yields: to 0.30 m/s square, to 0.55 m/s turning, and to what the difference leaves.
        ("climb", (0.2,), 4.9, (0.6, 0.8), (0.2, 0.4), False),
        ("climb", (0.2,), -5.1, (0.6, 0.8), (0.45, 0.65), False),
        ("climb", (0.2,), 30.0, (1.2, 0.6), (0.85, 0.25), False),
        ("climb", (0.2,), 30.0, (-0.2, 1.6), (-0.8, 1.0), False),
        ("climb", (0.2,), 30.0, (-3.0, 4.0), (-1.0, 1.0), False),
        ("climb", (0.2,), 30.0, (-0.9, -0.9), (-0.55, -0.55), False),
        # What the plan says with a margin; 0.10 m/s where the chair pitches; on the flight and in turns the limits above.
        *[
            (phase, (speed_m_s,), heading_deg, (0.6, 0.6), (mean_m_s, mean_m_s), False)
            for phase, speed_m_s, heading_deg, mean_m_s in (
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
            )
        ],
        # A plan that ends or stands stops the belts, braked at an end; a plan of turning, or of speed, lets a turn pass.
        ("arrived", (0.1, None), 0.0, (-0.1, 0.1), (0.0, 0.0), True),
        ("refused", (0.1, None), 0.0, (-0.1, 0.1), (0.0, 0.0), True),
        ("crest", (0.0, 0.0), 0.0, (-0.1, 0.1), (0.0, 0.0), False),
        ("align", (0.0, 0.1), 0.0, (-0.1, 0.1), (-0.1, 0.1), False),
        ("climb", (0.1, 0.0), 0.0, (-0.1, 0.1), (-0.1, 0.1), False),
        ("align", (0.0, None), 0.0, (-0.1, 0.1), (-0.1, 0.1), False),
    ],
)
def test_belts_run_within_the_limits_of_heading_and_phase(
    phase: Any, plan: tuple[Any, ...], heading_deg: float, asked: tuple[float, float], passed: tuple[float, float], brake: bool
) -> None:
    drive = Drive(watches_slip=False)
    drive.asked, drive.heading_deg, drive.phase = asked, heading_deg, phase
    drive.plan = dict(zip(("speed_m_s", "turn_m_s"), plan, strict=False))
    command = drive.run(0.3).passed
    assert (command.left_m_s, command.right_m_s) == pytest.approx(passed)
    assert (command.brake, drive.guard.holding) == (brake, None)


# Rows 2 to 4


@pytest.mark.parametrize("kind", ["heading", "map"])
def test_what_repeats_itself_under_a_moving_chair_is_frozen(kind: str) -> None:
    """Test: a camera that measures by itself says the same again and again. Expected result: refused once the belts have run
    50 mm, not before; what is new is admitted again."""
    drive = Drive(needs_heading=False)
    drive.silent = {"camera", "heading", "map"}
    measured = heading(0.0, 1.0) if kind == "heading" else stair(0.0, [1.0, 1.34])
    admitted = []

    def look(drive: Drive) -> None:
        if drive.tick % 10 == 0:
            drive.guard.advance(drive.t_s)
            admitted.append((drive.travel_m, drive.guard.admit(replace(measured, t_s=drive.t_s))))

    drive.run(1.0, look)
    assert all(good == (travel <= 0.05) for travel, good in admitted)
    assert [admitted[0][1], admitted[-1][1]] == [True, False]
    assert drive.guard.admit(heading(1.0, 2.0) if kind == "heading" else stair(1.0, [0.9, 1.24]))


def test_pixels_pass_and_their_quality_speaks_for_them() -> None:
    """Test: a frame's pixels without its quality. Expected result: admitted once, but no frame for the guard."""
    drive = Drive()
    camera = PinholeCamera(width_px=2, height_px=2, fx_px=1.0, fy_px=1.0, cx_px=0.5, cy_px=0.5)
    pixels = RgbdFrame(t_s=0.0, rgb=np.zeros((2, 2, 3), np.uint8), depth_m=np.ones((2, 2), np.float32), camera=camera)
    drive.silent = {"camera"}
    drive.guard.advance(0.0)
    assert [drive.guard.admit(pixels) for _ in range(2)] == [True, False]
    assert drive.run(0.5).events()[0][0] == "slow"


class Reads(Drive):
    """A camera that measures headings or maps by itself."""

    def send(self, source: str, message: Any) -> None:
        self.guard.admit(message) if isinstance(message, HeadingMeasurement | StairMap) else super().send(source, message)


@pytest.mark.parametrize(
    ("source", "other", "lie", "reason"),
    [
        ("heading", "map", {"heading_rad": 99.0}, "has a heading of 5672.28°"),
        ("map", "heading", {"run_m": 99.0}, "holds a distance that no camera measures"),
    ],
)
def test_a_camera_that_measures_headings_or_maps_stands_for_frames(source: str, other: str, lie: Any, reason: str) -> None:
    """Test: headings alone, or maps, as readings; then such as no camera measures. Expected result: frames count as seen, slow
    after 0.3 s, with the reason."""
    drive = Reads(awaits_map=source == "map", watches_slip=False)
    drive.silent = {"camera", other}
    assert [name for name, _ in drive.run(4.0).events() if name != "map_unwatched"] == []
    drive.spoil = spoils(source, **lie)
    assert ("slow", f"no frame for 0.30 s: the last {reason}") in drive.run(0.5).events()


# Rows 10, 14 and 22


def test_a_clock_that_is_no_number_holds_and_moves_no_stamp() -> None:
    """Test: a tick at NaN. Expected result: stamps are compared with the last clock that was a number."""
    drive = Drive().run(1.0)
    assert drive.guard.step(math.nan, None).tracks.t_s == 0.99
    assert drive.guard.holding == "mission clock is not finite"
    drive.guard.advance(math.nan)
    assert not drive.guard.admit(belts(1.2, 0.1, 0.1))
    assert drive.guard.admit(belts(1.08, 0.1, 0.1))


def test_a_fault_that_readings_do_not_show_brakes_at_once() -> None:
    drive = Drive().run(1.0)
    drive.guard.hold("two guards")
    play(drive, ({}, 0.01, {"held": "two guards", "brake": True}))


def test_what_no_camera_and_no_planner_says_is_rejected_and_reported_once() -> None:
    """Test: unknown words of direction and phase, half a side, a map of 3,000 nosings ten times. Expected: one event each, the
    tenth second later with the number of those between."""
    guard = Guard(limits())
    guard.step(2.0, None)
    guard.take_events()
    guard.on_message(MotionPlan(t_s=2.0, phase="sideways", speed_m_s=0.1))  # type: ignore[arg-type]
    guard.on_message(stair(2.0, [1.0], direction="sideways"))
    guard.on_message(FreeGround(t_s=2.0, view="front", blind_m=0.5, seen_m=2.0, sides_B=((1.0, 0.0, 0.0),)))
    for t_s in (*[2.001 + 0.001 * k for k in range(9)], 12.0):
        guard.advance(t_s)
        assert not guard.on_message(stair(t_s, [0.1 * n for n in range(3000)]))
    assert [event.cause for event in guard.take_events()] == [
        "MotionPlan has an unknown phase 'sideways'",
        "StairMap leads 'sideways', neither up nor down",
        "FreeGround holds 1 ends of sides",
        "StairMap holds 3000 nosings; 9 more since",
    ]


@pytest.mark.parametrize(("t_s", "stands"), [(0.8, False), (0.99, False), (0.995, True)])
def test_of_two_plans_the_later_counts_and_of_two_at_once_the_first(t_s: float, stands: bool) -> None:
    drive = Drive().run(1.0)
    drive.silent = {"plan"}
    drive.guard.on_message(MotionPlan(t_s=t_s, phase="crest", speed_m_s=0.0, turn_m_s=0.0))
    assert (drive.step().left_m_s == 0.0) is stands


def test_an_estimate_of_the_past_is_not_used() -> None:
    drive = Drive().run(1.0)
    drive.guard.step(drive.t_s, estimate(0.5, 30.0 * DEG))
    drive.asked = (0.6, 0.6)
    assert drive.run(0.02).mean_m_s == pytest.approx(0.30)  # square: 0.55 m/s at 30°


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


def test_a_seat_that_has_not_reported_yet_is_taken_for_level() -> None:
    drive = Drive()
    drive.silent, drive.seat_m_s = {"seat"}, 0.06
    assert drive.run(0.02).seat.rate_m_s == 0.02


@pytest.mark.parametrize(
    ("name", "without"),
    [("seat", {"seat_rate_m_s": None}), ("flipper", {"flipper_rate_rad_s": None})]
    + [(name, {"watches_motion": False}) for name in ("belts", "seat", "flipper")],
)
def test_what_a_chair_does_not_have_is_not_waited_for_nor_what_no_command_moves(name: str, without: dict[str, Any]) -> None:
    """Test: belts, seat or flipper report nothing, in a chair that has none, or in a recording. Expected result: no HOLD, and no
    rate for what is not there."""
    seat_m_s, flipper_rad_s = 0.01 * ("seat_rate_m_s" not in without), 0.1 * ("flipper_rate_rad_s" not in without)
    play(Drive(**without), (silent(name) | {"seat_m_s": 0.01}, 2.0, {"held": None, "seat_m_s": seat_m_s, "flipper": flipper_rad_s}))


# Row 21


def test_a_re_armed_chair_stands_until_somebody_drives_by_a_command_of_later() -> None:
    drive = play(Drive(), ({}, 1.0, {}), (silent("driver"), 1.6, {}), ({"press": {"rearm": True}}, 0.0, {}))
    drive.guard.propose(TrackCommand(t_s=drive.t_s - 0.05, left_m_s=0.2, right_m_s=0.2))
    play(drive, ({}, 0.5, {"held": None, "mean_m_s": 0.0}), (silent(), 0.5, {"mean_m_s": 0.2}))


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


class Joystick(Drive):
    """A chair on the floor without a traversal, whose driver still asks for 0.2 m/s, and velocities ``late_s`` under way."""

    def __init__(self) -> None:
        self.speed_m_s, self.turn_rad_s, self.late_s, self.every = 0.0, 0.0, 0.005, 10
        super().__init__(awaits_map=False, watches_slip=False)
        self.phase, self.needs_stair, self.pitch_rad = "arrived", False, 0.0
        self.run(0.2).events()
        self.speed_m_s = 0.1

    def step(self) -> TrackCommand:
        if self.speed_m_s > 0.0 and self.tick % self.every == 0:
            stamped_s = self.t_s - self.late_s
            self.guard.propose(VelocityCommand(t_s=stamped_s, speed_m_s=self.speed_m_s, turn_rad_s=self.turn_rad_s))
        return super().step()


def test_velocities_drive_while_no_traversal_is_under_way() -> None:
    """Test: velocities, a traversal, and its end. Expected result: each source in its time; after a change belts at rest until a
    new command comes; no hold. The last velocity is at 3.3 s: the belts ramp down from 3.7 s on and stand, braked, at 4.05 s; a
    planner that falls silent meanwhile is held for."""
    drive = Joystick()
    for phase, source, speed_m_s in (("arrived", "velocity", 0.1), ("land", "driver", 0.2), ("arrived", "velocity", 0.1)):
        play(drive, ({"phase": phase}, 0.01, {"source": source, "mean_m_s": 0.0}), ({}, 1.0, {"mean_m_s": speed_m_s, "held": None}))
    play(drive, ({}, 0.0, {"names": ["source"] * 3}), ({}, 0.08, {}), ({"speed_m_s": 0.0}, 0.3, {"mean_m_s": 0.1}))
    assert 0.0 < drive.run(0.3).mean_m_s < 0.06
    play(drive, ({}, 0.16, {"source": "driver", "brake": True, "mean_m_s": 0.0}), ({}, 1.0, {"held": None}))
    play(drive, (silent("plan") | {"speed_m_s": 0.1}, 0.35, {"held": "plan silent for 0.31 s"}))


@pytest.mark.parametrize("turn_rad_s", [0.1, -0.1])
def test_a_velocity_turns_the_chair_to_the_left_by_a_faster_right_belt(turn_rad_s: float) -> None:
    """Expected result: speeds that differ by the turn times the distance of the belts, about the mean of 0.1 m/s."""
    drive = Joystick()
    drive.turn_rad_s = turn_rad_s
    belts_m_s = drive.run(1.0).passed
    apart_m_s = turn_rad_s * drive.guard.config.gauge_m
    assert (belts_m_s.left_m_s, belts_m_s.right_m_s) == pytest.approx((0.1 - 0.5 * apart_m_s, 0.1 + 0.5 * apart_m_s))


@pytest.mark.parametrize("late_s", [-0.2, 3.1, math.nan])
def test_a_velocity_of_another_time_drives_nothing(late_s: float) -> None:
    """Test: velocities 0.2 s ahead of the clock, 3.1 s old, of no time. Expected: the chair stands; rejected and reported."""
    drive = play(Joystick(), ({"late_s": late_s, "every": 1}, 4.0, {"source": "driver", "mean_m_s": 0.0, "names": ["rejected"]}))
    assert drive.guard.rejected["VelocityCommand"] > 300
