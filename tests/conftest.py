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
import jaxtyping
import numpy as np
import pytest
from jaxtyping import install_import_hook
from mcap.writer import Writer
from rosbags import rosbag1, rosbag2, typesys

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


SHAPES = ("control", "core", "estimation", "identification", "perception", "mission/test_flights.py", "vehicle")
"""Unit tests of modules with arrays, and one whole run per direction: the marker ``shapes``."""
SAMPLES = ("perception/test_stairs_of_all_kinds.py", "perception/test_no_stair.py")
"""Tests that repeat on many frames what others of their folder do on a few: not marked."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of ``FAST`` and ``SHAPES``; leave out those that take minutes, unless ``make slow`` asks for them."""
    tests, minutes = Path(__file__).parent, pytest.mark.skipif("TREADLINE_SLOW" not in os.environ, reason="make slow runs this")
    for item in items:
        place = item.path.relative_to(tests)
        if item.get_closest_marker("slow"):
            item.add_marker(minutes)
        if any(place.is_relative_to(part) for part in FAST):
            item.add_marker(pytest.mark.fast)
        if any(place.is_relative_to(part) for part in SHAPES) and place.as_posix() not in SAMPLES:
            item.add_marker(pytest.mark.shapes)


@pytest.fixture
def without_shape_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run without the tests' shape checks: as users do, and in a third of a whole run's time."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


START_NS = 1_700_000_000_123_456_789
"""Recordings count from 1970."""


Vector = Sequence[float]


class Recording:
    """Collects messages and writes them as a file of the kind that its ending says."""

    def __init__(self, *, ros1: bool = False) -> None:
        self.ros1 = ros1
        self.store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_HUMBLE)
        self.messages: list[tuple[str, int, str, bytes]] = []

    def image(self, topic: str, t_s: float, pixels: np.ndarray, encoding: str, **options: Any) -> None:
        """Add an image; ``pad`` lengthens its rows."""
        height, width = pixels.shape[:2]
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(height, -1)
        rows = np.pad(rows, ((0, 0), (0, options.pop("pad", 0))))
        fields = (height, width, encoding, int(pixels.dtype.byteorder == ">"), rows.shape[1], rows.ravel())
        self._add(topic, "sensor_msgs/msg/Image", t_s, fields, **options)

    def calibration(self, topic: str, t_s: float, camera: PinholeCamera, **options: Any) -> None:
        region = self._type("sensor_msgs/msg/RegionOfInterest")(0, 0, 0, 0, False)
        K = np.array([camera.fx_px, 0, camera.cx_px, 0, camera.fy_px, camera.cy_px, 0, 0, 1], dtype=float)
        fields = (camera.height_px, camera.width_px, "plumb_bob", np.zeros(5), K, np.eye(3).ravel(), np.zeros(12), 0, 0, region)
        self._add(topic, "sensor_msgs/msg/CameraInfo", t_s, fields, **options)

    def imu(self, topic: str, t_s: float, orientation: Vector | None, rate: Vector, force: Vector, **options: Any) -> None:
        """Add an IMU's sample: w, x, y, z, or None if it does not measure that."""
        vector, zeros = self._type("geometry_msgs/msg/Vector3"), np.zeros(9)
        covariance = np.array([-1.0 if orientation is None else 0.0, *zeros[1:]])
        w, *xyz = orientation or (0.0, 0.0, 0.0, 0.0)
        turn = self._type("geometry_msgs/msg/Quaternion")(*xyz, w)
        self._add(topic, "sensor_msgs/msg/Imu", t_s, (turn, covariance, vector(*rate), zeros, vector(*force), zeros), **options)

    def numbers(self, topic: str, t_s: float, values: np.ndarray) -> None:
        """Add numbers without a stamp."""
        kind, layout = "std_msgs/msg/Float64MultiArray", self._type("std_msgs/msg/MultiArrayLayout")([], 0)
        self._append(topic, kind, t_s, self._type(kind)(layout, np.array(values)))

    def write(self, path: Path, *, storage: str = "SQLITE3", packed: str = "", **options: Any) -> Path:
        """Write a file, or a folder of ROS 2.

        Args:
            storage: Files in a folder of ROS 2: SQLITE3 or MCAP.
            packed: Compression of a bag of ROS 1: BZ2 or LZ4.
            options: Of the writer of MCAP.
        """
        if path.suffix == ".mcap":
            return self._write_mcap(path, {"enable_data_crcs": True} | options)
        writer: Any = rosbag1.Writer(path)
        if path.suffix != ".bag":
            writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[storage])
        elif packed:
            writer.set_compression(rosbag1.Writer.CompressionFormat[packed])
        with writer:
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
        self._append(topic, kind, t_s if logged_s is None else logged_s, self._type(kind)(header, *fields))

    def _append(self, topic: str, kind: str, logged_s: float, message: Any) -> None:
        serialise = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        self.messages.append((topic, START_NS + round(logged_s * 1e9), kind, bytes(serialise(message, kind))))

    def _write_mcap(self, path: Path, options: dict[str, Any]) -> Path:
        language, encoding, version = ("ros1msg", "ros1", 1) if self.ros1 else ("ros2msg", "cdr", 2)
        with path.open("wb") as file:
            writer = Writer(file, **options)
            writer.start(profile=f"ros{version}")
            channels: dict[str, int] = {}
            for topic, logged_ns, kind, data in self.messages:
                if topic not in channels:
                    definition = self.store.generate_msgdef(kind, ros_version=version)[0].encode()
                    schema = writer.register_schema(kind, language, definition)
                    channels[topic] = writer.register_channel(topic, encoding, schema)
                writer.add_message(channels[topic], logged_ns, data, logged_ns)
            writer.finish()
        return path

    def _type(self, name: str) -> Any:
        return self.store.types[name]


@pytest.fixture
def recording() -> type[Recording]:
    """What writes logs as others do."""
    return Recording
