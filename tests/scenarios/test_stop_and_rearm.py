"""A person stops the chair, and lets it go on: in each phase where something is waited for, led, or tested."""

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.run.episode import Traverse, traverse
from treadline.scenario.scenario import Scenario
from treadline.scenario.shipped_files import shipped_controller
from treadline.vehicle.comfort import lasting

HELD_S, TICK_S = 10.0, 0.01
PITCH_RATE = 15.0 * DEG
"""Row 18 of docs/explanation/safety.md, nominal; means over 50 ms."""
HALF_WAY = 14.0 * DEG


def ride(place: str, stopped_s: float) -> Traverse:
    """Drive on a short flight of 28°, up or down from a landing; stopped at a time, re-armed ten seconds later."""
    scenario = Scenario.model_validate(
        {
            "stair": {"slope_deg": 28.0, "run_m": 0.30, "steps": 8 if place == "flight" else 5, "landing_m": 3.0},
            "start": {"place": place, "step": 3, "heading_deg": 0.0 if place == "flight" else 12.0},
            "drive": {"direction": "down" if place == "landing" else "up", "duration_s": 150.0},
            "sensors": {"camera": "statistical"},
            "operator": [{"kind": "stop", "at_s": stopped_s}, {"kind": "rearm", "at_s": stopped_s + HELD_S}],
        }
    )
    return traverse(scenario, controller=shipped_controller("wheelchair"), seed=3)


@pytest.mark.parametrize(
    ("place", "phase", "stopped_s", "half_way"),
    [
        pytest.param("floor", "traction", 19.5, False, id="testing the traction"),
        pytest.param("flight", "crest", 12.6, False, id="reaching for the landing"),
        pytest.param("flight", "crest", 21.4, True, id="led down over the crest"),
        pytest.param("landing", "leave", 29.6, False, id="leaving"),
    ],
)
def test_a_chair_that_was_stopped_goes_on_as_if_nothing_had_been(
    place: str, phase: str, stopped_s: float, *, half_way: bool
) -> None:
    """Test: a stop of 10 s, longer than anything is waited for, in a phase, or half-way between landing and flight. Expected
    result: one hold, the person's; it arrives, and pitches no faster after it than without."""
    run = ride(place, stopped_s)
    assert [(event.cause, event.t_s) for event in run.events if event.name == "hold"] == [
        ("operator stop", pytest.approx(stopped_s, abs=0.11))  # the handset speaks ten times a second
    ]
    assert [name for t_s, name in run.scores.phases if t_s <= stopped_s][-1] == phase
    assert not half_way or abs(run.trace["pitch_rad"][round(stopped_s / TICK_S)] - HALF_WAY) < 5.0 * DEG
    assert run.verdict == "arrived", run.cause
    after = run.trace["t_s"] > stopped_s + HELD_S
    assert float(np.abs(lasting(run.trace["pitch_rate_rad_s"][after])).max()) <= PITCH_RATE
