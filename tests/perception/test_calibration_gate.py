"""Calibration gate: faults are refused with their cause and the value to set, and a sound calibration is not."""

import functools
import operator
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from real_frames import real_frames
from variations import FAULTS, KnownFrame, drawn_folder, with_fault

import treadline as tl
from treadline.core.angles import DEG
from treadline.core.rotations import rotation_x
from treadline.perception import StairDetector
from treadline.perception.calibration_gate import CalibrationEvidence, CalibrationFault, calibration_evidence

FRAMES = 8
ROLL_NEEDED = "mirrored"
"""Fault that shows by roll alone: before a flight the chair has hardly any."""


@cache
def folder(scene: str) -> list[KnownFrame]:
    """Return frames of a Kinect 1 that drives to a flight, or on it."""
    return drawn_folder(7018, scene, FRAMES)


def evidence(known: KnownFrame) -> CalibrationEvidence:
    sight = StairDetector().look(known.frame, known.gravity_C)
    found = calibration_evidence(sight, known.frame.camera, known.gravity_C)
    assert found is not None
    return found


def fault_of(frames: Sequence[KnownFrame]) -> CalibrationFault | None:
    return functools.reduce(operator.add, [evidence(known) for known in frames]).fault


def fault_with(cause: str, scene: str = "foot") -> CalibrationFault:
    found = fault_of([with_fault(known, cause) for known in folder(scene)])
    assert found is not None
    return found


def value(text: str, name: str) -> float:
    found = re.search(rf"{name} to (-?[\d.]+)", text)
    assert found is not None
    return float(found[1])


@pytest.mark.parametrize("scene", ["foot", "up"])
def test_a_sound_calibration_has_no_fault(scene: str) -> None:
    assert fault_of(folder(scene)) is None
    assert [evidence(known).fault for known in folder(scene)] == FRAMES * [None]


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_has_its_cause(fault: str) -> None:
    found = fault_with(fault, "up" if fault == ROLL_NEEDED else "foot")
    assert found.cause == FAULTS[fault]
    assert found.text.endswith(f": {FRAMES} frames")


@pytest.mark.parametrize("factor", ["0.92", "1.2"])
def test_the_focal_length_to_set_is_the_true_one(factor: str) -> None:
    found = fault_with(f"focal length x{factor}")
    # Risers and treads each deviate by 0.6°, which is 1.5 % of a focal length at a pitch of 45°.
    assert value(found.text, "set fx") == pytest.approx(folder("foot")[0].frame.camera.fx_px, rel=0.03)


def test_the_mount_to_set_is_the_true_one() -> None:
    camera = folder("foot")[0].frame.camera
    for axis in ("pitch", "roll"):
        found = fault_with(f"mount {axis}ed by 3°" if axis == "pitch" else "mount rolled by 3°")
        true_deg = (camera.mount_pitch_rad if axis == "pitch" else camera.mount_roll_rad) / DEG
        assert value(found.text, f"mount_{axis}_deg") == pytest.approx(true_deg, abs=1.2)


@pytest.mark.parametrize("quarter", [1, 2, 3])
def test_the_roll_to_set_makes_a_turned_camera_sound(quarter: int) -> None:
    frames = [with_fault(known, f"turned with gravity by {90 * quarter}°") for known in folder("foot")]
    found = fault_of(frames)
    assert found is not None
    roll_rad = value(found.text, "mount_roll_deg") * DEG
    cameras = [replace(known.frame.camera, mount_roll_rad=roll_rad) for known in frames]
    assert (
        fault_of([replace(known, frame=replace(known.frame, camera=camera)) for known, camera in zip(frames, cameras, strict=True)])
        is None
    )


def test_the_principal_point_to_set_is_the_middle() -> None:
    found, camera = fault_with("calibration of 848×480"), folder("foot")[0].frame.camera
    assert value(found.text, "set cx") == 0.5 * (camera.width_px - 1)
    assert value(found.text, "set fx") == pytest.approx(camera.fx_px, rel=0.03)


def test_leaning_risers_and_a_ramp_are_no_fault() -> None:
    known = folder("foot")[0]
    sight = StairDetector().look(known.frame, known.gravity_C)
    assert sight.blocks is not None
    assert known.gravity_C is not None
    is_level, below_m = np.abs(sight.blocks.unit @ known.gravity_C) > 0.7, sight.blocks.centres @ known.gravity_C
    is_floor = is_level & (below_m > np.quantile(below_m[is_level], 0.9) - 0.1)  # a ramp does not tilt treads
    for tilted in (is_floor, ~is_level):
        unit = np.where(tilted[:, None], sight.blocks.unit @ rotation_x(6.0 * DEG), sight.blocks.unit)
        leaning = replace(sight, blocks=replace(sight.blocks, unit=unit))
        one = calibration_evidence(leaning, known.frame.camera, known.gravity_C)
        assert one is not None
        assert functools.reduce(operator.add, 5 * [one]).fault is None


def test_a_depth_scale_shows_by_the_height_of_the_camera() -> None:
    frames = [replace(known.frame, depth_m=np.float32(1.25) * known.frame.depth_m) for known in folder("foot")]
    found = fault_of([replace(known, frame=frame) for known, frame in zip(folder("foot"), frames, strict=True)])
    assert found is not None
    assert found.cause == "depth scale"
    assert float(found.text.split("by ")[-1].split(":")[0]) == pytest.approx(0.8, abs=0.03)


def test_one_frame_of_a_turned_camera_is_refused() -> None:
    known = with_fault(folder("foot")[0], "turned by 180°")
    sight = tl.detect_stair(known.frame, gravity=known.gravity_C)
    assert not sight.accepted
    assert sight.heading_rad is None
    assert str(sight.reason).startswith("images are turned clockwise by 180° from gravity")


def test_recorded_frames_are_sound_and_turned_ones_are_not() -> None:
    recorded = [real for real in real_frames() if real.gravity_C is not None]
    if not recorded:
        pytest.skip("no recorded frames")
    for real in recorded:
        known = KnownFrame(name=real.name, frame=real.frame, gravity_C=real.gravity_C, edge_C=real.edge_C)
        assert fault_of([known]) is None
        for fault in ("turned by 90°", "turned with gravity by 180°"):
            found = fault_of([with_fault(known, fault)])
            assert found is not None
            assert found.cause == "turned"
