"""Vendors' packages as mocks: one camera whose pipeline yields the given shots, and then fails as an unplugged one.

Each function returns the module and the mock of its pipeline. A mock has every name; ``vendor_names.toml`` lists those in use, for
the comparison with a package that is installed.
"""

from collections.abc import Callable, Iterator
from datetime import timedelta
from types import SimpleNamespace
from typing import Any, NamedTuple
from unittest.mock import MagicMock

import numpy as np

MOUNTED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Rotation from the fake IMU to the camera: a quarter turn about the optical axis."""
Made = tuple[MagicMock, MagicMock]


class Shot(NamedTuple):
    """One exposure of a fake camera."""

    t_s: float
    counts: np.ndarray
    rgb: np.ndarray | None = None
    forces_I: tuple[tuple[float, float, float], ...] = ()
    """Specific forces since the exposure before, in the IMU's axes [m/s²]; each but the last comes without images."""


def getters(**values: Any) -> SimpleNamespace:
    """Return an object with methods that return these values."""
    return SimpleNamespace(**{name: lambda *_, value=value: value for name, value in values.items()})


def named(names: str, values: Any) -> SimpleNamespace:
    """Return an object with these fields."""
    return SimpleNamespace(**dict(zip(names.split(), values, strict=True)))


def optional(made: Callable[..., Any], data: Any, *more: Any) -> Any:
    """Return what is made of data, or None without data."""
    return None if data is None else made(data, *more)


def parts_of(shots: list[Shot]) -> Iterator[tuple[float, np.ndarray | None, np.ndarray | None, Any]]:
    """Yield time, depth, colour and force of each frame set."""
    for shot in shots:
        *alone, last = shot.forces_I or (None,)
        yield from ((shot.t_s, None, None, force) for force in alone)
        yield shot.t_s, shot.counts, shot.rgb, last


def pyrealsense2(shots: list[Shot], K: tuple[float, ...], *, has_imu: bool = True, error: Exception | None = None) -> Made:
    """Return pyrealsense2 with one D435i, or a D435 without IMU; a count is half a millimetre."""
    module = MagicMock(config=lambda: MagicMock(can_resolve=lambda _: has_imu))
    pipeline = module.pipeline.return_value
    pipeline.start.side_effect = error
    profile = pipeline.start.return_value
    profile.get_device().first_depth_sensor().get_depth_scale.return_value = 0.0005
    profile.get_stream().as_video_stream_profile().get_intrinsics.return_value = named("width height fx fy ppx ppy", K)
    profile.get_stream().get_extrinsics_to.return_value.rotation = MOUNTED.T.ravel().tolist()

    def image(data: np.ndarray, t_s: float) -> Any:
        return getters(get_data=data, get_timestamp=1e3 * t_s)

    def motion(force: Any) -> Any:
        return getters(as_motion_frame=getters(get_motion_data=named("x y z", force)))

    module.align.return_value.process = lambda frames: frames
    sets = [
        getters(
            get_depth_frame=optional(image, depth, t_s),
            get_color_frame=optional(image, rgb, t_s),
            first_or_default=optional(motion, force),
        )
        for t_s, depth, rgb, force in parts_of(shots)
    ]
    pipeline.wait_for_frames.side_effect = [*sets, RuntimeError("Frame didn't arrive within 1000")]
    return module, pipeline


def pyorbbecsdk(
    shots: list[Shot],
    K: tuple[float, ...],
    *,
    has_imu: bool = True,
    error: Exception | None = None,
    lens: Any = (0.0,) * 8,
    model: str = "BROWN_CONRADY_K6",
) -> Made:
    """Return pyorbbecsdk 2 with one camera at 15 Hz; a count is half a millimetre."""
    module = MagicMock(OBError=type("OBError", (Exception,), {}))
    module.OBFormat.RGB, pipeline = "RGB", module.Pipeline.return_value
    module.Pipeline.side_effect = error
    profiles = pipeline.get_stream_profile_list()
    profiles.get_video_stream_profile.side_effect = module.OBError("no such profile")
    profile = profiles.get_default_video_stream_profile()
    profile.get_fps.return_value = 15
    profile.get_intrinsic.return_value = named("width height fx fy cx cy", K)
    profile.get_distortion.return_value = named("model k1 k2 p1 p2 k3 k4 k5 k6", (model, *lens))
    if not has_imu:
        pipeline.get_device().get_sensor.side_effect = module.OBError("no such sensor")

    def image(data: np.ndarray, t_s: float) -> Any:
        size = {"get_width": data.shape[1], "get_height": data.shape[0], "get_format": "RGB"}
        return getters(get_data=data.reshape(-1).view(np.uint8), get_timestamp_us=1e6 * t_s, get_depth_scale=0.5, **size)

    def motion(force: Any) -> Any:
        mounted = getters(get_extrinsic_to=SimpleNamespace(rot=MOUNTED.astype(np.float32)))
        return getters(get_x=force[0], get_y=force[1], get_z=force[2], get_stream_profile=mounted)

    module.AlignFilter.return_value.process = lambda frames: getters(as_frame_set=frames)
    sets = [
        getters(
            get_depth_frame=optional(image, depth, t_s),
            get_color_frame=optional(image, rgb, t_s),
            get_accel_frame=optional(motion, force),
        )
        for t_s, depth, rgb, force in parts_of(shots)
    ]
    pipeline.wait_for_frames.side_effect = [None, *sets, module.OBError("the device is lost")]
    return module, pipeline


def depthai(shots: list[Shot], K: tuple[float, ...], *, has_imu: bool = True, error: Exception | None = None) -> Made:
    """Return depthai 3 with one OAK-D; without ``has_imu`` its IMU extrinsics are zeros, as delivered."""
    module = MagicMock()
    module.MessageQueue.QueueException = type("QueueException", (Exception,), {})
    pipeline = module.Pipeline.return_value
    pipeline.start.side_effect = error
    X = np.zeros((4, 4))
    X[:3, :3] = MOUNTED * has_imu
    pipeline.getDefaultDevice().readCalibration().getImuToCameraExtrinsics.return_value = X.tolist()
    _, _, fx, fy, cx, cy = K
    lens = getters(getIntrinsicMatrix=[[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def image(shot: Shot) -> Any:
        height, width = shot.counts.shape
        t = timedelta(seconds=shot.t_s)
        return getters(getFrame=shot.counts, getWidth=width, getHeight=height, getTimestampDevice=t, getTransformation=lens)

    node = pipeline.create.return_value
    images, forces = node.build.return_value.depth.createOutputQueue(), node.out.createOutputQueue()
    # The first image carries the intrinsics, and is not used again.
    first = [image(shots[0])] if shots else [None]
    images.get.side_effect = [*first, *map(image, shots), module.MessageQueue.QueueException("MessageQueue was closed")]
    packets = [[SimpleNamespace(acceleroMeter=named("x y z", force)) for force in shot.forces_I] for shot in shots]
    forces.tryGetAll.side_effect = [[SimpleNamespace(packets=some)] for some in packets]
    return module, pipeline
