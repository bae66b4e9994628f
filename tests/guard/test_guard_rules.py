"""Each rule of the guard: a fault in a sound drive is held for in its stated time, by this rule alone, and again after a re-arm.

Amounts and times are literals of the table of hazards (docs/explanation/safety.md): the first amount is just within the limit and
holds nobody, the second just beyond.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import pytest
from drive import Drive, spoils
from world import TICK_S, imu, limits

from treadline.core.angles import DEG
from treadline.guard._rules import RULES

FRONT_M, PULLEY_M = 0.995, 0.475
"""Reach of the shipped chair from mid-track, and place of its pulleys."""
OUTLINE_M = (0.545, 0.77, 0.375)
"""Outline of the shipped chair with its flipper folded: rear, front and half width."""
BEGAN_TICKS = 201
"""Ticks of sound drive before a fault: the last frame, of 2.00 s, has just come."""


@dataclass(kw_only=True)
class Case:
    """One fault: ``do(drive, amount, since_s)`` is called before each tick from its beginning on."""

    rule: str
    do: Callable[[Drive, Any, float], None]
    within: Any = None
    beyond: Any
    hold_s: float
    give_s: float = 0.0
    """How much the hold may be off its time, beyond two ticks."""
    brakes: bool = False
    """Whether it brakes at once; else along a half-cosine."""
    cause: str
    slows: str = ""
    """Beginning of the speed restriction before the hold; empty without one."""
    begin: Callable[[Drive], None] = lambda _: None
    """What else the drive is."""
    limits: dict[str, Any]
    stays: bool = False
    """Whether the fault lies ahead of the chair and stays there."""


def case(rule: str, do: Any, within: Any, beyond: Any, hold_s: float, cause: str, **more: Any) -> Case:
    return Case(rule=rule, do=do, within=within, beyond=beyond, hold_s=hold_s, cause=cause, **{"limits": {}} | more)


def silence(*sources: str) -> Any:
    """Return a fault in which sources say nothing for a time."""

    def do(drive: Drive, lasts_s: float, since_s: float) -> None:
        drive.silent = (drive.silent | set(sources)) if since_s < lasts_s - 1e-9 else drive.silent - set(sources)

    return do


def value(source: str, name: str, scale: float = 1.0) -> Any:
    """Return a fault in which a number has a value."""

    def do(drive: Drive, amount: float, _since_s: float) -> None:
        drive.spoil = spoils(source, **{name: amount * scale})

    return do


def attitude(*, pitch: float = 0.0, roll: float = 0.0, rate: float = 0.0) -> Any:
    """Return a fault of the attitude, in multiples of an amount in degrees."""

    def do(drive: Drive, amount_deg: float, _since_s: float) -> None:
        rad = amount_deg * DEG
        rates_rad_s = (0.0, -rate * rad, 0.0)
        drive.spoil = lambda source, said: (
            said if source != "imu" else imu(said.t_s, pitch * rad, roll_rad=roll * rad, rates_rad_s=rates_rad_s)
        )

    return do


def late_tick(drive: Drive, late_s: float, since_s: float) -> None:
    if since_s == 0.0:
        drive.tick += round(late_s / TICK_S)


def clock_stands(drive: Drive, ticks: int, _since_s: float) -> None:
    if drive.steps < BEGAN_TICKS + ticks:
        drive.tick -= 1


def tick_from_before(drive: Drive, back_s: float, _since_s: float) -> None:
    drive.guard.step(drive.t_s - TICK_S - back_s, None)


def sent(kind: str) -> Any:
    """Return a fault in which the heading filter reports one since a moment."""

    def do(drive: Drive, lasts_s: float, since_s: float) -> None:
        fault = kind if since_s < lasts_s else None
        drive.spoil = spoils("health", fault=fault, since_s=2.0)

    return do


def beats(drive: Drive) -> None:
    """Let a process send heartbeats, and, once, one that nobody awaits."""
    if drive.tick == 1:
        drive.guard.beat("viewer", drive.t_s)
    if "process" not in drive.silent:
        drive.guard.beat("control", drive.t_s)


def rolls_back(drive: Drive, back_m: float, _since_s: float) -> None:
    drive.heading_deg = 10.0  # slip is not judged while the chair turns back to square
    drive.slip = 1.5 if drive.furthest_m - drive.passed_m < back_m else 1.0


def slips(drive: Drive, ratio: float, _since_s: float) -> None:
    drive.slip = ratio


def apart(drive: Drive, apart_m_s: float, _since_s: float) -> None:
    drive.asked = (0.1, 0.1 + apart_m_s)


def at_heading(drive: Drive, heading_deg: float, _since_s: float) -> None:
    drive.heading_deg = heading_deg


def wall(drive: Drive, every: int, since_s: float) -> None:
    """Show a wall 2 m ahead in one of so many maps."""
    if since_s == 0.0:
        drive.wall_at_m = drive.travel_m + 2.0
    drive.spoil = lambda source, said: (
        replace(said, obstacle_m=None) if source in ("map", "camera") and drive.tick // 10 % every else said
    )


def gap(drive: Drive, wider_m: float, since_s: float) -> None:
    """Lay a wider step 2.5 m ahead."""
    if since_s == 0.0:
        drive.gap_m, drive.gap_at_m = wider_m, drive.passed_m + 2.5


def drop(drive: Drive, ahead_m: float, since_s: float) -> None:
    if since_s == 0.0:
        drive.ends_at_m = drive.travel_m + ahead_m


def side(drive: Drive, aside_m: float, _since_s: float) -> None:
    """Show an edge or a wall along the chair."""
    drive.spoil = spoils("ground", sides_B=((-1.0, aside_m, 0.0), (1.0, aside_m, 0.0)))


def turning(drive: Drive) -> None:
    on_landing(drive)
    drive.phase, drive.plan = "turn", {"speed_m_s": 0.1}


def between_sides(drive: Drive) -> None:
    turning(drive)
    side(drive, 1.0, 0.0)


def on_landing(drive: Drive) -> None:
    drive.phase, drive.needs_stair, drive.pitch_rad = "land", False, 0.0
    drive.silent |= {"heading"}


def over_crest(drive: Drive) -> None:
    drive.phase, drive.plan = "crest", {"speed_m_s": 0.1}


def without_stair(drive: Drive) -> None:
    drive.needs_stair = False
    drive.silent |= {"heading", "map"}


def on_bench(drive: Drive) -> None:
    drive.silent |= {"camera", "heading", "map"}


def recorded(drive: Drive, lasts_s: float, since_s: float) -> None:
    """Replay belts of 0.3 m/s without frames."""
    drive.silent = {"camera"} if since_s < lasts_s else set()
    drive.spoil = spoils("belts", left_m_s=0.3, right_m_s=0.3)


EVER = math.inf
SLOW_CAMERA, SLOW_IMU = "no frame for 0.3", "no IMU sample for 0.06 s"
CASES = [
    case("Pace", silence("driver"), 0.73, EVER, 0.75, "no command for 0.76 s", brakes=True, slows="no command or tick for 0.38 s"),
    case("Pace", late_tick, 0.74, 0.76, 0.0, "no tick for 0.77 s", brakes=True, slows="no frame"),
    case("Pace", clock_stands, 29, 10_000, 0.31, "mission clock stands still at 2.00 s", brakes=True),
    case("Pace", tick_from_before, None, 1.02, 0.0, "mission clock leapt by -1.02 s", brakes=True, slows="no frame"),
    case("PlantFault", value("plant", "fault", 1), None, "two guards", 0.0, "the plant braked by itself: two guards", brakes=True),
    case("LinkSilence", silence("operator"), 0.28, EVER, 0.3, "operator link silent for 0.3", brakes=True),
    case(
        "ProcessSilence",
        silence("process"),
        0.73,
        EVER,
        0.75,
        "process control silent for 0.7",
        brakes=True,
        begin=beats,
        limits={"processes": ("control",)},
    ),
    case("PlanSilence", silence("plan"), 0.28, EVER, 0.3, "plan silent for 0.3"),
    case(
        "BatteryMonitor", value("plant", "battery_v"), 22.0, 21.9, 1.0, "the battery is at 21.9 V", limits={"battery_least_v": 22.0}
    ),
    case("TiltMonitor", attitude(pitch=1.0), 39.9, 40.1, 0.05, "pitch 40°", brakes=True),
    case("TiltMonitor", attitude(pitch=-1.0), 14.9, 15.1, 0.05, "pitch -15°", brakes=True),
    case("TiltMonitor", attitude(roll=1.0), 19.9, 20.1, 0.05, "roll 20°", brakes=True),
    case("TiltMonitor", attitude(roll=-1.0), 19.9, 20.1, 0.05, "roll -20°", brakes=True),
    case("TiltMonitor", attitude(rate=1.0), 24.9, 25.1, 0.05, "pitch rate 25 °/s, pitch 0°", brakes=True),
    case("TiltMonitor", attitude(rate=-1.0), 24.9, 25.1, 0.05, "pitch rate -25 °/s, pitch 0°", brakes=True),
    case("SeatMonitor", value("seat", "pitch_rad", DEG), 4.9, 5.1, 1.0, "seat is 5.1° off level for 1.0 s"),
    case("SeatMonitor", value("seat", "pitch_rad", -DEG), 4.9, 5.1, 1.0, "seat is -5.1° off level for 1.0 s"),
    *[
        case("DriveSilence", silence(name), 0.28, EVER, 0.3, f"readings of the {name} silent for 0.3", brakes=True, slows=slows)
        for name, slows in (("belts", "slip"), ("seat", ""), ("flipper", ""))
    ],
    case("BeltMonitor", value("belts", "left_m_s"), 0.115, 0.105, 0.2, "left track is stalled: 0.10 m/s where 0.20", brakes=True),
    case("BeltMonitor", value("belts", "right_m_s"), 0.285, 0.295, 0.2, "right track runs away: 0.29 m/s where 0.20", brakes=True),
    case("BeltMonitor", value("belts", "right_m_s"), None, -0.1, 0.2, "right track runs backwards: -0.10 m/s", brakes=True),
    case("BeltMonitor", value("belts", "brake_on"), False, True, 0.2, "the brake is on without a command", brakes=True),
    case("SlipMonitor", slips, 0.25, 0.5, 0.8, "slip 0.5", give_s=0.1, brakes=True, slows="slip 0."),
    case("SlipMonitor", rolls_back, 0.22, 0.28, 2.6, "rolled back 0.2", give_s=0.15, brakes=True),
    case("EstimateSilence", silence("estimate"), 0.28, EVER, 0.3, "heading estimate silent for 0.3"),
    case("BothSenses", silence("imu", "camera"), 0.28, EVER, 0.3, "no IMU sample for 0.3", brakes=True, slows=SLOW_IMU),
    case("Senses", silence("camera"), 2.88, EVER, 3.0, "no frame for 3.0 s", slows=SLOW_CAMERA),
    case(
        "Senses",
        recorded,
        1.5,
        EVER,
        1.67,
        "no frame for 1.7 s, 0.50 m driven since",
        slows="no frame",
        limits={"watches_motion": False},
    ),
    case(
        "Senses", value("camera", "fingerprint"), None, 7, 3.1, "no frame for 3.0 s: the last is frozen", give_s=0.1, slows="no fr"
    ),
    case(
        "Senses", value("camera", "valid_share"), 0.16, 0.14, 3.0, "no frame for 3.0 s: the last has 14% of its depth", slows="no"
    ),
    case("Senses", silence("imu"), 0.98, EVER, 1.0, "no IMU sample for 1.01 s", slows=SLOW_IMU),
    case("Senses", silence("imu"), 0.04, EVER, 0.05, "no IMU sample for 0.06 s", slows=SLOW_IMU, begin=over_crest),
    case("Senses", sent("stuck"), 0.9, EVER, 1.0, "gyro stuck for 1.01 s", slows="gyro stuck for 0.01 s"),
    case(
        "Senses", sent("stuck"), 0.9, EVER, 1.0, "gyro stuck for 1.01 s", slows="gyro", begin=on_bench, limits={"has_camera": False}
    ),
    case("Senses", silence("heading", "map"), 11.9, EVER, 12.0, "no stair in view for 12.0 s"),
    case("FilterHealth", sent("disagreement"), 0.48, EVER, 0.5, "camera and gyro disagree for more than 0.5 s"),
    case("HealthSilence", silence("health"), 0.28, EVER, 0.3, "health of the heading silent for 0.3"),
    case("MapMonitor", silence("map"), 2.88, EVER, 3.15, "headings without a stair map for 3.", give_s=0.1),
    case("GyroOnlyTurn", apart, 0.005, 0.05, 2.05, "the belts turned the chair by +3.0° in", give_s=0.1, begin=without_stair),
    case("TurnedOver", at_heading, 4.9, 5.1, 0.0, "heading +5.1° in crest", begin=over_crest),
    case("TurnedOver", at_heading, -4.9, -5.1, 0.0, "heading -5.1° in crest", begin=over_crest),
    case("AheadMonitor", wall, 40, 3, 2.9, "obstacle 0.4", give_s=0.35, brakes=True, stays=True),
    case(
        "AheadMonitor", gap, 0.25, 0.3, 9.0, "0.98 m from nosing", give_s=2.5, brakes=True, stays=True, slows="0.98 m from nosing"
    ),
    case("DropMonitor", drop, 99.0, 2.2, 6.6, "the ground ends 0.4", give_s=0.2, brakes=True, stays=True, begin=on_landing),
    case(
        "SweptOutline",
        side,
        0.44,
        0.40,
        0.1,
        "an edge or a wall comes within 0.05 m",
        brakes=True,
        stays=True,
        begin=turning,
        limits={"turn_outline_m": OUTLINE_M},
    ),
    case(
        "SweptOutline",
        silence("ground"),
        2.9,
        EVER,
        3.0,
        "neither ground nor a side of the landing in view for 3.0",
        brakes=True,
        give_s=0.12,
        begin=between_sides,
        limits={"turn_outline_m": OUTLINE_M},
    ),
    case("DropMonitor", silence("ground"), 5.0, EVER, 6.7, "the ground 0.0", give_s=0.5, brakes=True, begin=on_landing),
]


def drive_with(case: Case, amount: Any, seconds: float) -> tuple[Drive, int | None]:
    """Drive soundly, then with the fault; return the number of its ticks to the hold."""
    drive = Drive(**case.limits)
    case.begin(drive)
    drive.run(BEGAN_TICKS * TICK_S, case.begin)
    assert drive.guard.holding is None, drive.guard.holding
    assert drive.events() == []
    ticks = count()

    def each(drive: Drive) -> None:
        case.begin(drive)
        case.do(drive, amount, next(ticks) * TICK_S)

    return drive, drive.ticks_until_held(round(seconds / TICK_S), each)


def ids(case: Case) -> str:
    return f"{case.rule}: {case.cause}"


def test_every_rule_has_a_case() -> None:
    assert {case.rule for case in CASES} == {rule.__name__ for rule in RULES}


def test_a_rule_applies_where_its_limits_are_set_and_is_watched_where_blocks_send_what_it_needs() -> None:
    config = limits(
        has_planner=True, battery_least_v=22.0, turn_outline_m=OUTLINE_M, awaits_ground=True, awaits_map=True, awaits_health=True
    )
    for rule in RULES:
        assert rule.is_watched(config), rule
        for name in rule.needs:
            assert not rule.applies(replace(config, **{name: None if name == "battery_least_v" else False})), rule
        unsent = replace(config, **{rule.declared: False}) if rule.declared else config
        assert (rule.applies(unsent), rule.is_watched(unsent)) == (True, not rule.declared), rule


@pytest.mark.parametrize("case", CASES, ids=ids)
def test_a_fault_is_held_for_in_its_time_and_again_after_a_re_arm(case: Case) -> None:
    """Expected: the hold comes at its time, braked or along a ramp, with cause and speed restriction in words; once the fault is
    gone a person re-arms, and the chair drives on; what lies ahead holds it again."""
    drive, ticks = drive_with(case, case.beyond, case.hold_s + case.give_s + 0.05)
    assert ticks is not None
    assert abs(ticks * TICK_S - case.hold_s) <= case.give_s + 2.5 * TICK_S
    assert (drive.guard.holding or "").startswith(case.cause)
    assert drive.passed.brake == case.brakes or drive.mean_m_s == 0.0
    events = drive.events()
    assert ("slow" in dict(events)) == bool(case.slows)
    assert dict(events).get("slow", "").startswith(case.slows)
    drive.heal()
    case.begin(drive)
    drive.run(0.6, case.begin)
    assert drive.passed.brake
    drive.press(rearm=True)
    drive.run(0.5, case.begin)
    assert (drive.guard.holding is not None) == case.stays, drive.guard.holding
    assert (drive.mean_m_s > 0.0) != case.stays


@pytest.mark.parametrize("case", [case for case in CASES if case.within is not None], ids=ids)
def test_what_is_within_its_limit_holds_nobody(case: Case) -> None:
    drive, ticks = drive_with(case, case.within, 2.0 * case.hold_s + 3.0)
    assert ticks is None, drive.guard.holding


@pytest.mark.parametrize("case", CASES, ids=ids)
def test_no_other_rule_holds_for_a_fault_in_its_time(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """Test: the guard without the rule. Expected: no hold for this cause; no two rules do the same."""
    rule = next(rule for rule in RULES if rule.__name__ == case.rule)
    monkeypatch.setattr(rule, "cause", lambda *_: None)
    drive, ticks = drive_with(case, case.beyond, case.hold_s + case.give_s + 0.05)
    assert ticks is None or not (drive.guard.holding or "").startswith(case.cause)
