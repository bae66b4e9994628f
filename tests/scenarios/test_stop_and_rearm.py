"""A person stops the chair, and lets it go on: in each phase where something is waited for, led, or tested."""

from functools import cache

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.run.episode import Traverse, traverse
from treadline.scenario.scenario import Scenario
from treadline.scenario.shipped_files import shipped_controller
from treadline.vehicle.comfort import lasting

HELD_S = 10.0
PITCH_RATE = 15.0 * DEG
"""Row 18 of docs/explanation/safety.md, nominal; means over 50 ms."""
HALF_WAY = 14.0 * DEG


@cache
def ride(place: str, stopped_s: float | None = None) -> Traverse:
    """Drive on a short flight of 28°, up or down from a landing; stopped at a time, re-armed ten seconds later."""
    rearmed_s = 0.0 if stopped_s is None else stopped_s + HELD_S
    scenario = Scenario.model_validate(
        {
            "stair": {"slope_deg": 28.0, "run_m": 0.30, "steps": 8 if place == "flight" else 5, "landing_m": 3.0},
            "start": {"place": place, "step": 3, "heading_deg": 0.0 if place == "flight" else 12.0},
            "drive": {"direction": "down" if place == "landing" else "up", "duration_s": 150.0},
            "sensors": {"camera": "statistical"},
            "operator": [] if stopped_s is None else [{"kind": "stop", "at_s": stopped_s}, {"kind": "rearm", "at_s": rearmed_s}],
        }
    )
    return traverse(scenario, controller=shipped_controller("wheelchair"), seed=3)


def moment_s(run: Traverse, phase: str, later_s: float | None) -> float:
    """Return a time in a phase: so long after its beginning, or where the chair is half-way between landing and flight."""
    began_s = next(t_s for t_s, name in run.scores.phases if name == phase)
    if later_s is not None:
        return began_s + later_s
    t_s, steep = run.trace["t_s"], run.trace["pitch_rad"] > HALF_WAY
    during = t_s >= began_s
    return float(t_s[during & (steep != steep[during][0])][0])


@pytest.mark.parametrize(
    ("place", "phase", "later_s"),
    [
        pytest.param("floor", "align", 0.3, id="turning square"),
        pytest.param("floor", "traction", 0.7, id="testing the traction"),
        pytest.param("flight", "crest", 0.5, id="reaching for the landing"),
        pytest.param("flight", "crest", None, id="led down over the crest"),
        pytest.param("landing", "edge", None, id="lifted at the edge"),
        pytest.param("landing", "leave", 0.5, id="leaving"),
    ],
)
def test_a_chair_that_was_stopped_goes_on_as_if_nothing_had_been(place: str, phase: str, later_s: float | None) -> None:
    """Test: a stop of 10 s, longer than anything is waited for. Expected result: one hold, the person's; it arrives, and pitches
    no faster after it than without."""
    stopped_s = moment_s(ride(place), phase, later_s)
    run = ride(place, stopped_s)
    assert [(event.cause, event.t_s) for event in run.events if event.name == "hold"] == [
        ("operator stop", pytest.approx(stopped_s, abs=0.11))  # the handset speaks ten times a second
    ]
    assert [name for t_s, name in run.scores.phases if t_s <= stopped_s][-1] == phase
    assert run.verdict == "arrived", run.cause
    after = run.trace["t_s"] > stopped_s + HELD_S
    assert float(np.abs(lasting(run.trace["pitch_rate_rad_s"][after])).max()) <= PITCH_RATE
