"""What the camera sees from the start: the verdict asks for two nosings, and its remedies work."""

import math
import re
from typing import Any

import pytest
from chairs import CHAIR, judge, with_piece

from treadline.scenario.chair import read_chair

DOWN: dict[str, dict[str, Any]] = {"start": {"place": "landing"}, "drive": {"direction": "down"}}


def test_the_count_is_that_of_a_pinhole_camera() -> None:
    # Eye 0.80 m up and 0.40 m ahead of mid-track, first nosing 1 m ahead of the front pulley. It is pitched 40° down, and half of
    # its field is atan(120 / 287.5) = 22.7°: points from 17.3° to 62.7° below the horizon are in the image.
    report = judge(stair={"rise_m": 0.16, "run_m": 0.30})
    eye_m = 1.0 + 0.5 * CHAIR.tracks.flat_run_m - 0.40
    below = [math.degrees(math.atan2(0.80 - 0.16 * (k + 1), eye_m + 0.30 * k)) for k in range(20)]
    assert report.nosings_in_view == sum(17.4 < angle < 62.6 for angle in below) == 2
    assert report.verdict == "go"


@pytest.mark.parametrize(("name", "tables"), [("camera", {}), ("rear_camera", DOWN)])
@pytest.mark.parametrize("pitch_deg", [-60.0, 80.0])
def test_a_camera_that_looks_past_the_stair_is_refused_with_the_pitches_that_see_it(
    name: str, tables: dict[str, Any], pitch_deg: float
) -> None:
    report = judge(with_piece(name, pitch_deg=pitch_deg), **tables)
    (reason,) = report.reasons
    assert reason.startswith(f"fewer than 2 nosings are in view of the {name.replace('_', ' ')} from the start")
    found = re.search(rf"{name}\.pitch_deg is {pitch_deg:g} in the chair's file: give (-?\d+) to (-?\d+)$", reason)
    low, high = int(found[1]), int(found[2])
    assert judge(with_piece(name, pitch_deg=float((low + high) // 2)), **tables).verdict == "go"
    for pitch in (low, high):  # from where the drive may lose the stair later, which its walk shows
        assert not any("from the start" in said for said in judge(with_piece(name, pitch_deg=float(pitch)), **tables).reasons)
    for pitch in (low - 5, high + 5):
        assert judge(with_piece(name, pitch_deg=float(pitch)), **tables).verdict == "refuse"


def test_a_rear_camera_that_looks_ahead_is_refused() -> None:
    (reason,) = judge(with_piece("rear_camera", yaw_deg=0.0, pitch_deg=0.0), **DOWN).reasons
    assert "no pitch of its mount would do: correct rear_camera.position_m, yaw_deg" in reason
    # On the flight it sees nosings, but those above.
    (reason,) = judge(
        with_piece("rear_camera", yaw_deg=0.0), start={"place": "flight", "step": 8}, drive={"direction": "down"}
    ).reasons
    assert "fewer than 2 nosings" in reason


@pytest.mark.parametrize(
    # Runs on 25° and eight steps, with rendered frames and without: from step 4 up and step 6 down they arrive, from step 5 they
    # are held with no stair in view for 12 s.
    ("direction", "step", "verdict"),
    [("up", 4, "go"), ("up", 5, "refuse"), ("down", 5, "refuse"), ("down", 6, "go")],
)
def test_a_start_near_the_end_of_the_flight_is_refused_where_a_run_sees_no_stair(direction: str, step: int, verdict: str) -> None:
    report = judge(
        stair={"slope_deg": 25.0, "steps": 8, "landing_m": 3.0},
        start={"place": "flight", "step": step},
        drive={"direction": direction},
    )
    assert report.verdict == verdict
    if verdict == "refuse":
        assert report.reasons[0].endswith("start at step 4 or below" if direction == "up" else "start at step 6 or above")


@pytest.mark.parametrize("heading_deg", [-60.0, 44.0, 75.0])
def test_on_the_floor_the_chair_turns_to_see(heading_deg: float) -> None:
    assert judge(stair={"slope_deg": 28.0}, start={"heading_deg": heading_deg}).verdict == "go"


@pytest.mark.parametrize(
    # Of 12 rendered frames each, ``see`` accepts all of 0.09 by 0.30 and 0.16 by 0.50 m, and none of the others.
    ("rise_m", "run_m", "is_refused"),
    [(0.09, 0.30, False), (0.16, 0.50, False), (0.075, 0.30, True), (0.06, 0.30, True), (0.16, 0.56, True)],
)
def test_steps_that_the_detector_does_not_accept_are_refused(rise_m: float, run_m: float, *, is_refused: bool) -> None:
    said = f"steps of {rise_m:.3f} by {run_m:.3f} m, and the detector accepts rises of 0.08 to 0.25 m and runs of 0.15 to 0.52 m"
    for vision, wanted in (("robust", is_refused), ("truth", False)):
        report = judge(stair={"rise_m": rise_m, "run_m": run_m}, control={"vision": vision})
        assert any(reason.startswith(said) for reason in report.reasons) is wanted


def test_an_open_loop_looks_at_nothing() -> None:
    report = judge(with_piece("camera", pitch_deg=-35.0), control={"loop": "open"})
    assert (report.verdict, report.nosings_in_view) == ("go", None)


def test_a_chair_without_flipper_or_rear_camera_comes_down_no_stair() -> None:
    (reason,) = judge(read_chair("wheelchair-fixed"), **DOWN).reasons
    assert "lacks [flipper] and [rear_camera]" in reason
    (reason,) = judge(CHAIR.model_copy(update={"rear_camera": None}), **DOWN).reasons
    assert "lacks [rear_camera], and comes down no stair; give chair.model" in reason
