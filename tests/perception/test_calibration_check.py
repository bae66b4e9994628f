"""Calibration checks over frames: errors are named with their figure, a right calibration is not."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scenes import RecordedDrive, View, ViewRecipe

from treadline.core.angles import DEG
from treadline.core.rotations import rotation_x, rotation_z
from treadline.perception import StairDetector
from treadline.perception.calibration_check import CalibrationCheck

FRAMES = 6


@cache
def views() -> list[View]:
    """Return views of a chair that approaches from 1.6 m before a flight, camera 0.8 m above the floor and pitched by 40°."""
    recipe = ViewRecipe(scenes=("foot",), place_m=(1.6, 1.6), gravity_error_deg=0.3, heading_deg=(10.0, 20.0))
    drive = RecordedDrive(np.random.default_rng(5_330_000), recipe)
    return [drive.view(0.1 * tick, drive.pose(0.02 * tick, 0.2)) for tick in range(FRAMES)]


def findings(*, focal: float = 1.0, scale: float = 1.0, turn: np.ndarray | None = None, count: int = FRAMES) -> list[str]:
    check = CalibrationCheck()
    for view in views()[:count]:
        camera = replace(view.frame.camera, fx_px=focal * view.frame.camera.fx_px, fy_px=focal * view.frame.camera.fy_px)
        frame = replace(view.frame, camera=camera, depth_m=np.float32(scale) * view.frame.depth_m)
        gravity = view.gravity_C if turn is None else turn @ view.gravity_C
        check.add(camera, StairDetector().look(frame, gravity), gravity)
    return check.findings


def test_a_right_calibration_is_not_named_nor_a_wrong_one_from_few_frames() -> None:
    assert findings() == []
    assert findings(focal=1.12, count=4) == []


@pytest.mark.parametrize("focal", [0.88, 1.12])
def test_a_wrong_focal_length_is_named_with_its_size(focal: float) -> None:
    (said,) = findings(focal=focal)
    percent, way = re.search(r"seems (\d+)% too (long|short)", said).groups()
    assert float(percent) == pytest.approx(12.0, abs=2.0)
    assert way == ("long" if focal > 1.0 else "short")


def test_a_mount_off_gravity_is_named_with_its_angle() -> None:
    (said,) = findings(turn=rotation_x(4.0 * DEG))
    assert abs(float(re.search(r"treads lie ([+-][\d.]+)° about the edges", said)[1])) == pytest.approx(4.0, abs=0.6)


def test_a_depth_scale_is_named_by_the_height_of_the_camera() -> None:
    (said,) = findings(scale=1.25)
    assert float(re.search(r"the floor lies ([\d.]+)", said)[1]) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(("turn_deg", "named"), [(90.0, "left"), (180.0, "up"), (-90.0, "right")])
def test_a_turned_camera_is_named(turn_deg: float, named: str) -> None:
    (said,) = findings(turn=rotation_z(turn_deg * DEG))
    assert said.startswith(f"turned camera: gravity points {named} in {FRAMES} frames")
