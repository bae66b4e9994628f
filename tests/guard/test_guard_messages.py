"""Every type of message, spoilt in every way: the guard holds within its stated time, or the message has no effect.

The types are those of the signals module, and their fields those of the types: a new signal or field cannot be forgotten.
"""

import math
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Any, Literal

import pytest
from traffic import BEGAN_S, HOLD_S, MADE, OF_CAMERA, OUT, PROPOSED, Spoil, Traffic, numbers, sound, with_number
from world import TICK_S, limits

from treadline.core import signals
from treadline.core.signals import (
    Event,
    FlipperReading,
    HeadingEstimate,
    HeadingHealth,
    HeadingMeasurement,
    MotionPlan,
    OperatorInput,
    SeatReading,
    StairMap,
    TrackReading,
)
from treadline.guard import ReadingAdmission


def stamped(t_s: Callable[[float], float]) -> Spoil:
    """Return the spoil of a stamp."""
    return lambda message: [replace(message, t_s=t_s(message.t_s))]


class Swapped:
    """Delivers each two messages in the wrong order."""

    def __init__(self) -> None:
        self.waiting: Any = None

    def __call__(self, message: Any) -> list[Any]:
        """Return nothing, then two messages."""
        waiting, self.waiting = self.waiting, None if self.waiting is not None else message
        return [] if waiting is None else [message, waiting]


def dropped(_: Any) -> list[Any]:
    return []


SPOILS: dict[str, Callable[[], Spoil]] = {
    "stamp nan": lambda: stamped(lambda _: math.nan),
    "stamp -1e6": lambda: stamped(lambda _: -1e6),
    "stamp +1e6": lambda: stamped(lambda _: 1e6),
    "old": lambda: stamped(lambda t_s: t_s - 10.0),
    "repeated": lambda: stamped(lambda _: BEGAN_S),
    "swapped": Swapped,
    "missing": lambda: dropped,
}
ALL = [(kind, True) for kind in MADE] + [(HeadingMeasurement, False), (StairMap, False)]
"""Each type, and those that a camera without images sends by itself."""
CASES = [(kind, has_images, name, spoil) for kind, has_images in ALL for name, spoil in SPOILS.items()] + [
    (kind, has_images, f"{place} {value}", lambda place=place, value=value: lambda message: [with_number(message, place, value)])
    for kind, has_images in ALL
    for place in numbers(MADE[kind](0.0))
    for value in (math.nan, -1e6, 1e6)
]


@cache
def reference(kind: type, how: Literal["sound", "dropped"], *, has_images: bool = True) -> list[tuple[float | None, ...]]:
    """Return what leaves while the messages of one type are sound, or do not come."""
    return Traffic(kind, sound if how == "sound" else dropped, has_images=has_images).run(BEGAN_S + seconds(kind))


def seconds(kind: type) -> float:
    return HOLD_S.get(kind, 0.6) + 0.2


def test_every_signal_is_among_the_messages() -> None:
    """Test: the types of the signals module. Expected result: those that are sent to the guard are here, and no others."""
    known = {kind for kind in vars(signals).values() if is_dataclass(kind) and isinstance(kind, type)}
    assert {kind for kind in known if "t_s" in {field.name for field in fields(kind)}} == set(MADE) | set(OUT)


def test_all_messages_sound_pass_and_none_is_rejected() -> None:
    traffic = Traffic(Event, sound)
    assert traffic.run(5.0)[-1] == (0.2, 0.2, False, 0.01, 0.1)
    assert traffic.guard.holding is None
    assert not traffic.guard.rejected


@pytest.mark.parametrize(
    ("kind", "has_images", "name", "spoil"),
    CASES,
    ids=[f"{kind.__name__}{' read' * (not images)} {name}" for kind, images, name, _ in CASES],
)
def test_a_spoilt_message_is_held_for_in_time_or_has_no_effect(
    kind: type, has_images: bool, name: str, spoil: Callable[[], Spoil]
) -> None:
    """Test: from 1.0 s on all messages of one type are spoilt in one way. Expected result: HOLD within the stated time of the type
    after its last sound message, or what leaves is as if the messages were sound, or did not come; a request may be limited."""
    traffic = Traffic(kind, spoil(), has_images=has_images)
    left = traffic.run(BEGAN_S + seconds(kind))
    if traffic.guard.holding is not None:
        held_s = next(event.t_s for event in traffic.guard.take_events() if event.name == "hold")
        assert held_s <= BEGAN_S + HOLD_S.get(kind, 0.0) + (0.1 if kind in OF_CAMERA else 0.0) + 1.5 * TICK_S, traffic.guard.holding
    elif left not in [reference(kind, how, has_images=has_images) for how in ("sound", "dropped")]:
        assert kind in PROPOSED, name
        for a, b, _, seat, up in left:
            assert max(abs(a or 0.0), abs(b or 0.0)) <= 1.0
            assert abs((a or 0.0) + (b or 0.0)) <= 2 * 0.30
            assert abs(seat or 0.0) <= 0.02
            assert abs(up or 0.0) <= math.radians(30.0)
    if name == "missing" and kind in HOLD_S:
        assert traffic.guard.holding is not None


REFUSES = (TrackReading, SeatReading, FlipperReading, HeadingEstimate, HeadingHealth, MotionPlan)
"""Types whose silence refuses a re-arm."""


