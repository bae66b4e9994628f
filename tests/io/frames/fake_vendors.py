"""Modules that answer as the vendors' packages do, with the frames of a list: names and signatures of their documentation.

Each ``fake_…`` function returns a module and the record of what was asked of it.
"""

from collections.abc import Iterator
from datetime import timedelta
from types import ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

MOUNTED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Rotation from the fake IMU to the camera: a quarter turn about the optical axis."""
DISTORTION = (0.1, -0.05, 0.001, -0.002, 0.02, 0.01, 0.0, 0.0)
"""Coefficients k1, k2, p1, p2, k3 to k6 of the fake lens with distortion."""


class Shot(NamedTuple):
    """What a fake camera sees at one time."""

    t_s: float
    counts: np.ndarray
    rgb: np.ndarray | None = None
    rgb_t_s: float = 0.0
    force_I: tuple[float, float, float] | None = None
    """Specific force in the IMU's axes [m/s²]."""


def module(name: str, **content: Any) -> ModuleType:
    """Return a module with this content."""
    made = ModuleType(name)
    vars(made).update(content)
    return made


def getters(**values: Any) -> SimpleNamespace:
    """Return an object with methods that return these values, whatever they are given."""
    return SimpleNamespace(**{name: lambda *_, value=value: value for name, value in values.items()})


def fake_pyrealsense2(  # noqa: C901 - a closure over its frames
    shots: Iterator[Shot], K: tuple[float, ...], *, has_imu: bool, error: str | None = None
) -> ModuleType:
    """Return pyrealsense2 with one D435i (or D435 without IMU)."""
    stream = SimpleNamespace(depth="depth", color="color", accel="accel")

    def frame(data: Any, t_s: float) -> Any:
        motion = getters(get_motion_data=SimpleNamespace(x=data[0], y=data[1], z=data[2]))
        return getters(get_data=data, get_timestamp=1e3 * t_s, as_motion_frame=motion)

    class FrameSet:
        def __init__(self, shot: Shot, *, has_images: bool = True) -> None:
            self.shot, self.has_images = shot, has_images

        def get_depth_frame(self) -> Any:
            return frame(self.shot.counts, self.shot.t_s) if self.has_images else None

        def get_color_frame(self) -> Any:
            return None if self.shot.rgb is None else frame(self.shot.rgb, self.shot.rgb_t_s)

        def first_or_default(self, kind: str) -> Any:
            assert kind == stream.accel
            return None if self.shot.force_I is None else frame(self.shot.force_I, self.shot.t_s)

    class Config:
        def __init__(self) -> None:
            self.streams: dict[str, tuple[Any, ...]] = {}

        def enable_stream(self, kind: str, *rest: Any) -> None:
            self.streams[kind] = rest

        def can_resolve(self, _wrapper: Any) -> bool:
            return has_imu or stream.accel not in self.streams

    profile = getters(
        get_intrinsics=SimpleNamespace(**dict(zip(("width", "height", "fx", "fy", "ppx", "ppy"), K, strict=True))),
        get_extrinsics_to=SimpleNamespace(rotation=MOUNTED.T.ravel().tolist(), translation=[0.0, 0.0, 0.0]),
    )
    profile.as_video_stream_profile = lambda: profile

    class Pipeline:
        def start(self, config: Config) -> Any:
            if error is not None:
                raise RuntimeError(error)
            made.started = config.streams
            device = getters(first_depth_sensor=getters(get_depth_scale=0.001))
            return getters(get_device=device, get_stream=profile)

        def wait_for_frames(self, timeout_ms: int = 5000) -> FrameSet:
            shot = next(shots, None)
            if shot is None:
                raise RuntimeError(f"Frame didn't arrive within {timeout_ms}")
            return FrameSet(shot, has_images=shot.counts.size > 0)

        def stop(self) -> None:
            made.stopped = True

    made = module(
        "pyrealsense2",
        stream=stream,
        format=SimpleNamespace(z16="z16", rgb8="rgb8"),
        config=Config,
        pipeline=Pipeline,
        pipeline_wrapper=lambda pipeline: pipeline,
        align=lambda kind: SimpleNamespace(process=lambda frames: frames, kind=kind),
        stopped=False,
    )
    return made


