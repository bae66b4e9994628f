"""ROS 2's wire: as rmw_zenoh writes it, without loss between processes, and a graph of processes on it."""

import math
import os
import re
import signal
import struct
import subprocess
import sys
import time
from typing import Any

import numpy as np
import pytest

from treadline.core.errors import TreadlineError
from treadline.core.signals import ImuSample, TrackCommand
from treadline.ros import channels as on

zenoh = pytest.importorskip("zenoh", reason="eclipse-zenoh is an extra (treadline[ros])")

from treadline.ros.zenoh import ZenohTransport  # noqa: E402 - after the skips

BELT_COMMAND = "RIHS01_29abb8ecc8f098b9f734f3ccdc65cc3ca40763f9829b7ff6f863c72d58d50e6c"
"""Hash that ROS 2 Kilted (rclpy 9.1.2) gives ``treadline_msgs/msg/BeltCommand``."""
PORT = 17451
ENDPOINT = f"tcp/127.0.0.1:{PORT}"


def test_the_wire_is_rmw_zenohs() -> None:
    ours = ZenohTransport("guard", endpoint=ENDPOINT, listen=True, domain=7)
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{ENDPOINT}"]')
    samples: list[Any] = []
    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber("7/**", samples.append)
        ours.announce(on.TRACKS_CMD)
        time.sleep(0.5)
        ours.publish(on.TRACKS_CMD, TrackCommand(t_s=1.5, left_m_s=0.1, right_m_s=0.2))
        deadline = time.monotonic() + 5.0
        while not samples and time.monotonic() < deadline:
            time.sleep(0.02)
        tokens = [str(reply.ok.key_expr) for reply in session.liveliness().get("@ros2_lv/**", timeout=2.0) if reply.ok]
        subscriber.undeclare()
    ours.close()
    (sample,) = samples
    assert str(sample.key_expr) == f"7/tracks/cmd/treadline_msgs::msg::dds_::BeltCommand_/{BELT_COMMAND}"
    number, sent_ns, length = struct.unpack("<qqB", sample.attachment.to_bytes()[:17])
    assert (number, length, len(sample.attachment.to_bytes())) == (1, 16, 33)
    assert abs(time.time_ns() - sent_ns) < 60e9
    # CDR: encapsulation, stamp, frame of 9 letters, two speeds, a flag, and an identity of 5 letters.
    fields = (1, 500_000_000, 10, b"base_link", 0.1, 0.2, False, 6, b"chair")
    assert sample.payload.to_bytes() == b"\x00\x01\x00\x00" + struct.pack("<iII10s2x2d?3xI6s", *fields)
    assert any(re.fullmatch(r"@ros2_lv/7/\w+/0/0/NN/%/%/guard", token) for token in tokens), tokens
    publisher = [token for token in tokens if "/MP/" in token]
    assert len(publisher) == 1
    assert "/MP/%/%/guard/%tracks%cmd/treadline_msgs::msg::dds_::BeltCommand_/RIHS01_" in publisher[0]


def test_another_type_on_a_topic_is_reported() -> None:
    ours = ZenohTransport("seat", endpoint=f"tcp/127.0.0.1:{PORT + 3}", listen=True)
    other = ZenohTransport("stranger", endpoint=f"tcp/127.0.0.1:{PORT + 3}")
    ours.subscribe(on.SEAT, lambda _: None)
    assert ours.trouble(on.SEAT) == "nobody publishes /seat/state"
    other._advertise("/seat/state", "sensor_msgs/msg/Imu", on.CHANNELS[on.IMU])
    deadline = time.monotonic() + 20.0
    while "nobody" in (ours.trouble(on.SEAT) or "") and time.monotonic() < deadline:
        time.sleep(0.05)
    assert ours.trouble(on.SEAT) == "/seat/state is published as sensor_msgs/msg/Imu; treadline_msgs/msg/SeatState is read"
    other.close()
    ours.close()


SOURCE = """
import sys, time
import numpy as np
from treadline.ros import channels as on
from treadline.ros.zenoh import ZenohTransport
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.signals import ImuSample
wire = ZenohTransport("plant", endpoint=sys.argv[1])
camera = PinholeCamera(width_px=320, height_px=240, fx_px=287.5, fy_px=287.5, cx_px=159.5, cy_px=119.5)
rgb, depth = np.full((240, 320, 3), 99, np.uint8), np.full((240, 320), 1.5, np.float32)
wire.announce(on.CAMERA)
wire.announce(on.IMU)
time.sleep(1.5)
began = time.monotonic()
for k in range(int(sys.argv[2])):
    wire.publish(on.IMU, ImuSample(t_s=k / 100, orientation=np.array([1.0, 0, 0, 0]), angular_velocity_rad_s=np.zeros(3),
                                   linear_acceleration_m_s2=np.zeros(3)))
    if k % 10 == 0:
        wire.publish(on.CAMERA, RgbdFrame(t_s=k / 100, rgb=rgb, depth_m=depth, camera=camera))
    time.sleep(max(0.0, began + (k + 1) / 100 - time.monotonic()))
time.sleep(0.5)
wire.close()
"""


