"""Vendors' cameras: depth, intrinsics, stamps and gravity come through; missing, busy and unplugged cameras are one line.

The fakes answer as the documented interfaces do. Where a vendor's package is installed, its names are compared with those in use.
"""

import json
import os
import sys
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
from treadline.io.live import camera_by_name
from treadline.io.live._depth_camera import rotation_or_none, undistortion
from treadline.io.live.stream import LiveFrames

COUNT = 3
FORCE_C = np.array([0.0, -9.0, -4.0]) * 9.80665 / np.linalg.norm([0.0, -9.0, -4.0])
"""Specific force in the camera frame of a camera that looks 24° down."""


fakes: Any = module_of(Path(__file__).with_name("fake_vendors.py"))
PACKAGES = {"realsense": "pyrealsense2", "orbbec": "pyorbbecsdk", "oak": "depthai"}
SIZES = {"realsense": (640, 480), "orbbec": (640, 480), "oak": (640, 400)}


def shots_of(name: str, *, with_force: bool = True) -> list[Any]:
    width, height = SIZES[name]
    force_I = tuple(fakes.MOUNTED.T @ FORCE_C) if with_force else None
    counts = np.random.default_rng(1).integers(500, 3000, (height, width)).astype(np.uint16)
    counts[0, :5] = 0
    rgb = np.random.default_rng(2).integers(0, 256, (height, width, 3), dtype=np.uint8)
    return [
        fakes.Shot(t_s=100.0 + number / 30.0, counts=counts, rgb=rgb, rgb_t_s=100.0 + number / 30.0, force_I=force_I)
        for number in range(COUNT)
    ]


def intrinsics(name: str) -> tuple[float, ...]:
    width, height = SIZES[name]
    return (width, height, 400.0, 401.0, 0.5 * width - 1.0, 0.5 * height + 1.0)


Plug = Callable[..., Any]


@pytest.fixture
def plug(monkeypatch: pytest.MonkeyPatch) -> Plug:
    """Install the fake package of a camera."""

    def make(name: str, shots: list[Any] | None = None, **options: Any) -> Any:
        if name == "realsense":
            options.setdefault("has_imu", True)
        if name == "oak":
            options.setdefault("imu_rotation", fakes.MOUNTED)
        maker = getattr(fakes, f"fake_{PACKAGES[name]}")
        made = maker(iter(shots_of(name) if shots is None else shots), intrinsics(name), **options)
        monkeypatch.setitem(sys.modules, PACKAGES[name], made)
        return made

    return make


def played(name: str, **options: Any) -> tuple[list[Any], str]:
    frames, found = LiveFrames(camera_by_name(name), **options), []
    with pytest.raises(CameraError) as failed:
        found.extend(frames)
    return found, str(failed.value)


