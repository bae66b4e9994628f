"""What holds of the guard whatever comes: messages of every type, with any numbers and stamps, and re-arms between."""

import math
from dataclasses import replace
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from traffic import HOLD_S, MADE, OF_CAMERA, Traffic, numbers, sound, with_number
from world import TICK_S

from treadline.core.signals import HeadingMeasurement, OperatorInput

ANY = st.one_of(st.floats(-2.0, 2.0), st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e6, 1e6, 0.0]))
LATE_S = st.one_of(st.floats(-0.3, 0.05), st.sampled_from([math.nan, math.inf, 1e6, -1e6, -10.0]))
EVENTS = st.one_of(
    st.tuples(st.just("silence"), st.sampled_from([*MADE]), st.integers(1, 120)),
    st.tuples(st.just("message"), st.sampled_from([*MADE]), LATE_S),
    st.tuples(st.just("number"), st.sampled_from([*MADE]), ANY),
    st.tuples(st.just("re-arm"), st.just(OperatorInput), st.just(0.0)),
)
"""What may happen at a tick: messages of one type cease for some ticks, one comes at another time or with a number replaced."""
SILENCED = [kind for kind in HOLD_S if kind is not HeadingMeasurement]
"""Types whose silence is judged here; a stair may be out of view for longer."""


class Spoilt(Traffic):
    """Sound traffic in which anything may happen."""

    def __init__(self) -> None:
        super().__init__(OperatorInput, sound)
        self.last_s = dict.fromkeys(HOLD_S, 0.0)
        """Time of the last sound message of each type that must speak, or of the last re-arm."""
        self.silent_until = dict.fromkeys(MADE, 0)
        self.rearming = False

    def happen(self, what: str, kind: type, value: Any) -> None:
        """Let one thing happen at this tick, before the sound messages."""
        t_s = self.tick * TICK_S
        self.guard.advance(t_s)
        match what:
            case "silence":
                self.silent_until[kind] = self.tick + value
            case "message":
                self.send(replace(MADE[kind](t_s), t_s=t_s + value))
            case "number":
                for place in list(numbers(MADE[kind](0.0)))[:1]:
                    self.send(with_number(MADE[kind](t_s - 0.005), place, value))
            case _:
                self.rearming = True

    def messages(self) -> None:
        """Send the sound messages of this tick."""
        t_s = self.tick * TICK_S
        self.guard.advance(t_s)
        for kind, made in MADE.items():
            if self.tick < self.silent_until[kind] or (kind in OF_CAMERA and self.tick % 10):
                continue
            message, held = made(t_s), self.guard.holding is not None
            if kind is OperatorInput and self.rearming:
                message, self.rearming = replace(message, rearm=True), False
            self.send(message)
            if kind in HOLD_S:
                self.last_s[kind] = t_s
            if held and self.guard.holding is None:
                self.last_s = dict.fromkeys(HOLD_S, t_s)


@settings(max_examples=120, deadline=None, database=None, derandomize=True)
@given(st.lists(st.tuples(st.integers(1, 40), EVENTS), max_size=25))
def test_whatever_comes_what_leaves_is_bounded_a_hold_stays_and_silence_is_held_for_in_time(steps: list[tuple[int, Any]]) -> None:
    """Test: sound traffic of all types, with random silences, stamps, numbers and re-arms. Expected result: every command is finite
    and within the chair's limits; a held chair is braked 0.3 s later and stays so until a person re-arms; a source that must speak
    and has been silent for its time is held for."""
    traffic, held_s = Spoilt(), math.inf
    for ticks, event in steps:
        traffic.happen(*event)
        for _ in range(ticks):
            t_s = traffic.tick * TICK_S
            traffic.messages()
            tracks, seat, up = traffic.guard.step(t_s, traffic.estimate)
            traffic.tick += 1
            assert max(abs(tracks.left_m_s), abs(tracks.right_m_s)) <= 1.0 + 1e-12
            assert abs(tracks.left_m_s + tracks.right_m_s) <= 2 * 0.55 + 1e-12
            assert abs(seat.rate_m_s) <= 0.06
            assert up is None or abs(up.rate_rad_s) <= math.radians(30.0)
            held_s = min(held_s, t_s) if traffic.guard.holding is not None else math.inf
            assert t_s - held_s < 0.3 or (tracks.left_m_s, tracks.right_m_s, tracks.brake) == (0.0, 0.0, True)
            for kind in SILENCED:
                silent_s = t_s - traffic.last_s[kind]
                assert silent_s <= HOLD_S[kind] + 2 * TICK_S or traffic.guard.holding is not None, kind
    assert all(math.isfinite(event.t_s) for event in traffic.guard.take_events())