def test_nothing_is_lost_between_two_processes() -> None:
    wire = ZenohTransport("guard", endpoint=f"tcp/127.0.0.1:{PORT + 1}", listen=True)
    wire.spare = 50
    samples: list[ImuSample] = []
    frames: list[Any] = []
    wire.subscribe(on.IMU, samples.append)
    wire.subscribe(on.CAMERA, frames.append)
    source = subprocess.Popen([sys.executable, "-c", SOURCE, f"tcp/127.0.0.1:{PORT + 1}", "300"])
    deadline = time.monotonic() + 60.0
    while (len(samples) < 300 or len(frames) < 30) and time.monotonic() < deadline:
        wire.deliver(0.05)
    assert source.wait(20) == 0
    wire.close()
    assert [round(100 * sample.t_s) for sample in samples] == list(range(300))
    assert [round(10 * frame.t_s) for frame in frames] == list(range(30))
    assert (frames[-1].rgb == 99).all()
    assert np.all(frames[-1].depth_m == np.float32(1.5))


def test_the_graph_drives_and_the_guard_holds_when_a_node_is_killed(start: Any, bystander: Any) -> None:
    endpoint = f"tcp/127.0.0.1:{PORT + 2}"
    graph = start("zenoh", "--pace", "0.5", "--endpoint", endpoint)
    seen = bystander(ZenohTransport("bystander", endpoint=endpoint), on.TRACKS_CMD, on.TRUTH, on.ODOM)
    seen.until(lambda: seen.t_s >= 0.1)
    first_rad = seen.heard[on.TRUTH][0][1].heading_rad
    seen.until(lambda: abs(seen.heard[on.TRUTH][-1][1].heading_rad) < 0.6 * abs(first_rad))  # it drives off at 2.5 s, and steers
    graph.kill("driver")
    killed_s = seen.t_s
    assert not any(command.brake for t_s, command in seen.heard[on.TRACKS_CMD] if t_s > 0.5)
    seen.until(lambda: seen.heard[on.TRACKS_CMD][-1][1].brake)
    held_s = seen.t_s
    seen.wire.close()
    result = graph.result()
    assert held_s - killed_s <= 0.8
    assert result["verdict"] == "held"
    places = {round(100 * place.t_s): place.p_OB for _, place in seen.heard[on.ODOM]}
    truths = [truth for _, truth in seen.heard[on.TRUTH] if round(100 * truth.t_s) in places]
    first, last = (places[round(100 * truth.t_s)] for truth in (truths[0], truths[-1]))
    driven_m = math.hypot(truths[-1].x_m - truths[0].x_m, truths[-1].y_m - truths[0].y_m)
    assert np.linalg.norm(last - first) == pytest.approx(driven_m, rel=0.4)  # it turns meanwhile, and belts slip by a third then


@pytest.mark.parametrize("stopped", ["guard", "plant"])
def test_a_process_that_is_stopped_holds_and_is_named(start: Any, bystander: Any, stopped: str) -> None:
    """Test: SIGSTOP of guard or plant for 2 s, then SIGCONT. Expected result: a plant without its guard brakes before its clock has
    gone on by 0.31 s, and says so; the guard's first command after the return is HOLD, with the standstill as its cause."""
    endpoint = f"tcp/127.0.0.1:{PORT + 4 + (stopped == 'plant')}"
    graph = start("zenoh", "--pace", "0.5", "--endpoint", endpoint)
    seen = bystander(ZenohTransport("bystander", endpoint=endpoint), on.TRACKS_CMD, on.TRACKS, on.PLANT, on.GUARD)
    seen.until(lambda: seen.t_s >= 3.0)
    pid = graph.pid(stopped)
    os.kill(pid, signal.SIGSTOP)
    time.sleep(0.1)
    seen.wire.deliver(0.05)
    sent = len(seen.heard[on.TRACKS_CMD])
    stopped_s = seen.t_s
    until = time.monotonic() + 2.0
    while time.monotonic() < until:
        seen.wire.deliver(0.05)
    if stopped == "guard":
        (fault_s,) = [state.t_s for _, state in seen.heard[on.PLANT] if state.fault is not None][:1]
        assert fault_s - stopped_s <= 0.31
        assert seen.heard[on.TRACKS][-1][1].brake_on
        assert next(state.fault for _, state in seen.heard[on.PLANT] if state.fault).startswith("no command for 0.3")
        assert len(seen.heard[on.TRACKS_CMD]) == sent
    os.kill(pid, signal.SIGCONT)
    faults = seen.heard[on.PLANT]
    seen.until(lambda: any(state.fault for _, state in faults) and len(seen.heard[on.TRACKS_CMD]) > sent + 5)
    seen.wire.close()
    assert graph.result()["verdict"] == "held"
    later = [command for _, command in seen.heard[on.TRACKS_CMD][sent:] if command.t_s > stopped_s + 0.01]  # not under way
    assert later
    assert all(command.brake for command in later)
    cause = seen.heard[on.GUARD][-1][1].holding
    if stopped == "guard":
        assert re.fullmatch(r"the loop stood still for \d\.\d s in .*", cause), cause
    else:
        assert cause == "no /clock for 0.6 s: the simulated plant stands still"
        assert all(re.match(r"the loop stood still for 2\.\d s in ", state.fault) for _, state in faults if state.fault)


def test_one_line_for_an_endpoint_that_is_none() -> None:
    with pytest.raises(TreadlineError, match="zenoh: nonsense: "):
        ZenohTransport("guard", endpoint="nonsense", listen=True)
