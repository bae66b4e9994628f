"""Any camera in the loop: by its kind or by a camera file, rendered, statistical or ideal."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.core.camera_images import BASELINES_M, DepthSensor, RgbdFrame
from treadline.core.signals import TICK_S, HeadingMeasurement
from treadline.perception import StairDetector
from treadline.plant.mujoco import open_plant
from treadline.plant.sensors.camera import Camera
from treadline.scenario.camera_file import CameraFile, read_camera
from treadline.scenario.scenario import Scenario, Sensors, Stair, read_scenario
from treadline.scenario.shipped_files import CAMERAS
from treadline.vehicle.staircase import build_staircase

KINDS = [kind for kind in get_args(DepthSensor) if kind != "auto"]
ON_THE_FLIGHT = {"start": {"place": "flight", "heading_deg": 8.0}}


def readings(scenario: Scenario, ticks: int) -> list[tuple[int, object]]:
    """Return what a standing chair's sensors deliver, with the tick of the delivery."""
    plant = open_plant(scenario, 0)
    plant.start()
    found = []
    for tick in range(ticks):
        plant.advance(tick * TICK_S)
        found += [(tick, reading) for reading in plant.read()]
    return found


def test_each_kind_of_sensor_has_a_camera_file_and_a_baseline() -> None:
    assert sorted(path.stem for path in CAMERAS.glob("*.toml")) == sorted(KINDS) == sorted(BASELINES_M)
    assert [read_camera(Path(kind)).sensor for kind in KINDS] == KINDS


def test_former_values_stay_valid() -> None:
    former = [Sensors(camera=camera) for camera in ("statistical", "ideal", "kinect1")]
    assert [sensors.camera_model for sensors in former] == ["statistical", "ideal", "rendered"]
    assert {(sensors.camera_name, sensors.rows_px) for sensors in former} == {("kinect1", 240)}


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_sees_the_heading_rendered_and_statistically(kind: str) -> None:
    """Test: a chair at rest on the flight, 8° off. Expected result: both models accept, within 1°; images have the kind's size."""
    rendered, drawn = (
        Scenario.model_validate(ON_THE_FLIGHT | {"sensors": {"camera": kind, "model": model}})
        for model in ("rendered", "statistical")
    )
    frame = next(reading for _, reading in readings(rendered, 1) if isinstance(reading, RgbdFrame))
    device = read_camera(Path(kind))
    assert frame.depth_m.shape == ((240, 320) if kind == "kinect1" else (device.height, device.width))
    seen = StairDetector().see(frame).measurement
    declared = [reading for _, reading in readings(drawn, 60) if isinstance(reading, HeadingMeasurement)]
    assert len(declared) >= 3
    assert seen is not None
    assert [seen.heading_rad, np.mean([item.heading_rad for item in declared])] == pytest.approx([8.0 * DEG] * 2, abs=1.0 * DEG)


def test_a_camera_file_gives_lens_mount_rate_and_latency(tmp_path: Path) -> None:
    """Test: a file next to the scenario, 20 frames a second, 30 ms late. Expected result: so the frames come."""
    (tmp_path / "own.toml").write_text('sensor = "d435"\nmount_pitch_deg = 35.0\nrate_hz = 20.0\nlatency_s = 0.03\n')
    still = "[realism]\ncamera_jitter_s = 0.0\ncamera_drop_rate = 0.0\n"
    (tmp_path / "scenario.toml").write_text(f'[start]\nplace = "flight"\n[sensors]\ncamera = "own.toml"\n{still}')
    scenario = read_scenario(tmp_path / "scenario.toml")
    frames = [(tick, reading) for tick, reading in readings(scenario, 20) if isinstance(reading, RgbdFrame)]
    assert [(tick, round(frame.t_s / TICK_S)) for tick, frame in frames] == [(0, 0), (8, 5), (13, 10), (18, 15)]
    camera = frames[0][1].camera
    assert (camera.sensor, camera.width_px, camera.fx_px) == ("d435", 640, 387.0)
    assert camera.mount_pitch_rad == pytest.approx(35.0 * DEG)
    assert camera.mount_m == scenario.read_chair().camera.position_m


@pytest.mark.parametrize("kind", KINDS)
def test_a_noise_law_is_the_spread_of_the_rendered_depth(kind: str) -> None:
    """Test: a wall 2 m away, σ = 2 mm + 1 mm/m² · Z². Expected result: 6 mm within 10 %, from pixel to pixel."""
    device = CameraFile.model_validate({"sensor": kind, "sigma_m": [0.002, 0.001, 2.0]})
    exact = np.full((device.height, device.width), 2.0)
    scene = Camera(
        build_staircase(Stair(), np.random.default_rng(0)),
        device.camera,
        kind=device.kind,
        device=device,
        rng=np.random.default_rng(1),
    )
    depth = np.stack([scene.measured(exact, np.zeros(exact.shape, dtype=int), np.arange(1)) for _ in range(2)])
    assert np.nanstd(depth[1] - depth[0]) / np.sqrt(2.0) == pytest.approx(0.006, rel=0.1)
