"""Drops at the ends of landings: the guard stops a chair that is commanded on, and lets it pass where it arrives or enters."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from treadline.core.signals import FreeGround
from treadline.run.episode import Traverse, run_episode
from treadline.run.resolve import resolve
from treadline.scenario.scenario import Scenario
from treadline.vehicle.staircase import as_designed

PULLEY_M = 0.475
"""Half of the flat run of the shipped chair, 0.95 m."""


pytestmark = pytest.mark.usefixtures("without_shape_checks")


def scenario(direction: str, camera: str = "statistical", **stair: Any) -> Scenario:
    return Scenario.model_validate(
        {
            "stair": {"slope_deg": 28.0, "steps": 6, "width_m": 1.4} | stair,
            "start": {"place": "floor" if direction == "up" else "landing"},
            "drive": {"direction": direction, "duration_s": 120.0, "check": False},
            "sensors": {"camera": camera},
        }
    )


def driven(scenario: Scenario, **options: Any) -> Traverse:
    """Return the run of a mission that does not know on which landings the stair turns."""
    setup = resolve(scenario, None, 3)
    return run_episode(replace(setup, mission=replace(setup.mission, landings=None)), **options)


@pytest.mark.parametrize(
    ("camera", "direction", "turn", "cause"),
    [
        ("statistical", "up", "right", "the ground ends"),
        ("statistical", "down", "left", "the ground ends"),
        ("kinect1", "down", "left", "no ground is seen beyond"),  # there is nothing below this landing that a camera could see
    ],
)
def test_a_chair_commanded_to_drive_over_a_quarter_landing_stops_before_its_end(
    camera: str, direction: str, turn: str, cause: str
) -> None:
    """Test: the next flight leaves by the side. Expected result: HOLD, 0.3 m or more from the leading pulley to the rim."""
    declared = scenario(direction, camera, flights=2, turn=turn, between_m=2.5, landing_m=3.0)
    run = driven(declared)
    assert run.verdict == "held"
    assert str(run.cause).startswith(cause)
    staircase = as_designed(declared.stair)
    R_WF, p_WF = staircase.flight_frame(0 if direction == "up" else 1)
    p_WB = np.array([run.trace[f"chassis_{axis}_m"][-1] for axis in "xyz"])
    along_m = float((R_WF.T @ (p_WB - p_WF))[0])
    # The landing's far rim: 2.5 m beyond the first flight's last nosing; one width of 1.4 m before the second flight's foot.
    left_m = staircase.steps[5].x_m + 2.5 - along_m if direction == "up" else along_m + 1.4
    assert 0.3 <= left_m - PULLEY_M < 0.5


def test_a_landing_of_usual_depth_is_deep_enough_to_arrive() -> None:
    """Test: 1.5 m without a wall at its end, the default. Expected result: it arrives."""
    assert driven(scenario("up", landing_m=1.5)).verdict == "arrived"


def test_rendered_frames_report_the_ground_and_nothing_says_that_drops_are_not_watched() -> None:
    """Test: a chair on a landing, the edge of a flight behind it. Expected result: its distance in each frame after the first."""
    signals: list[Any] = []
    declared = scenario("down", "kinect1", landing_m=3.0, slope_deg=28.0).changed(drive={"duration_s": 0.5})
    run = driven(declared, sink=lambda signal, _: signals.append(signal))
    grounds = [signal for signal in signals if isinstance(signal, FreeGround)]
    edge_m = float(run.trace["chassis_x_m"][0]) - as_designed(declared.stair).steps[-1].x_m
    assert [ground.end_m for ground in grounds[1:]] == pytest.approx([edge_m] * len(grounds[1:]), abs=0.02)
    assert len(grounds) > 2
    assert "drop_unwatched" not in [event.name for event in run.events]
