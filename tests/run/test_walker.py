"""Rest poses and walks against the simulator of motion: what a chair does slowly, it does at rest."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import treadline as tl
from treadline.core.angles import DEG
from treadline.core.errors import SettingsError
from treadline.playback import read_recording
from treadline.run.resolve import checked
from treadline.scenario.scenario import Scenario
from treadline.vehicle.ground_profile import ground_profile
from treadline.vehicle.rest_poses import rest_chair
from treadline.vehicle.staircase import as_designed

UP: dict[str, Any] = {"start": {"place": "floor"}}
DOWN: dict[str, Any] = {"start": {"place": "landing"}, "drive": {"direction": "down"}}
FLIGHT: dict[str, Any] = {"stair": {"slope_deg": 28, "steps": 4}}
TRIPS: dict[str, dict[str, Any]] = {
    "up": FLIGHT | UP,
    "down": FLIGHT | DOWN,
    "low last riser up": FLIGHT | UP | {"step": [{"index": 3, "rise_m": 0.11}]},
    "high last riser down": FLIGHT | DOWN | {"step": [{"index": 3, "rise_m": 0.186}]},
    "kerb up": {"stair": {"rise_m": 0.15, "steps": 1}} | UP,
    "kerb down": {"stair": {"rise_m": 0.15, "steps": 1}} | DOWN,
    "robot up": {"stair": {"slope_deg": 26, "steps": 4}, "chair": {"model": "rescue", "payload_kg": 5}} | UP,
}


@pytest.mark.parametrize("name", TRIPS)
def test_the_pitch_of_a_drive_is_that_of_its_rest_poses(name: str, tmp_path: Path) -> None:
    """Test: place and flipper angle of a simulated drive, followed from its start. Expected result: its pitch within 0.2° (RMS),
    and within 0.7° everywhere; the walk that check made before takes as long, and turns as fast."""
    scenario = Scenario.model_validate(TRIPS[name] | {"sensors": {"camera": "statistical"}})
    report = checked(scenario)
    assert report.verdict == "go"
    run = tl.climb(scenario, seed=1, out=tmp_path / "run")
    assert run.verdict == "arrived"
    drive = read_recording(tmp_path / "run")
    chair = rest_chair(scenario.read_chair(), scenario.chair.payload_kg)
    ground = ground_profile(as_designed(scenario.stair, scenario.step))
    kept = np.flatnonzero(np.isfinite(drive.flipper_rad))[::5]
    places, angles = drive.p_WB[kept, 0].tolist(), drive.flipper_rad[kept].tolist()
    pose = chair.at(ground, places[0], (angles[0],), 0.0)
    pitch_rad = []
    for x_m, angle_rad in zip(places, angles, strict=True):
        pose, _ = chair.moved(ground, pose, x_m, (angle_rad,))
        pitch_rad.append(pose.pitch_rad)
    off_deg = (np.array(pitch_rad) - drive.pitch_rad[kept]) / DEG
    assert np.sqrt(np.mean(off_deg**2)) < 0.2
    assert np.abs(off_deg).max() < 0.7
    # The planner turns the chair at 9°/s; what a drive adds is its own rocking.
    assert report.walk.strides[-1].t_s == pytest.approx(run.scores.duration_s, rel=0.15)
    assert run.scores.max_pitch_rate_deg_s - report.walk.fastest.rate_rad_s / DEG < 3.0


def test_the_walk_is_drawn_and_a_refusal_without_one_says_why() -> None:
    report = checked(Scenario.model_validate(TRIPS["kerb up"]))
    figure = report.plot()
    assert len(figure.axes) == 5
    steep = checked(Scenario.model_validate({"stair": {"slope_deg": 44}} | UP))
    with pytest.raises(SettingsError, match=r"nothing to draw: the stair is 44\.0° steep"):
        steep.plot()


def test_a_chair_that_leans_too_far_falls_in_its_walk() -> None:
    leaning = {"chair": {"payload_kg": 80, "payload_offset_m": [-0.4, 0.0, 0.05]}}
    report = checked(Scenario.model_validate(FLIGHT | DOWN | leaning))
    assert report.verdict == "refuse"
    assert re.search(r"at nosing \d, \d+ s after the start \(edge\) the chair would turn at [3-9]\d°/s", report.reasons[0])