@pytest.mark.parametrize("name", PACKAGES)
def test_depth_intrinsics_stamps_and_gravity_come_through(plug, name: str) -> None:
    made = plug(name)
    found, failure = played(name)
    shots = shots_of(name)
    # The first image of an OAK carries the intrinsics, and is not used again.
    assert len(found) == (COUNT - 1 if name == "oak" else COUNT)
    frame = found[0].frame
    camera = frame.camera
    assert (camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == intrinsics(name)
    assert np.isnan(frame.depth_m[0, :5]).all()
    np.testing.assert_allclose(frame.depth_m[1:], 1e-3 * shots[0].counts[1:], rtol=1e-6)
    assert [named.t_s for named in found] == pytest.approx([number / 30.0 for number in range(len(found))], abs=1e-6)
    np.testing.assert_allclose(found[-1].gravity_C, -FORCE_C / np.linalg.norm(FORCE_C), atol=1e-6)
    assert failure.startswith(f"{name}: no depth image for 2 s")
    assert made.stopped


def test_colour_is_aligned_to_depth(plug) -> None:
    plug("realsense")
    found, _ = played("realsense", colour=True)
    assert all(named.has_colour for named in found)
    np.testing.assert_array_equal(found[0].frame.rgb, shots_of("realsense")[0].rgb)


@pytest.mark.parametrize("name", ["orbbec", "oak"])
def test_cameras_without_usable_colour_give_depth_alone(plug, name: str) -> None:
    plug(name)
    found, _ = played(name, colour=True)
    assert not any(named.has_colour for named in found)


def test_an_orbbec_camera_writes_no_log_into_the_working_folder(plug) -> None:
    made = plug("orbbec")
    played("orbbec")
    assert made.log == ("none", "")


def test_a_realsense_without_imu_starts_without_it(plug) -> None:
    made = plug("realsense", shots_of("realsense", with_force=False), has_imu=False)
    found, _ = played("realsense")
    assert made.started == {"depth": (640, 480, "z16", 30)}
    assert found[0].gravity_C is None


@pytest.mark.parametrize("name", ["realsense", "orbbec"])
def test_frame_sets_of_motion_alone_are_collected(plug, name: str) -> None:
    first, *_ = shots_of(name)
    plug(name, [first._replace(counts=np.zeros((0, 0), np.uint16)), first])
    found, _ = played(name)
    assert len(found) == 1
    assert found[0].gravity_C is not None


def test_an_oak_as_delivered_has_no_gravity(plug) -> None:
    # Its IMU extrinsics are zeros, so that the axes of the IMU are unknown.
    plug("oak", imu_rotation=None)
    found, _ = played("oak")
    assert found[0].gravity_C is None
    assert rotation_or_none(np.zeros((3, 3))) is None


@pytest.mark.parametrize(
    ("name", "message", "word"),
    [
        ("realsense", "No device connected", "is it plugged in"),
        ("realsense", "xioctl(VIDIOC_S_FMT) failed, errno=16 Last Error: Device or resource busy", "busy"),
        ("orbbec", "No device found", "is it plugged in"),
        ("orbbec", "uvc_open failed: resource busy", "busy"),
        ("oak", "No available devices", "is it plugged in"),
        ("oak", "Cannot connect to device, X_LINK_DEVICE_ALREADY_IN_USE", "busy"),
    ],
)
def test_missing_and_busy_cameras_are_one_line(plug, capsys, name: str, message: str, word: str) -> None:
    plug(name, error=message)
    assert main(["see", "--live", name]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith(f"treadline: {name}: ")
    assert word in said.err
    assert said.err.count("\n") == 1


@pytest.mark.parametrize("name", PACKAGES)
def test_a_missing_package_is_one_line_with_the_extra(monkeypatch: pytest.MonkeyPatch, capsys, name: str) -> None:
    monkeypatch.setitem(sys.modules, PACKAGES[name], None)  # import_module raises ModuleNotFoundError
    assert main(["see", "--live", name]) == 2
    assert capsys.readouterr().err == (
        f"treadline: --live {name} needs {PACKAGES[name]}: pip install '.[{name}]' in treadline's folder\n"
    )


def test_a_package_that_does_not_load_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "depthai.py").write_text("raise ImportError('numpy.core.multiarray failed\\nto import')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "depthai", raising=False)
    with pytest.raises(CameraError, match=r"depthai is installed but does not load: numpy\.core\.multiarray failed to import"):
        camera_by_name("oak").open(colour=False)


def test_a_distorted_image_becomes_a_pinhole_image(plug) -> None:
    camera = PinholeCamera(width_px=640, height_px=480, fx_px=400.0, fy_px=401.0, cx_px=319.0, cy_px=241.0)
    # A plane that is oblique in space has 1/z linear in the pinhole pixel; the lens moves the pixels by up to 40 px.
    K = np.array([[400.0, 0, 319.0], [0, 401.0, 241.0], [0, 0, 1]])
    v, u = np.indices((480, 640)).astype(float)
    ideal = cv2.undistortPoints(np.stack([u.ravel(), v.ravel()], axis=1)[:, None], K, np.array(fakes.DISTORTION))[:, 0]
    z_mm = (1500.0 / (1.0 + 0.3 * ideal[:, 0] + 0.2 * ideal[:, 1])).reshape(480, 640)
    plug("orbbec", [fakes.Shot(t_s=1.0, counts=np.round(z_mm).astype(np.uint16))], distorted=True)
    found, _ = played("orbbec")
    expected = 1.5 / (1.0 + 0.3 * (u - 319.0) / 400.0 + 0.2 * (v - 241.0) / 401.0)
    inside = np.s_[60:420, 80:560]
    # The nearest pixel is half a pixel off: 0.6 mm at this slope, and half a millimetre of rounding.
    np.testing.assert_allclose(found[0].frame.depth_m[inside], expected[inside], atol=2.5e-3)
    assert np.abs(1e-3 * z_mm[inside] - expected[inside]).max() > 5e-3
    assert undistortion(camera, np.zeros(8))(np.eye(480, 640, dtype=np.uint16)).sum() == 480


USED = {
    "pyrealsense2": (
        "stream.depth stream.color stream.accel format.z16 format.rgb8 config.enable_stream config.can_resolve pipeline.start "
        "pipeline.wait_for_frames pipeline.stop pipeline_wrapper align.process pipeline_profile.get_device "
        "pipeline_profile.get_stream device.first_depth_sensor depth_sensor.get_depth_scale stream_profile.as_video_stream_profile "
        "stream_profile.get_extrinsics_to video_stream_profile.get_intrinsics intrinsics.ppx extrinsics.rotation "
        "composite_frame.first_or_default composite_frame.get_depth_frame composite_frame.get_color_frame frame.get_data "
        "frame.get_timestamp frame.as_motion_frame motion_frame.get_motion_data"
    ),
    "pyorbbecsdk": (
        "Pipeline.get_stream_profile_list Pipeline.get_device Pipeline.start Pipeline.wait_for_frames Pipeline.stop OBError "
        "Config.enable_stream Config.enable_accel_stream Config.set_frame_aggregate_output_mode OBSensorType.DEPTH_SENSOR "
        "OBSensorType.COLOR_SENSOR OBSensorType.ACCEL_SENSOR OBFormat.Y16 OBFormat.RGB OBStreamType.DEPTH_STREAM "
        "OBFrameAggregateOutputMode.ANY_SITUATION AlignFilter.process FrameSet.as_frame_set FrameSet.get_depth_frame "
        "FrameSet.get_color_frame FrameSet.get_accel_frame AccelFrame.get_x AccelFrame.get_stream_profile DepthFrame.get_data "
        "DepthFrame.get_depth_scale DepthFrame.get_timestamp_us DepthFrame.get_width ColorFrame.get_format Device.get_sensor "
        "StreamProfileList.get_video_stream_profile StreamProfileList.get_default_video_stream_profile "
        "VideoStreamProfile.get_intrinsic VideoStreamProfile.get_distortion VideoStreamProfile.get_fps "
        "Context.set_logger_to_file OBLogLevel.NONE "
        "StreamProfile.get_extrinsic_to OBExtrinsic.rot OBCameraIntrinsic.cx OBCameraDistortion.k6 OBCameraDistortion.model"
    ),
    "depthai": (
        "Pipeline.create Pipeline.getDefaultDevice Pipeline.start Pipeline.stop node.StereoDepth.build "
        "node.StereoDepth.setSubpixel node.StereoDepth.depth node.IMU.enableIMUSensor node.IMU.setBatchReportThreshold "
        "node.IMU.setMaxBatchReports Node.Output.createOutputQueue MessageQueue.get MessageQueue.tryGetAll "
        "MessageQueue.QueueException ImgFrame.getFrame ImgFrame.getWidth ImgFrame.getTimestampDevice ImgFrame.getTransformation "
        "ImgTransformation.getIntrinsicMatrix Device.getConnectedIMU Device.readCalibration "
        "CalibrationHandler.getImuToCameraExtrinsics CameraBoardSocket.CAM_C IMUSensor.ACCELEROMETER_RAW IMUData.packets "
        "IMUPacket.acceleroMeter IMUReportAccelerometer.x"
    ),
}
"""Names of the vendors' packages in use; those of objects that a call returns stand under their class."""


@pytest.mark.parametrize("package", USED)
def test_an_installed_package_has_the_names_in_use(package: str) -> None:
    found = pytest.importorskip(package, exc_type=ImportError)
    for path in USED[package].split():
        value = found
        for part in path.split("."):
            assert hasattr(value, part), f"{package} has no {path}"
            value = getattr(value, part)


def test_what_a_vendor_writes_to_stdout_goes_to_stderr(plug, capfd, monkeypatch: pytest.MonkeyPatch) -> None:
    made = plug("realsense")
    start = made.pipeline.start
    monkeypatch.setattr(made.pipeline, "start", lambda self, config: os.write(1, b"load extensions\n") and start(self, config))
    assert main(["see", "--live", "realsense", "--seconds", "0.05", "--json"]) == 0
    said = capfd.readouterr()
    assert json.loads(said.out)["camera"] == "realsense"
    assert "load extensions" in said.err
