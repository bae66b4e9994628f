"""Nodes of treadline on a real ROS 2, started as a user starts them, and a bystander who watches them: ``make test-ros2``."""

import importlib
import importlib.util
import math
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from processes import SHORT_FLIGHT

HAS_ROS2 = importlib.util.find_spec("rclpy") is not None and os.environ.get("TREADLINE_ROS2") == "1"
if not HAS_ROS2:
    collect_ignore_glob = ["test_*.py"]

ROLES = ("guard", "camera", "heading", "seat", "driver", "plant")
LAST_S = 90.0
"""Longest wait for anything [s]."""


def kind_of(name: str) -> Any:
    package, _, kind = name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), kind)


class Running:
    """One process of nodes, and what it says."""

    def __init__(self, log: Path, words: list[str]) -> None:
        self._log = log
        self._file = log.open("w")
        command = [sys.executable, "-m", "treadline_ros2.node", *words]
        self.process = subprocess.Popen(command, stdout=self._file, stderr=subprocess.STDOUT)

    @property
    def said(self) -> list[str]:
        return self._log.read_text().splitlines()

    def end(self, number: int = signal.SIGINT) -> int:
        if self.process.poll() is None:
            self.process.send_signal(number)
        code = self.process.wait(20)
        self._file.close()
        return code


class Bystander:
    """A node of somebody else: what it hears, by topic, and what it says and asks."""

    def __init__(self, namespace: str = "") -> None:
        import rclpy
        from rclpy.experimental.events_executor import EventsExecutor

        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=int(os.environ["ROS_DOMAIN_ID"]))
        self.node = rclpy.create_node("bystander", namespace=namespace, context=self.context)
        self._executor = EventsExecutor(context=self.context)
        self._executor.add_node(self.node)
        self.heard: dict[str, list[Any]] = {}
        self.t_s = 0.0

    def hear(self, kind: Any, topic: str, quality: Any = 100) -> list[Any]:
        heard = self.heard[topic] = []
        self.node.create_subscription(kind, topic, heard.append, quality)
        return heard

    def hear_signals(self, channel: str) -> list[Any]:
        """Hear what our nodes read of a channel."""
        from treadline.ros._codec import Decoder
        from treadline.ros.channels import CHANNELS

        decoder, signals = Decoder(channel, ros1=False), []
        for topic in CHANNELS[channel].topics_of(ros1=False):
            if topic.read:

                def take(data: bytes, name: str = topic.name) -> None:
                    signals.append(decoder.signal(name, data))

                self.node.create_subscription(kind_of(topic.kind), topic.name.lstrip("/"), take, 100, raw=True)
        self.heard[channel] = signals
        return signals

    def speaker(self, channel: str, quality: Any) -> Callable[[Any], None]:
        """Return a function that publishes signals as a driver would."""
        from treadline.ros._codec import encoded
        from treadline.ros.channels import CHANNELS

        topic = CHANNELS[channel].topics_of(ros1=False)[0]
        publisher = self.node.create_publisher(kind_of(topic.kind), topic.name.lstrip("/"), quality)
        return lambda signal: publisher.publish(encoded(channel, signal, ros1=False)[0][2])

    def watch_clock(self, topic: str = "/clock") -> None:
        from rosgraph_msgs.msg import Clock

        def tick(clock: Any) -> None:
            self.t_s = clock.clock.sec + 1e-9 * clock.clock.nanosec

        self.node.create_subscription(Clock, topic, tick, 10)

    def until(self, done: Callable[[], object], what: str, timeout_s: float = LAST_S) -> None:
        deadline = time.monotonic() + timeout_s
        while not done():
            assert time.monotonic() < deadline, f"{what}: not within {timeout_s:g} s; the clock shows {self.t_s:.2f} s"
            self._executor.spin_once(timeout_sec=0.05)

    def pause(self, lasts_s: float) -> None:
        deadline = time.monotonic() + lasts_s
        self.until(lambda: time.monotonic() >= deadline, "a pause", lasts_s + 1.0)

    def ask(self, kind: Any, service: str, request: Any, *, again_s: float = LAST_S) -> Any:
        """Return the answer of a service; a question without an answer for ``again_s`` is asked again.

        A client can see a service before the service's answers find the client: such an answer is lost for good.
        """
        client = self.node.create_client(kind, service)
        self.until(client.service_is_ready, service)
        answers: list[Any] = []
        asked_s = -math.inf

        def answered() -> bool:
            nonlocal asked_s
            if time.monotonic() - asked_s > again_s:
                asked_s = time.monotonic()
                answers.append(client.call_async(request))
            return any(answer.done() for answer in answers)

        self.until(answered, service)
        self.node.destroy_client(client)
        return next(answer.result() for answer in answers if answer.done())

    def state(self, node: str) -> str:
        from lifecycle_msgs.srv import GetState

        return str(self.ask(GetState, f"{node}/get_state", GetState.Request(), again_s=5.0).current_state.label)

    def change(self, node: str, transition: int) -> bool:
        from lifecycle_msgs.srv import ChangeState

        request = ChangeState.Request()
        request.transition.id = transition
        return bool(self.ask(ChangeState, f"{node}/change_state", request).success)

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture(scope="module", autouse=True)
def domain() -> Iterator[None]:
    """A domain of its own, on this machine alone."""
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("ROS_DOMAIN_ID", str(random.SystemRandom().randrange(1, 100)))
        environment.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        environment.delenv("RMW_IMPLEMENTATION", raising=False)
        yield


def starting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Running]]:
    """Start nodes: roles and ROS arguments; what is started is ended."""
    running: list[Running] = []
    folder = tmp_path_factory.mktemp("nodes")
    (folder / "short.toml").write_text(SHORT_FLIGHT)

    def start(*roles: str, given: tuple[str, ...] = (), sim: bool = True, autostart: bool = True) -> Running:
        parameters = {"scenario": folder / "short.toml", "use_sim_time": str(sim).lower(), "autostart": str(autostart).lower()}
        words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
        running.append(Running(folder / f"{len(running)}.txt", [*roles, "--ros-args", *words, *given]))
        return running[-1]

    yield start
    for process in running:
        process.end(signal.SIGKILL)


started, started_once = pytest.fixture(starting), pytest.fixture(starting, scope="module")


BROKEN = """
class Broken:
    follows_plan, period_s = True, 0.25

    def __init__(self, config):
        pass

    def step(self, estimate, t_s, plan):
        if plan.phase != "arrived":
            raise RuntimeError("broken on purpose")
"""


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    """A user's own controller, which fails when a traversal begins."""
    (tmp_path / "broken.py").write_text(BROKEN)
    return tmp_path / "broken.py"


def watch_for() -> Iterator[Callable[..., Bystander]]:
    made: list[Bystander] = []

    def watch(namespace: str = "") -> Bystander:
        made.append(Bystander(namespace))
        return made[-1]

    yield watch
    for bystander in made:
        bystander.close()


watching, watching_once = pytest.fixture(watch_for), pytest.fixture(watch_for, scope="module")


@pytest.fixture(scope="module")
def roles() -> tuple[str, ...]:
    return ROLES
