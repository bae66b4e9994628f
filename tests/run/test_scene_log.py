"""Scene of a run in its log: frames place the chair where the ground truth has it, and viewers find what their layouts name."""

import json
import re
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring, parse

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from wires import decoded
from world import belts, imu

import treadline
from treadline.core.ports import Truth
from treadline.core.rotations import attitude_of, rotation_of, rotation_y
from treadline.core.signals import MotionPlan
from treadline.io.mcap_log import KEPT, RunLog
from treadline.io.mcap_read import read_log
from treadline.run.recorded_run import recorded_run
from treadline.run.resolve import resolve
from treadline.run.scene_log import SceneLog
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair, DriveSettings, Scenario, Stair, Start

LAYOUTS = Path(treadline.__file__).parent / "data" / "layouts"
SCENARIO = Scenario(
    stair=Stair.model_validate({"slope_deg": 25.0, "steps": 8}),
    start=Start(place="flight", step=4, heading_deg=8.0),
    drive=DriveSettings(duration_s=1.0),
)
SEED = 3


def _recorded(folder: Path) -> Path:
    recorded_run(folder, resolve(SCENARIO, None, SEED), image_every=5)
    return folder


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _recorded(tmp_path_factory.mktemp("scene") / "run")


@pytest.fixture(scope="module")
def messages(run_folder: Path) -> dict[str, list[Any]]:
    return decoded(run_folder / "log.mcap")


@pytest.fixture(scope="module")
def truth(run_folder: Path) -> dict[float, Truth]:
    """Return the ground truth by time, to the microsecond."""
    return {round(item.t_s, 6): item for item in read_log(run_folder / "log.mcap") if isinstance(item, Truth)}


