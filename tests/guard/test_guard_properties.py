"""What holds of the guard whatever comes: random readings, plans and commands, NaN and Inf among them."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from world import limits

from treadline.core.signals import (
    FlipperCommand,
    FrameQuality,
    HeadingEstimate,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    OperatorInput,
    SeatCommand,
    SeatReading,
    TrackCommand,
    TrackReading,
)
from treadline.guard import Guard

# Literals, so that a changed value in the code is noticed here.
RAMP_S = 0.3

ANY = st.one_of(st.floats(-2.0, 2.0), st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e300, 0.0]))
TIMES = st.one_of(st.floats(-0.05, 0.05), st.sampled_from([math.nan, math.inf, 5.0, -5.0]))
KINDS = st.sampled_from(["imu", "belts", "seat", "frame", "heading", "operator", "plan", "command", "flipper", "tick"])
STEPS = st.lists(st.tuples(KINDS, TIMES, ANY, ANY), max_size=60)
PHASES: Any = ["climb", "crest", "edge", "arrived", "align"]


def act(guard: Guard, kind: str, t_s: float, a: float, b: float) -> TrackCommand | None:
    """Let one thing happen; return a command if it is a tick."""
    match kind:
        case "imu":
            vector = np.array([a, b, 0.0])
            orientation = np.array([1.0, a, b, 0.0])
            sample = ImuSample(t_s=t_s, orientation=orientation, angular_velocity_rad_s=vector, linear_acceleration_m_s2=vector)
            guard.admit(sample)
        case "belts":
            guard.admit(TrackReading(t_s=t_s, left_m_s=a, right_m_s=b, brake_on=False))
        case "seat":
            guard.admit(SeatReading(t_s=t_s, pitch_rad=a, stroke_m=b))
            assert math.isfinite(guard.pass_seat(SeatCommand(t_s=t_s, rate_m_s=a)).rate_m_s)
        case "frame":
            guard.admit(FrameQuality(t_s=t_s, fingerprint=hash(a), brightness=a, contrast=b, valid_share=a))
        case "heading":
            guard.admit(HeadingMeasurement(t_s=t_s, heading_rad=a, sigma_rad=b, edge_count=3))
        case "operator":
            guard.admit(OperatorInput(t_s=t_s, stop=a > 1.5))
        case "plan":
            phase = PHASES[0 if not math.isfinite(a) else round(10.0 * min(abs(a), 2.0)) % 5]
            guard.on_message(MotionPlan(t_s=t_s, phase=phase, speed_m_s=b))
        case "flipper":
            passed = guard.pass_flipper(FlipperCommand(t_s=t_s, rate_rad_s=a))
            assert passed is not None
            assert math.isfinite(passed.rate_rad_s)
            assert math.isfinite(passed.t_s)
        case "command":
            guard.propose(TrackCommand(t_s=t_s, left_m_s=a, right_m_s=b))
        case _:
            estimate = HeadingEstimate(t_s=t_s, heading_rad=a, heading_rate_rad_s=b, sigma_rad=0.1, source="vision")
            return guard.step(t_s, estimate if a != 0.0 else None).tracks
    return None


@pytest.mark.parametrize("needs_heading", [True, False])
def test_whatever_comes_what_leaves_is_a_number_within_its_limits_and_a_hold_stays(needs_heading: bool) -> None:
    """Test: any sequence of readings, plans, commands and ticks, with any numbers and stamps. Expected result: every command is
    finite, no belt above its limit; once held, a ramp of at most 0.3 s, then zero and
    brake for ever, for nobody has re-armed; every event has a finite time."""

    @settings(max_examples=150, deadline=None, database=None, derandomize=True)
    @given(STEPS)
    def holds(steps: list[tuple[str, float, float, float]]) -> None:
        guard = Guard(limits(needs_heading=needs_heading))
        guard.propose(TrackCommand(t_s=0.0, left_m_s=0.2, right_m_s=0.2))
        held_s, braked = math.inf, False
        for k, (kind, offset_s, a, b) in enumerate(steps):
            held = guard.holding
            passed = act(guard, kind, 0.01 * k + offset_s, a, b)
            assert held is None or guard.holding == held
            if passed is None:
                continue
            assert math.isfinite(passed.t_s)
            assert max(abs(passed.left_m_s), abs(passed.right_m_s)) <= 1.0 + 1e-12
            if guard.holding is not None:
                held_s = min(held_s, passed.t_s)
                braked = braked or passed.brake
                assert passed.brake or held_s <= passed.t_s < held_s + RAMP_S
                if braked:
                    assert (passed.left_m_s, passed.right_m_s, passed.brake) == (0.0, 0.0, True)
        assert all(math.isfinite(event.t_s) for event in guard.take_events())

    holds()
