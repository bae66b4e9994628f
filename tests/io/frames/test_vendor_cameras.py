"""The port of a depth camera, over all vendors: depth, intrinsics, stamps and forces come through; a failure is one line."""

import json
import os
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scripts import module_of

from treadline.cli import main
from treadline.core.camera_images import PinholeCamera
from treadline.core.errors import CameraError
from treadline.io.live import CAMERAS, DepthCamera, camera_by_name
from treadline.io.live._depth_camera import undistortion

FORCE_C = np.array([0.0, -9.0, -4.0])
"""Specific force in the camera frame of a camera that looks 24° down [m/s²]."""
WIDTH, HEIGHT = 8, 6
K = (WIDTH, HEIGHT, 400.0, 401.0, 3.5, 4.0)
STAMPS = [100.0, 100.1, 100.25]
fakes: Any = module_of(Path(__file__).with_name("fake_vendors.py"))
PACKAGES = {"realsense": "pyrealsense2", "orbbec": "pyorbbecsdk", "oak": "depthai"}
UNIT_M = {"realsense": 0.0005, "orbbec": 0.0005, "oak": 0.001}


def shot_at(t_s: float, **changes: Any) -> Any:
    """Return an exposure with its own counts, and two forces whose mean is known."""
    rng = np.random.default_rng(round(1e3 * t_s))
    counts = rng.integers(500, 3000, (HEIGHT, WIDTH)).astype(np.uint16)
    counts[0, :3] = 0, 65535, 0
    rgb = rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    forces = tuple(tuple(fakes.MOUNTED.T @ (FORCE_C + bump)) for bump in ([0.5, 0.0, 1.0], [-0.5, 0.0, -1.0]))
    return fakes.Shot(t_s, counts, rgb, forces)._replace(**changes)


SHOTS = [shot_at(t_s) for t_s in STAMPS]
Plug = Callable[..., tuple[DepthCamera, Any, Any]]


@pytest.fixture
def plug(monkeypatch: pytest.MonkeyPatch) -> Plug:
    """Install the fake package of a camera; return the camera, the package and its pipeline."""

    def make(name: str, shots: list[Any] = SHOTS, intrinsics: Any = K, **options: Any) -> tuple[DepthCamera, Any, Any]:
        module, pipeline = getattr(fakes, PACKAGES[name])(shots, intrinsics, **options)
        monkeypatch.setitem(sys.modules, PACKAGES[name], module)
        return camera_by_name(name), module, pipeline

    return make


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("name", CAMERAS)
def test_images_come_in_order_with_depth_intrinsics_stamps_and_force(plug: Plug, name: str, colour: bool) -> None:
    camera, _, pipeline = plug(name)
    assert isinstance(camera, DepthCamera)
    camera.close()  # of a camera that is not open
    camera.open(colour=colour)
    assert (camera.name, camera.rate_hz) == (name, 15.0 if name == "orbbec" else 30.0)
    found = camera.intrinsics()
    assert (found.width_px, found.height_px, found.fx_px, found.fy_px, found.cx_px, found.cy_px) == K
    images = [camera.next_images(1.0) for _ in STAMPS]
    assert [item.t_s for item in images] == pytest.approx(STAMPS, abs=1e-6)
    for item, shot in zip(images, SHOTS, strict=True):
        assert np.flatnonzero(np.isnan(item.depth_m)).tolist() == [0, 1, 2]
        np.testing.assert_allclose(item.depth_m[1:], UNIT_M[name] * shot.counts[1:], rtol=1e-6)
        np.testing.assert_allclose(item.force_C, FORCE_C, atol=1e-6)
        # The colour camera of an OAK has other axes than its depth camera.
        assert (item.rgb is not None) == (colour and name != "oak")
        assert item.rgb is None or (item.rgb.tolist(), item.rgb_t_s) == (shot.rgb.tolist(), pytest.approx(shot.t_s))
    pipeline.stop.assert_not_called()
    with pytest.raises(CameraError, match=rf"^{name}: no depth image for 1 s \(.+\); was it unplugged\?$"):
        camera.next_images(1.0)
    camera.close()
    camera.close()
    pipeline.stop.assert_called_once_with()


@pytest.mark.parametrize("name", CAMERAS)
def test_a_camera_that_sends_nothing_is_given_up_in_time(plug: Plug, name: str) -> None:
    camera, _, pipeline = plug(name)
    camera.open(colour=False)
    nothing = fakes.getters(get_depth_frame=None, get_accel_frame=None, first_or_default=None)
    pipeline.wait_for_frames.side_effect = lambda _: nothing
    pipeline.create().build().depth.createOutputQueue().get.side_effect = [None]
    with pytest.raises(CameraError, match=rf"^{name}: no depth image for 0\.01 s; was it unplugged\?$"):
        camera.next_images(0.01)