@pytest.fixture(scope="module")
def kinds(run_folder: Path) -> dict[str, str]:
    """Return the message type of each topic."""
    with (run_folder / "log.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    return {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}


def _pose(transform: Any) -> np.ndarray:
    t, q = transform.transform.translation, transform.transform.rotation
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = rotation_of(np.array([q.w, q.x, q.y, q.z])), (t.x, t.y, t.z)
    return X


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def test_the_frames_place_the_chair_where_the_ground_truth_has_it(
    truth: dict[float, Truth], messages: dict[str, list[Any]]
) -> None:
    assert len(messages["/tf"]) == 21  # 1 s at 20 Hz, both ends included
    for message in messages["/tf"]:
        at = {item.child_frame_id: item for item in message.transforms}
        assert at["odom"].header.frame_id == "world"
        X_WB = _pose(at["odom"]) @ _pose(at["base_link"])
        true = truth[round(_seconds(at["odom"].header.stamp), 6)]
        # Rounding of two products of rotations.
        np.testing.assert_allclose(X_WB[:3, 3], (true.chassis_x_m, true.chassis_y_m, true.chassis_z_m), atol=1e-9)
        attitude = attitude_of(np.array(true.yaw_rad), np.array(true.pitch_rad), np.array(true.roll_rad))
        np.testing.assert_allclose(X_WB[:3, :3], rotation_of(attitude), atol=1e-7)


def test_the_frame_tree_reaches_every_link_of_the_robot_description(messages: dict[str, list[Any]]) -> None:
    robot = fromstring(messages["/robot_description"][0].data)  # noqa: S314 - our own document
    parents = {item.child_frame_id: item.header.frame_id for item in messages["/tf_static"][0].transforms}
    parents |= {item.child_frame_id: item.header.frame_id for item in messages["/tf"][-1].transforms}
    named = [marker.header.frame_id for topic in ("/chair", "/stair/true", "/stair/seen") for marker in messages[topic][0].markers]
    used = {messages["/imu"][0].header.frame_id, messages["/camera/color/image_raw"][0].header.frame_id}
    for name in {link.get("name") for link in robot.findall("link")} | set(named) | used | {"stair"}:
        frame, seen = name, set()
        while frame in parents:
            assert frame not in seen
            seen.add(frame)
            frame = parents[frame]
        assert frame == "world"


def test_joint_states_name_the_moving_joints_and_keep_their_limits(messages: dict[str, list[Any]]) -> None:
    robot = fromstring(messages["/robot_description"][0].data)  # noqa: S314 - our own document
    limits = {
        joint.get("name"): (float(joint.find("limit").get("lower")), float(joint.find("limit").get("upper")))
        for joint in robot.findall("joint")
        if joint.get("type") == "revolute"
    }
    for message in messages["/joint_states"]:
        angles = dict(zip(message.name, message.position, strict=True))
        assert set(angles) == set(limits)
        assert all(limits[name][0] <= angle <= limits[name][1] for name, angle in angles.items())
    # The seat is level on a flight of 25° from the start.
    assert angles["seat_joint"] == pytest.approx(np.radians(25.0), abs=np.radians(2.0))
    turned = _pose(next(item for item in messages["/tf"][-1].transforms if item.child_frame_id == "seat"))
    np.testing.assert_allclose(turned[:3, :3], rotation_y(angles["seat_joint"]), atol=1e-9)


def test_detected_nosings_lie_on_the_nosings_of_the_stair(truth: dict[float, Truth], messages: dict[str, list[Any]]) -> None:
    """Test: lines in B moved by the true pose. Expected result: each end near a nosing's line; detection is centimetres at 2 m."""
    corners = np.array([(p.x, p.y, p.z) for m in messages["/stair/true"][0].markers if m.ns == "nosings" for p in m.points])
    assert messages["/stair/seen"]
    for message in messages["/stair/seen"]:
        (seen,) = message.markers
        true = truth[round(_seconds(seen.header.stamp), 6)]
        R = rotation_of(attitude_of(np.array(true.yaw_rad), np.array(true.pitch_rad), np.array(true.roll_rad)))
        ends = np.array([(p.x, p.y, p.z) for p in seen.points]) @ R.T + (true.chassis_x_m, true.chassis_y_m, true.chassis_z_m)
        for x, _, z in ends:
            assert np.hypot(corners[:, 0] - x, corners[:, 2] - z).min() < 0.06


def test_overlays_belong_to_the_kept_frames(messages: dict[str, list[Any]]) -> None:
    kept = [_seconds(image.header.stamp) for image in messages["/camera/color/image_raw"]]
    drawn = [_seconds(image.header.stamp) for image in messages["/camera/overlay/compressed"]]
    assert drawn
    assert set(drawn) <= set(kept)
    image = cv2.imdecode(np.frombuffer(bytes(messages["/camera/overlay/compressed"][0].data), np.uint8), cv2.IMREAD_COLOR)
    assert image.shape[1] == 960
    assert image.std() > 10.0  # not one colour


def test_the_log_names_its_run_and_the_same_seed_gives_the_same_bytes(run_folder: Path, tmp_path: Path) -> None:
    with (run_folder / "log.mcap").open("rb") as file:
        (record,) = list(make_reader(file).iter_metadata())
    manifest = json.loads((run_folder / "manifest.json").read_text())
    assert record.metadata["seed"] == str(SEED)
    assert record.metadata["commit"] == (manifest["git_commit"] or "")
    assert Scenario.model_validate(json.loads(record.metadata["scenario"])) == SCENARIO
    assert (_recorded(tmp_path / "again") / "log.mcap").read_bytes() == (run_folder / "log.mcap").read_bytes()


def test_plans_are_kept_at_ten_hertz_and_where_the_phase_is_new(messages: dict[str, list[Any]], tmp_path: Path) -> None:
    assert len(messages["/plan"]) == 11  # 1 s at 10 Hz, both ends included
    chair = read_chair("wheelchair")
    with RunLog(tmp_path / "log.mcap") as log, SceneLog(log, chair, Chair()) as scene:
        for k, phase in enumerate(["climb"] * 5 + ["crest"] * 5):
            scene.plan(MotionPlan(t_s=0.01 * k, phase=phase, speed_m_s=0.2))
    phases = [message.phase for message in decoded(tmp_path / "log.mcap")["/plan"]]
    assert phases == [6, 7]  # MotionPlan.msg: PHASE_CLIMB, PHASE_CREST


def test_a_recording_without_ground_truth_has_the_odometry_as_its_root(tmp_path: Path) -> None:
    with RunLog(tmp_path / "log.mcap") as log, SceneLog(log, read_chair("wheelchair"), Chair()) as scene:
        for k in range(11):
            t_s = 0.01 * k
            scene(imu(t_s), t_s)
            scene(belts(t_s, 0.5, 0.5), t_s)
    moved = [message.transforms[0] for message in decoded(tmp_path / "log.mcap")["/tf"]]
    assert [item.header.frame_id for item in moved] == ["odom"] * 2  # after 50 and 100 ms
    assert moved[-1].transform.translation.x == pytest.approx(0.05)  # 0.5 m/s for 0.1 s


def _resolves(path: str, messages: dict[str, list[Any]]) -> bool:
    """Return whether a Foxglove message path names a number in the log."""
    topic, _, inside = path.partition(".")
    value = messages[topic][0]
    for name, index in re.findall(r"(\w+)(?:\[(\d+)\])?", inside.removesuffix(".@rad2deg")):
        value = getattr(value, name)
        value = value[int(index)] if index else value
    return isinstance(value, float)


def test_every_series_of_the_foxglove_layout_is_in_the_log_and_is_what_its_label_says(messages: dict[str, list[Any]]) -> None:
    layout = json.loads((LAYOUTS / "foxglove.json").read_text())
    meant = {"true": "heading_rad", "chassis": "pitch_rad", "seat": "seat_pitch_rad", "left": "left_m_s", "right": "right_m_s"}
    meant |= {"tip-over margin": "stability_margin_rad"}
    series = [path for panel in layout["configById"].values() for path in panel.get("paths", []) if path["value"].startswith("/")]
    assert len(series) == 10
    for path in series:
        assert _resolves(path["value"], messages), path["value"]
        if path["value"].startswith("/truth"):
            assert path["value"].split(".")[1] == meant[path["label"]]
    topics = {topic for panel in layout["configById"].values() for topic in panel.get("topics", {})}
    assert topics <= set(messages)


IMAGES = {"sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"}


def test_every_curve_of_the_plotjuggler_layout_is_in_the_log(messages: dict[str, list[Any]], kinds: dict[str, str]) -> None:
    curves = [curve.get("name") for curve in parse(LAYOUTS / "plotjuggler.xml").iter("curve")]  # noqa: S314 - our own file
    assert len(curves) == 16
    for curve in curves:
        topic, field = curve.rsplit("/", 1)
        if topic not in kinds:  # PlotJuggler names the numbers of a JointState topic/name/field
            topic, name = topic.rsplit("/", 1)
            assert kinds[topic] == "sensor_msgs/msg/JointState"
            assert name in messages[topic][0].name, curve
        assert hasattr(messages[topic][0], field), curve


DISPLAYS = {
    "MarkerArray": {"visualization_msgs/msg/MarkerArray"},
    "Odometry": {"nav_msgs/msg/Odometry"},
    "RobotModel": {"std_msgs/msg/String"},
    "Image": IMAGES,
}
"""Message types of RViz 2's displays."""


def test_every_topic_of_the_rviz_layout_is_in_the_log_with_the_type_of_its_display(kinds: dict[str, str]) -> None:
    """Test: displays with a topic. Expected: its type, and for what is published once the quality of service of the log."""
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    manager = yaml.safe_load((LAYOUTS / "rviz2.rviz").read_text())["Visualization Manager"]
    topics = []
    for display in manager["Displays"]:
        package, _, kind = display["Class"].partition("/")
        assert package == "rviz_default_plugins"
        topic = display.get("Topic") or display.get("Description Topic")
        if topic is not None:
            topics.append(topic["Value"])
            assert kinds[topic["Value"]] in DISPLAYS[kind]
            assert (topic["Durability Policy"] == "Transient Local") == (topic["Value"] in KEPT)
    assert len(topics) == 6
    assert manager["Global Options"]["Fixed Frame"] == "world"