def fake_pyorbbecsdk(  # noqa: C901 - a closure over its frames
    shots: Iterator[Shot], K: tuple[float, ...], *, error: str | None = None, distorted: bool = False
) -> ModuleType:
    """Return pyorbbecsdk 2 with one camera that has the preferred depth stream, and colour as MJPG only."""

    class OBError(Exception):
        pass

    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    lens = dict(zip(names, DISTORTION if distorted else (0.0,) * 8, strict=True))
    profile = getters(
        get_fps=30,
        get_intrinsic=SimpleNamespace(**dict(zip(("width", "height", "fx", "fy", "cx", "cy"), K, strict=True))),
        get_distortion=SimpleNamespace(model="OBCameraDistortionModel.BROWN_CONRADY_K6", **lens),
        get_extrinsic_to=SimpleNamespace(rot=MOUNTED.astype(np.float32), transform=np.zeros(3, np.float32)),
    )

    class Profiles:
        def __init__(self, sensor: str) -> None:
            self.sensor = sensor

        def get_video_stream_profile(self, width: int, height: int, pixels: str, fps: int) -> Any:
            if self.sensor == "color" or (width, height, pixels, fps) != (640, 480, "Y16", 30):
                raise OBError("no such profile")
            return profile

        def get_default_video_stream_profile(self) -> Any:
            return profile

    def depth(shot: Shot) -> Any:
        height, width = shot.counts.shape
        return getters(
            get_data=shot.counts.astype(np.uint16).reshape(-1).view(np.uint8),
            get_width=width,
            get_height=height,
            get_depth_scale=1.0,
            get_timestamp_us=round(1e6 * shot.t_s),
        )

    def motion(force: tuple[float, float, float]) -> Any:
        return getters(get_x=force[0], get_y=force[1], get_z=force[2], get_stream_profile=profile)

    class FrameSet:
        def __init__(self, shot: Shot) -> None:
            self.shot = shot

        def get_depth_frame(self) -> Any:
            return depth(self.shot) if self.shot.counts.size else None

        def get_color_frame(self) -> None:
            return None

        def get_accel_frame(self) -> Any:
            return None if self.shot.force_I is None else motion(self.shot.force_I)

    class Pipeline:
        def __init__(self) -> None:
            if error is not None:
                raise RuntimeError(error)

        def get_device(self) -> Any:
            return SimpleNamespace(get_sensor=lambda kind: kind)

        def get_stream_profile_list(self, sensor: str) -> Profiles:
            return Profiles(sensor)

        def start(self, config: Any) -> None:
            made.started = config

        def wait_for_frames(self, _timeout_ms: int) -> FrameSet | None:
            shot = next(shots, None)
            return None if shot is None else FrameSet(shot)

        def stop(self) -> None:
            made.stopped = True

    class Config:
        def __init__(self) -> None:
            self.streams: list[Any] = []

        def enable_stream(self, profile: Any) -> None:
            self.streams.append(profile)

        def enable_accel_stream(self) -> None:
            self.streams.append("accel")

        def set_frame_aggregate_output_mode(self, mode: str) -> None:
            assert mode == "any"

    made = module(
        "pyorbbecsdk",
        OBError=OBError,
        Pipeline=Pipeline,
        Config=Config,
        OBSensorType=SimpleNamespace(DEPTH_SENSOR="depth", COLOR_SENSOR="color", ACCEL_SENSOR="accel"),
        OBFormat=SimpleNamespace(Y16="Y16", RGB="RGB"),
        OBStreamType=SimpleNamespace(DEPTH_STREAM="depth"),
        OBFrameAggregateOutputMode=SimpleNamespace(ANY_SITUATION="any"),
        AlignFilter=lambda align_to_stream: SimpleNamespace(kind=align_to_stream, process=lambda frames: frames),
        Context=SimpleNamespace(set_logger_to_file=lambda *given: setattr(made, "log", given)),
        OBLogLevel=SimpleNamespace(NONE="none"),
        stopped=False,
    )
    return made


def fake_depthai(  # noqa: C901 - a closure over its frames
    shots: Iterator[Shot], K: tuple[float, ...], *, error: str | None = None, imu_rotation: np.ndarray | None = None
) -> ModuleType:
    """Return depthai 3 with one OAK-D; without ``imu_rotation``, its IMU extrinsics are zeros, as delivered."""

    class QueueException(Exception):
        pass

    waiting: list[Shot] = []

    _, _, fx, fy, cx, cy = K
    lens = getters(getIntrinsicMatrix=[[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def image(shot: Shot) -> Any:
        height, width = shot.counts.shape
        t = timedelta(seconds=shot.t_s)
        return getters(getFrame=shot.counts, getWidth=width, getHeight=height, getTimestampDevice=t, getTransformation=lens)

    class Images:
        def get(self, timeout: timedelta) -> Any:
            assert timeout.total_seconds() > 0.0
            shot = next(shots, None)
            if shot is None:
                raise QueueException("MessageQueue was closed")
            waiting.append(shot)
            return image(shot)

    class Forces:
        def tryGetAll(self) -> list[Any]:
            taken = [shot.force_I for shot in waiting if shot.force_I is not None]
            waiting.clear()
            packets = [SimpleNamespace(acceleroMeter=SimpleNamespace(**dict(zip("xyz", force, strict=True)))) for force in taken]
            return [SimpleNamespace(packets=packets)]

    class Stereo:
        depth = SimpleNamespace(createOutputQueue=lambda **_: Images())

        def build(self, *, autoCreateCameras: bool, size: tuple[int, int], fps: float) -> "Stereo":
            made.started = (autoCreateCameras, size, fps)
            return self

        def setSubpixel(self, enable: bool) -> None:
            made.subpixel = enable

    class Imu:
        out = SimpleNamespace(createOutputQueue=lambda **_: Forces())

        def enableIMUSensor(self, sensor: str, rate_hz: int) -> None:
            assert (sensor, rate_hz) == ("accel", 100)

        def setBatchReportThreshold(self, count: int) -> None:
            assert count == 1

        def setMaxBatchReports(self, count: int) -> None:
            assert count == 10

    class Pipeline:
        def __init__(self) -> None:
            if error is not None:
                raise RuntimeError(error)

        def create(self, kind: type) -> Any:
            return kind()

        def getDefaultDevice(self) -> Any:
            X = np.zeros((4, 4))
            if imu_rotation is not None:
                X[:3, :3] = imu_rotation
            calibration = SimpleNamespace(getImuToCameraExtrinsics=lambda _socket: X.tolist())
            return SimpleNamespace(getConnectedIMU=lambda: "BNO086", readCalibration=lambda: calibration)

        def start(self) -> None:
            pass

        def stop(self) -> None:
            made.stopped = True

    made = module(
        "depthai",
        Pipeline=Pipeline,
        node=SimpleNamespace(StereoDepth=Stereo, IMU=Imu),
        MessageQueue=SimpleNamespace(QueueException=QueueException),
        CameraBoardSocket=SimpleNamespace(CAM_C="right"),
        IMUSensor=SimpleNamespace(ACCELEROMETER_RAW="accel"),
        stopped=False,
    )
    return made