@pytest.mark.parametrize("name", CAMERAS)
def test_a_camera_without_imu_gives_no_force(plug: Plug, name: str) -> None:
    shot = shot_at(1.0) if name == "oak" else shot_at(1.0, forces_I=())  # an OAK has an IMU whose axes are unknown
    camera, *_ = plug(name, [shot], has_imu=False)
    camera.open(colour=False)
    assert camera.next_images(1.0).force_C is None


@pytest.mark.parametrize("name", CAMERAS)
def test_a_camera_that_does_not_open_is_one_error(plug: Plug, name: str) -> None:
    camera, *_ = plug(name, error=RuntimeError("device or\nresource busy"))
    with pytest.raises(CameraError, match=rf"^{name}: busy \(device or resource busy\)"):
        camera.open(colour=False)


@pytest.mark.parametrize("name", CAMERAS)
def test_a_missing_package_is_one_line_with_the_extra(monkeypatch: pytest.MonkeyPatch, capsys, name: str) -> None:
    monkeypatch.setitem(sys.modules, PACKAGES[name], None)  # import_module raises ModuleNotFoundError
    assert main(["see", "--live", name]) == 2
    assert capsys.readouterr().err == (
        f"treadline: --live {name} needs {PACKAGES[name]}: pip install '.[{name}]' in treadline's folder\n"
    )


DISTORTION = (0.1, -0.05, 0.001, -0.002, 0.02, 0.01, 0.0, 0.0)
"""Coefficients k1, k2, p1, p2, k3 to k6 of a lens with distortion."""


def test_a_distorted_image_becomes_a_pinhole_image(plug: Plug) -> None:
    camera = PinholeCamera(width_px=640, height_px=480, fx_px=400.0, fy_px=401.0, cx_px=319.0, cy_px=241.0)
    # A plane that is oblique in space has 1/z linear in the pinhole pixel; the lens moves the pixels by up to 40 px.
    matrix = np.array([[400.0, 0, 319.0], [0, 401.0, 241.0], [0, 0, 1]])
    v, u = np.indices((480, 640)).astype(float)
    ideal = cv2.undistortPoints(np.stack([u.ravel(), v.ravel()], axis=1)[:, None], matrix, np.array(DISTORTION))[:, 0]
    z_m = (1.5 / (1.0 + 0.3 * ideal[:, 0] + 0.2 * ideal[:, 1])).reshape(480, 640)
    shot = fakes.Shot(1.0, np.round(2000.0 * z_m).astype(np.uint16))
    bent, *_ = plug("orbbec", [shot], (640, 480, 400.0, 401.0, 319.0, 241.0), lens=DISTORTION)
    bent.open(colour=False)
    expected = 1.5 / (1.0 + 0.3 * (u - 319.0) / 400.0 + 0.2 * (v - 241.0) / 401.0)
    inside = np.s_[60:420, 80:560]
    # The nearest pixel is half a pixel off: 0.6 mm at this slope, and a quarter of a millimetre of rounding.
    np.testing.assert_allclose(bent.next_images(1.0).depth_m[inside], expected[inside], atol=2.5e-3)
    assert np.abs(z_m[inside] - expected[inside]).max() > 5e-3
    assert undistortion(camera, np.zeros(8))(np.eye(480, 640, dtype=np.uint16)).sum() == 480
    wide, *_ = plug("orbbec", lens=DISTORTION, model="KANNALA_BRANDT4")
    with pytest.raises(CameraError, match="lens model KANNALA_BRANDT4 is not a pinhole"):
        wide.open(colour=False)


@pytest.mark.parametrize("package", PACKAGES.values())
def test_an_installed_package_has_the_names_in_use(package: str) -> None:
    found = pytest.importorskip(package, exc_type=ImportError)
    for path in tomllib.loads(Path(__file__).with_name("vendor_names.toml").read_text())[package].split():
        value = found
        for part in path.split("."):
            assert hasattr(value, part), f"{package} has no {path}"
            value = getattr(value, part)


def test_what_a_vendor_writes_to_stdout_goes_to_stderr(plug: Plug, capfd) -> None:
    *_, pipeline = plug("realsense", [shot_at(t_s, forces_I=()) for t_s in STAMPS])
    profile = pipeline.start.return_value
    pipeline.start.side_effect = lambda _: os.write(1, b"load extensions\n") and profile
    assert main(["see", "--live", "realsense", "--seconds", "0.05", "--json"]) == 0
    said = capfd.readouterr()
    assert json.loads(said.out)["camera"] == "realsense"
    assert "load extensions" in said.err