@pytest.mark.parametrize("kind", HOLD_S, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("from_the_start", [False, True])
def test_what_must_speak_is_awaited_from_the_start_and_after_a_re_arm(kind: type, from_the_start: bool) -> None:
    """Test: a source that never speaks, or dies; a person re-arms, and it stays silent. Expected result: HOLD within its time;
    while a source is silent the re-arm is refused with its cause, and what only times out is held for again. A handset is
    awaited once it has spoken; estimate and health once a heading was measured."""
    traffic = Traffic(kind, dropped)
    if from_the_start and kind not in (OperatorInput, HeadingEstimate, HeadingHealth):
        traffic.began_s = -1.0
    for _ in range(1 if kind is OperatorInput else 2):
        traffic.run(BEGAN_S + HOLD_S[kind] + 0.8)
        assert traffic.guard.holding is not None
        t_s = traffic.tick * TICK_S
        traffic.guard.take_events()
        traffic.guard.advance(t_s)
        traffic.guard.admit(OperatorInput(t_s=t_s - 0.004, rearm=True))
        (event,) = traffic.guard.take_events()
        assert (event.name == "rearm_refused", traffic.guard.holding is not None) == (kind in REFUSES, kind in REFUSES), event


@pytest.mark.parametrize("kind", MADE, ids=lambda kind: kind.__name__)
def test_nothing_is_accepted_before_the_first_tick(kind: type) -> None:
    """Test: a message stamped 1e6 s before the guard knows the time, then sound traffic. Expected result: no effect."""
    traffic = Traffic(Event, sound)
    traffic.send(MADE[kind](1e6))
    assert traffic.run(1.8) == reference(Event, "sound")
    assert traffic.guard.holding is None


DEG = math.pi / 180.0
CONTENT: list[tuple[type, str, list[Any], list[Any]]] = [
    (signals.ImuSample, "orientation", [(1.0078125, 0.0, 0.0, 0.0)], [(1.0109375, 0.0, 0.0, 0.0)]),
    (signals.ImuSample, "angular_velocity_rad_s", [(2000.0 * DEG, 0.0, 0.0)], [(0.0, -2001.0 * DEG, 0.0)]),
    (signals.ImuSample, "linear_acceleration_m_s2", [], [(math.inf, 0.0, 0.0)]),
    (signals.TrackReading, "left_m_s", [-1.0], [1.0625]),
    (signals.SeatReading, "pitch_rad", [-math.pi], [3.2]),
    (signals.SeatReading, "stroke_m", [], [math.inf]),
    (signals.FlipperReading, "angle_rad", [], [-3.2]),
    (signals.FlipperReading, "torque_n_m", [], [math.inf]),
    (HeadingMeasurement, "sigma_rad", [0.004], [0.0, math.inf]),
    (HeadingMeasurement, "heading_rad", [], [3.2]),
    (HeadingMeasurement, "correction_rad", [], [3.2]),
    (signals.FrameQuality, "brightness", [0.0, 1.0], [-0.1, 1.1]),
    (signals.FrameQuality, "obstacle_m", [], [math.inf]),
    (signals.HeadingHealth, "since_s", [0.0, None], [math.inf]),
    (StairMap, "rise_m", [65.535], [65.536]),
    (StairMap, "slope_rad", [], [math.inf]),
    (signals.FreeGround, "blind_m", [0.0, 2.0], [-0.5, 2.5]),
    (signals.FreeGround, "end_m", [0.6, 2.0], [0.5, 2.5]),
    (signals.FreeGround, "seen_m", [], [math.inf]),
    (signals.FreeGround, "end_sigma_m", [0.0], [-0.1, math.inf]),
    (signals.FreeGround, "direction_rad", [], [3.2]),
    (signals.FreeGround, "direction_sigma_rad", [], [math.inf]),
    (signals.FreeGround, "drop_m", [0.0, 0.5], [-0.1, math.inf, math.nan]),
    (signals.StairMap, "turn_rad", [-1.6, 1.6], [math.inf, math.nan, 7.0]),
    (signals.MotionPlan, "speed_m_s", [-0.5], [0.5625]),
    (signals.MotionPlan, "heading_rad", [], [3.2]),
    (signals.MotionPlan, "min_inner_speed_ratio", [], [math.inf]),
    (signals.TrackCommand, "right_m_s", [0.5], [-0.5625]),
    (signals.SeatCommand, "rate_m_s", [0.0], [0.0625]),
]
"""Values on the limits of a chair with belts of 0.5 m/s and no seat, and beyond: data sheets, 16-bit millimetres, half a turn."""


@pytest.mark.parametrize(("kind", "field", "within", "beyond"), CONTENT, ids=[f"{row[0].__name__} {row[1]}" for row in CONTENT])
def test_content_is_accepted_on_its_limits_and_not_beyond(kind: type, field: str, within: list[Any], beyond: list[Any]) -> None:
    for value in within + beyond:
        admission = ReadingAdmission(limits(belt_limit_m_s=0.5, seat_rate_m_s=None))
        admission.advance(1.0)
        assert admission.accept(replace(MADE[kind](1.0), **{field: value})) is (value in within)
        assert admission.stamps.rejected == ({} if value in within else {kind.__name__: 1})
