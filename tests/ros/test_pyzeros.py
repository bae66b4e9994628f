"""Another implementation of ROS 2's wire, pyzeros, hears our commands and is heard by our nodes, with our own message types."""

import time
from dataclasses import dataclass, field

import pytest

pyzeros = pytest.importorskip("pyzeros", reason="pyzeros is not installed")
zenoh = pytest.importorskip("zenoh", reason="eclipse-zenoh is an extra (treadline[ros])")

from pyzeros.sub import RawSub  # noqa: E402 - after the skips
from ros2_pyterfaces.cyclone.all_msgs import Header  # noqa: E402 - after the skips
from ros2_pyterfaces.cyclone.idl import IdlStruct, types  # noqa: E402 - the same

from treadline.core.signals import OperatorInput, TrackCommand  # noqa: E402 - the same
from treadline.ros import channels as on  # noqa: E402 - the same
from treadline.ros.zenoh import ZenohTransport  # noqa: E402 - the same

ENDPOINT = "tcp/127.0.0.1:17471"


@dataclass
class BeltCommand(IdlStruct, typename="treadline_msgs/msg/BeltCommand"):
    header: Header = field(default_factory=Header)
    left_m_s: types.float64 = 0.0
    right_m_s: types.float64 = 0.0
    brake: bool = False
    sender: str = ""


@dataclass
class Handset(IdlStruct, typename="treadline_msgs/msg/OperatorInput"):
    header: Header = field(default_factory=Header)
    dead_man: bool = False
    stop: bool = False
    rearm: bool = False
    flight_ends: bool = False
    go_back: bool = False


def test_pyzeros_hears_our_commands_and_is_heard() -> None:
    ours = ZenohTransport("guard", endpoint=ENDPOINT, listen=True)
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{ENDPOINT}"]')
    heard: list[bytes] = []
    pressed: list[OperatorInput] = []
    ours.subscribe(on.OPERATOR, pressed.append)
    ours.announce(on.TRACKS_CMD)
    with zenoh.open(config) as session, pyzeros.auto_context(node="stranger", zenoh_session=session, domain_id=0) as node:
        theirs = RawSub(BeltCommand, "/tracks/cmd", lambda sample: heard.append(sample.payload.to_bytes()), session=node)
        handset = pyzeros.Pub(Handset, "/operator", session=node)
        deadline = time.monotonic() + 20.0
        while not (heard and pressed) and time.monotonic() < deadline:
            ours.publish(on.TRACKS_CMD, TrackCommand(t_s=1.5, left_m_s=0.1, right_m_s=0.2, sender="guard-1"))
            handset.publish(Handset(header=Header(), dead_man=True, go_back=True))
            ours.deliver(0.1)
            time.sleep(0.05)  # a flood of messages keeps the threads that hear them from running
        theirs.close()
    ours.close()
    command = BeltCommand.deserialize(heard[0])
    assert (command.left_m_s, command.right_m_s, command.brake, command.sender) == (0.1, 0.2, False, "guard-1")
    assert (command.header.stamp.sec, command.header.stamp.nanosec, command.header.frame_id) == (1, 500_000_000, "base_link")
    assert pressed[0] == OperatorInput(t_s=0.0, dead_man=True, go_back=True)
