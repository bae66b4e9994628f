"""Common to all tests: shape checks, logs written by rosbags instead of our own writer, no deadlines on busy machines.

With ``TREADLINE_SHAPES=1`` (``make shapes``) array shapes are checked at run time in each module that declares any. That takes half
of the time of a run, whose functions are called at each of thousands of ticks. All other types are checked by mypy.
"""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest
from jaxtyping import install_import_hook

SOURCE = Path(__file__).parents[1] / "src"
sys.path.insert(0, str(Path(__file__).parent / "builders"))  # tests import the simulated world from there
sys.path.append(str(SOURCE.parent / "benchmarks"))  # scenes: random views of stairs with ground truth
WITH_SHAPES = [
    ".".join(path.relative_to(SOURCE).with_suffix("").parts)
    for path in sorted(SOURCE.glob("treadline/**/*.py"))
    if "jaxtyping" in path.read_text(encoding="utf-8")
]
"""Modules with declared array shapes."""
if os.environ.get("TREADLINE_SHAPES"):
    install_import_hook(WITH_SHAPES, "beartype.beartype")

from treadline.core.camera_images import PinholeCamera  # noqa: E402 - after the import hook

UNHURRIED = {"deadline": None, "suppress_health_check": [hypothesis.HealthCheck.too_slow]}
hypothesis.settings.register_profile("busy machine", derandomize=True, **UNHURRIED)  # the same examples each time
hypothesis.settings.load_profile("busy machine")

FAST = ("architecture/test_language.py", "control", "docs/test_decisions.py", "docs/test_reference.py", "seat", "test_settings.py")
"""Folders and files whose tests together finish within a minute on two cores: the marker ``fast``."""


SHAPES = ("control", "core", "estimation", "identification", "perception", "scenarios/test_whole_runs_touch_nothing.py", "vehicle")
"""Unit tests of modules with arrays, and one whole run per direction: the marker ``shapes``."""
SAMPLES = ("perception/test_stairs_of_all_kinds.py", "perception/test_no_stair.py")
"""Tests that repeat on many frames what others of their folder do on a few: not marked."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of ``FAST`` and ``SHAPES``."""
    tests = Path(__file__).parent
    for item in items:
        place = item.path.relative_to(tests)
        if any(place.is_relative_to(part) for part in FAST):
            item.add_marker(pytest.mark.fast)
        if any(place.is_relative_to(part) for part in SHAPES) and place.as_posix() not in SAMPLES:
            item.add_marker(pytest.mark.shapes)


START_NS = 1_700_000_000_123_456_789
"""Recordings count from 1970."""
CHANNELS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4}


class Recording:
    """Collects messages and writes them as a file of the kind that its ending says."""

    def __init__(self, *, ros1: bool = False) -> None:
        from rosbags import typesys

        self.ros1 = ros1
        self.store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_HUMBLE)
        self.messages: list[tuple[str, int, str, bytes]] = []

    def image(self, topic: str, t_s: float, pixels: np.ndarray, encoding: str, **options: Any) -> None:
        """Add an image; ``pad`` lengthens its rows."""
        height, width = pixels.shape[:2]
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(height, -1)
        rows = np.pad(rows, ((0, 0), (0, options.pop("pad", 0))))
        big = int(pixels.dtype.byteorder == ">")
        self._add(topic, "sensor_msgs/msg/Image", t_s, (height, width, encoding, big, rows.shape[1], rows.ravel()), **options)

    def calibration(self, topic: str, t_s: float, camera: PinholeCamera, **options: Any) -> None:
        region = self._type("sensor_msgs/msg/RegionOfInterest")(0, 0, 0, 0, False)
        K = np.array([camera.fx_px, 0, camera.cx_px, 0, camera.fy_px, camera.cy_px, 0, 0, 1], dtype=float)
        fields = (camera.height_px, camera.width_px, "plumb_bob", np.zeros(5), K, np.eye(3).ravel(), np.zeros(12), 0, 0, region)
        self._add(topic, "sensor_msgs/msg/CameraInfo", t_s, fields, **options)

    def imu(
        self,
        topic: str,
        t_s: float,
        orientation: Sequence[float] | None,
        rate: Sequence[float],
        force: Sequence[float],
        **options: Any,
    ) -> None:
        """Add an IMU's sample: w, x, y, z, or None if it does not measure that."""
        vector, zeros, covariance = self._type("geometry_msgs/msg/Vector3"), np.zeros(9), np.zeros(9)
        if orientation is None:
            covariance[0] = -1.0
        w, x, y, z = orientation or (0.0, 0.0, 0.0, 0.0)
        turn = self._type("geometry_msgs/msg/Quaternion")(x, y, z, w)
        self._add(topic, "sensor_msgs/msg/Imu", t_s, (turn, covariance, vector(*rate), zeros, vector(*force), zeros), **options)

    def write(self, path: Path) -> Path:
        if path.suffix == ".mcap":
            self._write_mcap(path)
        else:
            from rosbags import rosbag1, rosbag2

            with rosbag1.Writer(path) if path.suffix == ".bag" else rosbag2.Writer(path, version=9) as writer:
                connections: dict[str, Any] = {}
                for topic, logged_ns, kind, data in self.messages:
                    if topic not in connections:
                        connections[topic] = writer.add_connection(topic, kind, typestore=self.store)
                    writer.write(connections[topic], logged_ns, data)
        return path

    def _add(
        self, topic: str, kind: str, t_s: float, fields: tuple[Any, ...], logged_s: float | None = None, origin_ns: int = START_NS
    ) -> None:
        stamp_ns = origin_ns + round(t_s * 1e9)
        time = self._type("builtin_interfaces/msg/Time")(stamp_ns // 10**9, stamp_ns % 10**9)
        header = self._type("std_msgs/msg/Header")(*((7,) if self.ros1 else ()), time, "camera")
        serialise = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        data = bytes(serialise(self._type(kind)(header, *fields), kind))
        logged_ns = START_NS + round((t_s if logged_s is None else logged_s) * 1e9)
        self.messages.append((topic, logged_ns, kind, data))

    def _write_mcap(self, path: Path) -> None:
        from mcap.writer import Writer

        with path.open("wb") as file:
            writer = Writer(file)
            writer.start(profile="ros2")
            channels: dict[str, int] = {}
            for topic, logged_ns, kind, data in self.messages:
                if topic not in channels:
                    schema = writer.register_schema(kind, "ros2msg", self.store.generate_msgdef(kind, ros_version=2)[0].encode())
                    channels[topic] = writer.register_channel(topic, "cdr", schema)
                writer.add_message(channels[topic], logged_ns, data, logged_ns)
            writer.finish()

    def _type(self, name: str) -> Any:
        return self.store.types[name]


@pytest.fixture
def recording() -> type[Recording]:
    """What writes logs as others do."""
    return Recording
