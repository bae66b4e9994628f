"""Contract of every transport: what one node publishes arrives at others as it was, once, in order, in the delivering thread.

ROS 2's half needs its environment: ``make test-ros2`` runs it.
"""

import importlib
import os
import re
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from node_messages import CAMERA, SIGNALS, T_S
from wires import Air

from treadline.core.ports import Transport
from treadline.core.signals import OperatorInput, SeatReading, TrackCommand
from treadline.ros import channels as on
from treadline.ros.lockstep import InProcess

Ends = tuple[Transport, Transport, Callable[[], object], Transport]
"""Two nodes, what lets waiting messages arrive at the second one, and a third node."""


def in_process() -> Iterator[Ends]:
    bus = InProcess()
    first, second, third = (bus.end(f"node-{k}") for k in range(3))
    yield first, second, lambda: second.deliver(0.0), third


def wire(*, ros1: bool) -> Iterator[Ends]:
    nodes: list[Air] = []
    first, second, third = (Air(nodes=nodes, mount=CAMERA, ros1=ros1) for _ in range(3))
    yield first, second, lambda: second.deliver(0.0), third


def ros2() -> Iterator[Ends]:
    rclpy, events = importlib.import_module("rclpy"), importlib.import_module("rclpy.experimental.events_executor")
    transport = importlib.import_module("treadline_ros2.transport").RclpyTransport
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=1 + os.getpid() % 99)
    executor = events.EventsExecutor(context=context)
    nodes = [rclpy.create_node(name, context=context) for name in ("first", "second", "third")]
    for node in nodes:
        executor.add_node(node)
    first, second, third = (transport(node, lambda call, *arguments: call(*arguments), CAMERA) for node in nodes)
    yield first, second, lambda: executor.spin_once(timeout_sec=0.02), third
    executor.shutdown()
    context.try_shutdown()


WITHOUT_ROS2 = pytest.mark.skipif(os.environ.get("TREADLINE_ROS2") != "1", reason="make test-ros2 runs these")


@pytest.fixture(
    params=[
        pytest.param(in_process, id="in process"),
        pytest.param(lambda: wire(ros1=True), id="bytes of ROS 1"),
        pytest.param(lambda: wire(ros1=False), id="bytes of ROS 2"),
        pytest.param(ros2, id="ROS 2", marks=WITHOUT_ROS2),
    ]
)
def ends(request: pytest.FixtureRequest) -> Iterator[Ends]:
    yield from request.param()


def connect(ends: Ends, channel: str, signal: Any, take: Callable[[Any], object]) -> None:
    """Subscribe at the second node, and publish at the first until the second hears it: discovery takes a moment."""
    heard: list[Any] = []
    first, second, *_ = ends
    second.subscribe(channel, heard.append)
    first.announce(channel)
    arrive(ends, lambda: bool(first.publish(channel, signal)) or bool(heard))
    second.subscribe(channel, take)


def arrive(ends: Ends, have_come: Callable[[], bool]) -> None:
    """Deliver until messages have come, and ten times more for those that must not come."""
    limit_s = time.monotonic() + 30.0
    while not have_come():
        assert time.monotonic() < limit_s
        ends[2]()
    for _ in range(10):
        ends[2]()


@pytest.mark.parametrize(("channel", "signal"), SIGNALS, ids=[f"{channel} {type(signal).__name__}" for channel, signal in SIGNALS])
def test_a_signal_arrives_once_as_it_was(ends: Ends, channel: str, signal: Any) -> None:
    heard: list[tuple[int, Any]] = []
    connect(ends, channel, signal, lambda back: heard.append((threading.get_ident(), back)))
    ends[0].publish(channel, signal)
    arrive(ends, lambda: bool(heard))
    ((thread, back),) = heard
    assert (thread, type(back)) == (threading.get_ident(), type(signal))
    is_twist = getattr(ends[0], "ros1", False) and channel == on.TWIST  # a Twist has no stamp
    for field in fields(signal):
        expected = np.nan if is_twist and field.name == "t_s" else getattr(signal, field.name)
        np.testing.assert_array_equal(getattr(back, field.name), expected)


def test_no_message_of_a_sensor_or_person_is_lost_or_overtaken(ends: Ends) -> None:
    """Test: two channels by turns, each as fast as its queue allows. Expected result: all of both, in the order of their stamps."""
    heard: list[Any] = []
    seat, hand = SeatReading(t_s=T_S, pitch_rad=0.1, stroke_m=0.2), OperatorInput(t_s=T_S, dead_man=True)
    for channel, signal in ((on.SEAT, seat), (on.OPERATOR, hand)):
        connect(ends, channel, signal, heard.append)
    for k in range(10):  # the shorter of the two queues
        ends[0].publish(on.SEAT, replace(seat, t_s=float(k + 1)))
        ends[0].publish(on.OPERATOR, replace(hand, t_s=float(k + 1)))
    arrive(ends, lambda: len(heard) >= 20)
    for kind in (SeatReading, OperatorInput):
        assert [signal.t_s for signal in heard if isinstance(signal, kind)] == [float(k + 1) for k in range(10)]


def test_the_newest_command_is_the_last_that_arrives_however_many_wait(ends: Ends) -> None:
    heard: list[TrackCommand] = []
    command = TrackCommand(t_s=T_S, left_m_s=0.1, right_m_s=0.1, sender="guard-1")
    connect(ends, on.TRACKS_CMD, command, heard.append)
    for k in range(50):
        ends[0].publish(on.TRACKS_CMD, replace(command, t_s=float(k + 1)))
    arrive(ends, lambda: any(one.t_s == 50.0 for one in heard))
    stamps = [one.t_s for one in heard]
    assert stamps == sorted(set(stamps))
    assert stamps[-1] == 50.0


def test_nothing_arrives_at_a_node_that_has_left(ends: Ends) -> None:
    heard: list[Any] = []
    seat = SeatReading(t_s=T_S, pitch_rad=0.1, stroke_m=0.2)
    connect(ends, on.SEAT, seat, heard.append)
    ends[1].close()
    ends[0].publish(on.SEAT, seat)
    arrive(ends, lambda: True)
    assert heard == []


@pytest.mark.parametrize("channel", [*on.SENSORS, *on.DETECTED, on.PLAN, on.TRACKS_PROPOSED, on.GUARD])
def test_two_publishers_are_found_and_named_and_one_in_the_place_of_another_is_none(ends: Ends, channel: str) -> None:
    """Test: one node publishes, then another, then both by turns. Expected result: both are named, within 1 s of the turns."""
    causes: list[str] = []
    ends[1].on_two_sources = causes.append  # type: ignore[attr-defined]
    ends[1].subscribe(on.DIAGNOSTICS, lambda event: causes.append(event.cause))
    signal = dict(SIGNALS)[channel]
    connect(ends, channel, signal, lambda _: None)
    connect((ends[3], *ends[1:]), channel, signal, lambda _: None)
    assert causes == []
    began_s = time.monotonic()
    for node in (ends[0], ends[3], ends[0]):
        node.publish(channel, signal)
        arrive(ends, lambda: True)
    assert time.monotonic() - began_s < 1.0
    assert re.fullmatch(rf"two sources of {channel}\S*, (node-0 and node-2|/first and /third); stop one of them", causes[0])
