"""Camera files: calibrations of real cameras are accepted, impossible ones rejected with their number."""

import pytest

from treadline.core.errors import SettingsError
from treadline.core.settings import settings_of
from treadline.scenario.camera_file import CameraFile


def calibration(width: int, height: int, fx_px: float, fy_px: float, **further: float | str) -> CameraFile:
    lens = {"fx_px": fx_px, "fy_px": fy_px, "cx_px": 0.5 * width, "cy_px": 0.5 * height}
    return settings_of({"width": width, "height": height, **lens, **further}, CameraFile, where="camera.toml")


@pytest.mark.parametrize(
    ("width", "height", "focal_px"),
    [
        (320, 240, 287.5),
        (640, 480, 525.0),  # Kinect 1, colour
        (512, 424, 365.5),  # Kinect 2, depth
        (1920, 1080, 1081.4),  # Kinect 2, colour
        (848, 480, 424.0),  # RealSense D435
        (1280, 720, 640.0),  # the same
        (240, 180, 178.0),  # a phone's time-of-flight sensor
        (1920, 1440, 800.0),  # a phone's wide lens
    ],
)
def test_real_cameras_pass(width: int, height: int, focal_px: float) -> None:
    assert calibration(width, height, focal_px, 1.02 * focal_px).fx_px == focal_px


@pytest.mark.parametrize(
    ("fx_px", "further", "message"),
    [
        (200.0, {}, "fx_px / fy_px is 0.696; pixels are square, so it must be from 0.8 to 1.25"),
        (0.5, {}, "fx_px = 0.5 for 320 pixels is a field of view of 179.6°; it must be from 10 to 150°"),
        (5000.0, {}, "fx_px = 5000 for 320 pixels is a field of view of 3.7°; it must be from 10 to 150°"),
        (287.5, {"mount_pitch_deg": 400.0}, "mount_pitch_deg: must be a number from -180 to 180 (got 400.0)"),
        (287.5, {"sensor": "d415"}, "sensor: must be 'auto', 'kinect1', 'kinect2', 'd435', 'd455' or 'tof' (got 'd415')"),
    ],
)
def test_an_impossible_calibration_is_refused_with_its_number(fx_px: float, further: dict[str, float | str], message: str) -> None:
    with pytest.raises(SettingsError) as refused:
        calibration(320, 240, fx_px, 287.5, **further)
    assert str(refused.value).startswith(f"camera.toml: {message}")


@pytest.mark.parametrize("sensor", ["auto", "kinect1", "kinect2", "d435", "d455", "tof"])
def test_the_kind_of_sensor_reaches_the_calibration(sensor: str) -> None:
    assert calibration(320, 240, 287.5, 287.5, sensor=sensor).camera.sensor == sensor
    assert calibration(320, 240, 287.5, 287.5).camera.sensor == "auto"
