"""The ament package against a stub of rclpy's API: its life cycle, its topics, and the graph it makes."""

import sys
import tomllib
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from processes import wait_for
from scripts import module_of

import treadline
from treadline.ros import channels as on
from treadline.ros._codec import Decoder
from treadline.ros._node_signals import GuardState

PACKAGE = Path(__file__).parents[2] / "ros2" / "treadline_ros2"
NAMES = ("guard", "camera", "heading", "seat", "driver", "plant")
SCENARIO = """
[start]
place = "flight"
step = 4
[sensors]
camera = "statistical"
"""


class Bus:
    """What DDS would do."""

    def __init__(self) -> None:
        self.takers: defaultdict[str, list[tuple[type, Callable[[bytes], None]]]] = defaultdict(list)
        self.kinds: defaultdict[str, set[type]] = defaultdict(set)
        self.parameters: dict[str, Any] = {}


def stub(bus: Bus) -> dict[str, ModuleType]:  # noqa: C901 - classes, each with its methods
    """Return modules with the part of rclpy's API that the package uses, each with rclpy's own signature."""

    class Publisher:
        def __init__(self, kind: type, topic: str) -> None:
            self.kind, self.topic = kind, topic

        def publish(self, message: bytes) -> None:
            assert isinstance(message, bytes)  # rclpy takes serialised messages, too
            for kind, take in bus.takers[self.topic]:
                assert kind is self.kind, f"{self.topic}: {kind} is not {self.kind}"
                take(message)

    class LifecycleNode:
        def __init__(self, node_name: str) -> None:
            self._name = bus.parameters.get("__node", node_name)
            self._declared: dict[str, Any] = {"use_sim_time": True}

        def get_name(self) -> str:
            return self._name

        def get_logger(self) -> Any:
            return SimpleNamespace(error=bus.parameters.setdefault("errors", []).append)

        def declare_parameter(self, name: str, value: Any) -> None:
            self._declared[name] = bus.parameters.get(name, value)

        def get_parameter(self, name: str) -> Any:
            return SimpleNamespace(value=self._declared[name])

        def create_publisher(self, msg_type: type, topic: str, qos_profile: Any) -> Publisher:
            assert qos_profile.depth > 0
            bus.kinds[topic].add(msg_type)
            return Publisher(msg_type, topic)

        def create_subscription(
            self, msg_type: type, topic: str, callback: Callable[[bytes], None], qos_profile: Any, *, raw: bool = False
        ) -> Any:
            assert raw
            assert qos_profile.depth > 0
            bus.takers[topic].append((msg_type, callback))
            return topic, msg_type, callback

        def destroy_publisher(self, publisher: Publisher) -> None:
            del publisher

        def destroy_subscription(self, subscription: Any) -> None:
            topic, *taker = subscription
            bus.takers[topic].remove(tuple(taker))

        def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
            return [SimpleNamespace(topic_type=kind.NAME) for kind in bus.kinds[topic]]

        def on_activate(self, state: Any) -> str:
            del state
            return "SUCCESS"

        def on_deactivate(self, state: Any) -> str:
            del state
            return "SUCCESS"

    rclpy, lifecycle, node, qos = (ModuleType(name) for name in ("rclpy", "rclpy.lifecycle", "rclpy.lifecycle.node", "rclpy.qos"))
    lifecycle.LifecycleNode = LifecycleNode  # type: ignore[attr-defined]
    lifecycle.TransitionCallbackReturn = SimpleNamespace(SUCCESS="SUCCESS", FAILURE="FAILURE")  # type: ignore[attr-defined]
    node.LifecycleState = object  # type: ignore[attr-defined]
    qos.QoSProfile = SimpleNamespace  # type: ignore[attr-defined]
    qos.HistoryPolicy = SimpleNamespace(KEEP_LAST=1)  # type: ignore[attr-defined]
    qos.ReliabilityPolicy = SimpleNamespace(RELIABLE=1)  # type: ignore[attr-defined]
    qos.DurabilityPolicy = SimpleNamespace(TRANSIENT_LOCAL=1, VOLATILE=2)  # type: ignore[attr-defined]
    modules = {module.__name__: module for module in (rclpy, lifecycle, node, qos)}
    for channel in on.CHANNELS.values():
        for topic in channel.topics:
            package, _, name = topic.kind.split("/")
            module = modules.setdefault(f"{package}.msg", ModuleType(f"{package}.msg"))
            modules.setdefault(package, ModuleType(package))
            if not hasattr(module, name):
                setattr(module, name, type(name, (), {"NAME": topic.kind}))
    return modules


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Bus]:
    made = Bus()
    for name, module in stub(made).items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.syspath_prepend(str(PACKAGE))
    for name in ("treadline_ros2", "treadline_ros2.node", "treadline_ros2.transport"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    scenario = tmp_path / "flight.toml"
    scenario.write_text(SCENARIO)
    made.parameters["scenario"] = str(scenario)
    yield made
    for name in ("treadline_ros2", "treadline_ros2.node", "treadline_ros2.transport"):
        sys.modules.pop(name, None)


def test_lifecycle_nodes_make_a_graph_whose_guard_holds_for_one_that_is_deactivated(bus: Bus) -> None:
    from treadline_ros2.node import TreadlineNode

    bus.parameters["pace"] = 0.2  # six nodes share one interpreter here
    nodes = {}
    for name in NAMES:
        bus.parameters["__node"] = name
        nodes[name] = TreadlineNode()
        assert nodes[name].on_configure(None) == "SUCCESS", bus.parameters["errors"]
    clock, guard = Decoder(on.CLOCK, ros1=False), Decoder(on.GUARD, ros1=False)
    times, states = [0.0], [GuardState(t_s=0.0, holding=None)]
    kinds = sys.modules["rosgraph_msgs.msg"].Clock, sys.modules["diagnostic_msgs.msg"].DiagnosticArray
    bus.takers[on.CLOCK].append((kinds[0], lambda data: times.append(clock.signal(on.CLOCK, data).t_s)))
    bus.takers[on.GUARD].append((kinds[1], lambda data: states.append(guard.signal(on.GUARD, data))))
    for node in nodes.values():
        assert node.on_activate(None) == "SUCCESS"
    try:
        wait_for(lambda: times[-1] > 0.6, 180.0)
        assert states[-1].holding is None
        assert nodes["driver"].on_deactivate(None) == "SUCCESS"
        wait_for(lambda: states[-1].holding is not None, 180.0)
    finally:
        for node in nodes.values():
            assert node.on_shutdown(None) == "SUCCESS"
    assert "errors" not in bus.parameters


def test_bad_settings_leave_a_node_unconfigured_and_are_reported(bus: Bus) -> None:
    from treadline_ros2.node import TreadlineNode

    bus.parameters |= {"__node": "guard", "scenario": "nowhere"}
    assert TreadlineNode().on_configure(None) == "FAILURE"
    assert "nowhere" in bus.parameters["errors"][0]


def test_the_package_says_what_its_files_are() -> None:
    manifest = ET.parse(PACKAGE / "package.xml").getroot()  # noqa: S314 - our own file
    assert manifest.get("format") == "3"
    assert manifest.findtext("export/build_type") == "ament_python"
    name = manifest.findtext("name")
    assert (PACKAGE / "resource" / str(name)).exists()
    assert (PACKAGE / str(name) / "__init__.py").exists()
    needed = {item.text for item in manifest.findall("exec_depend")}
    used = {topic.kind.split("/")[0] for channel in on.CHANNELS.values() for topic in channel.topics}
    assert used <= needed
    ours = tomllib.loads((PACKAGE.parents[1] / "pyproject.toml").read_text())["project"]
    assert manifest.findtext("version") == treadline.__version__
    assert manifest.findtext("license") == ours["license"]


class Noted:
    """Stands for every class of ROS 2's launch: keeps what it was made of."""

    def __init__(self, *args: Any, **options: Any) -> None:
        self.args, self.options = args, options


def test_the_launch_file_starts_every_node(monkeypatch: pytest.MonkeyPatch) -> None:
    transition = type("Transition", (), {"TRANSITION_CONFIGURE": 1, "TRANSITION_ACTIVATE": 3})
    offered: dict[str, dict[str, Any]] = {
        "launch": {"LaunchDescription": lambda actions: actions},
        "launch.actions": dict.fromkeys(("DeclareLaunchArgument", "EmitEvent", "RegisterEventHandler"), Noted),
        "launch.conditions": {"IfCondition": Noted},
        "launch.events": {"matches_action": Noted},
        "launch.substitutions": {"LaunchConfiguration": Noted, "PythonExpression": Noted},
        "launch_ros": {},
        "launch_ros.actions": {"LifecycleNode": type("LifecycleNode", (Noted,), {}), "Node": type("Node", (Noted,), {})},
        "launch_ros.event_handlers": {"OnStateTransition": Noted},
        "launch_ros.events": {},
        "launch_ros.events.lifecycle": {"ChangeState": Noted},
        "lifecycle_msgs": {},
        "lifecycle_msgs.msg": {"Transition": transition},
    }
    for name, parts in offered.items():
        module = ModuleType(name)
        module.__dict__.update(parts)
        monkeypatch.setitem(sys.modules, name, module)
    launch = module_of(PACKAGE / "launch" / "graph.launch.py")
    actions = launch.generate_launch_description()
    started = [action for action in actions if type(action).__name__ == "LifecycleNode"]
    assert tuple(action.options["name"] for action in started) == NAMES
    files = [Path(action.options["parameters"][0]) for action in started]
    assert all(file.exists() for file in files)
