"""Both links on emulated chairs: motion, faults of the line, of the box and of the host, and what each error says.

Limits are judged on the clock of the box: a fault stops it 0.1 s after the stamp of the newest command that it accepted.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from threading import Thread
from types import SimpleNamespace
from unittest.mock import Mock

import pytest
from emulated_chair import LIMITS, PACE, PULLEY_M, axes_in_lockstep, drive, emulator, events_in, in_lockstep
from firmware_memory import HAS_COMPILER
from processes import wait_for

pytest.importorskip("serial", reason="pyserial is not installed: pip install 'treadline[hardware]'")
pytest.importorskip("can", reason="python-can is not installed: pip install 'treadline[hardware]'")
if not HAS_COMPILER:
    pytest.skip("no C compiler (cc, gcc or clang) on the path", allow_module_level=True)

import can
import serial

from treadline.core.errors import LinkError, SettingsError
from treadline.core.signals import ImuSample, SeatReading
from treadline.hardware import _serial_link
from treadline.hardware._can_link import CanSimpleLink
from treadline.hardware._frame import Kind, Present, frame_of
from treadline.hardware._robot_plant import CameraThread
from treadline.hardware._serial_link import SerialLink
from treadline.hardware.emulators._faults import Faults
from treadline.hardware.emulators._firmware import DriveBox, Inputs, Readings
from treadline.hardware.emulators._serial import SOUND
from treadline.hardware.emulators.camera import FrameFile
from treadline.hardware.ports import BoxReading, DriveLink, DriveState, JointLink, StickReading

HOST = """
import sys
from emulated_chair import LIMITS, drive
from treadline.hardware._serial_link import SerialLink
drive(SerialLink(port=sys.argv[1], limits=LIMITS), lambda states: False)
"""


def test_belts_joints_and_sensors_pass_a_serial_line(tmp_path: Path) -> None:
    with emulator(tmp_path / "box", "serial", "--pace", PACE) as chair:
        link = SerialLink(port=str(tmp_path / "box"), limits=LIMITS)
        assert isinstance(link, DriveLink)
        assert isinstance(link, JointLink)
        readings: list[BoxReading] = []

        def moved(states: list[DriveState]) -> bool:
            link.move(0.02, 0.0)
            return bool(states) and states[-1].left_m_s > 0.19 and states[-1].right_m_s > 0.19

        drive(link, moved, readings=readings)
        seats = [reading.stroke_m for reading in readings if isinstance(reading, SeatReading)]
        assert seats[-1] > seats[0]
        imu = next(reading for reading in readings if isinstance(reading, ImuSample))
        assert sum(part**2 for part in imu.orientation) == pytest.approx(1.0, abs=1e-3)
        assert sum(part**2 for part in imu.linear_acceleration_m_s2) ** 0.5 == pytest.approx(9.81, abs=0.5)
        link.close()
        link.close()
        wait_for(lambda: events_in(chair.lines)[-1].cause == "STOPPED")


def test_a_line_that_is_a_little_bad_stops_nothing(tmp_path: Path) -> None:
    """Half a frame, a flipped bit, frames that overtake one another, and 50 ms of delay."""
    events, states = in_lockstep(tmp_path / "box", ["half@1", "flipped@2", "swapped_frames@3=1", "late@5=0.05"], 8.0)
    assert [event.cause for event in events] == ["START", "ARMED"]
    assert states[-1].left_m_s == pytest.approx(0.2)


def test_each_fault_of_line_and_box_stops_it_in_time(tmp_path: Path) -> None:
    """A box that restarts stands until it is armed again."""
    given = ["unplugged@1=0.3", "stuck@2=0.3", "second_host@3", "brown_out@4", "late@5=0.15"]
    events, states = in_lockstep(tmp_path / "box", given, 7.0)
    stops = [event for event in events if event.cause != "ARMED"]
    assert [event.cause for event in stops] == ["START", "WATCHDOG", "WATCHDOG", "TWO_HOSTS", "START", "WATCHDOG"]
    assert all(stop.t_s - (number - 1e-9) <= 0.1 for number, stop in enumerate(stops[1:], start=1))
    assert all(event.age_ms <= 100 for event in events)
    assert "two hosts send commands to the box; stop one of them" in {state.error for state in states}
    assert "the box has started anew; check its supply" in {state.error for state in states[100:]} - {
        state.error for state in states[:100]
    }
    assert any(state.watchdog_tripped for state in states)
    assert states[-1].latched  # a re-arm that is late re-arms nothing
    assert states[-1].left_m_s == 0.0


def test_a_delay_of_300_ms_stops_the_box_and_nothing_moves_without_a_rearm(tmp_path: Path) -> None:
    events, _ = in_lockstep(tmp_path / "box", ["late@1=0.3"], 3.0)
    assert [event.cause for event in events] == ["START", "ARMED", "WATCHDOG"]
    assert events[-1].t_s <= 1.1
    events, states = in_lockstep(tmp_path / "box", ["unplugged@1=0.3"], 3.0, rearms=1)
    assert [event.cause for event in events] == ["START", "ARMED", "WATCHDOG"]
    assert all(state.left_m_s == 0.0 for state in states if (state.box_s or 0.0) > 1.3)


@pytest.mark.parametrize("end", [signal.SIGSTOP, signal.SIGKILL])
def test_a_host_that_stops_or_dies_leaves_a_box_that_stands(tmp_path: Path, end: signal.Signals) -> None:
    with emulator(tmp_path / "box", "serial", "--pace", PACE) as chair:
        paths = os.pathsep.join([str(Path(__file__).parents[1] / "builders"), *sys.path])
        host = subprocess.Popen([sys.executable, "-c", HOST, str(tmp_path / "box")], env=os.environ | {"PYTHONPATH": paths})
        wait_for(lambda: any(event.cause == "ARMED" for event in events_in(chair.lines)), within_s=120.0)
        host.send_signal(end)
        wait_for(lambda: events_in(chair.lines)[-1].cause != "ARMED")
        assert events_in(chair.lines)[-1].cause == "WATCHDOG"
        assert events_in(chair.lines)[-1].age_ms <= 100
        host.kill()
        host.wait()


@pytest.fixture
def line() -> Iterator[tuple[int, str, ExitStack]]:
    """Return the box's end of a line, the host's port, and a stack that unplugs it."""
    with ExitStack() as ends:
        near, far = os.openpty()
        for end in (near, far):
            ends.callback(os.close, end)
        yield near, os.ttyname(far), ends


def test_errors_of_a_port_are_one_line_with_the_remedy(line: tuple[int, str, ExitStack], tmp_path: Path) -> None:
    near, port, ends = line
    with pytest.raises(LinkError, match=r"none does not exist; connect the device, and look for its port with"):
        SerialLink(port=str(tmp_path / "none"), limits=LIMITS)
    link = SerialLink(port=port, limits=LIMITS)
    with pytest.raises(LinkError, match=f"{port} is in use by another program; end it, or give another port"):
        SerialLink(port=port, limits=LIMITS)
    os.write(near, frame_of(b"\x02" + bytes(76)))
    with pytest.raises(LinkError, match=r"speaks version 2 .* program version 1; write the firmware of the same release"):
        wait_for(lambda: bool(link.poll()))
    os.write(near, b"\x55\0" * 10)
    with pytest.raises(LinkError, match=r"sent no frame of a box within 2 s \(\d+ broken ones\); check the port, the bit rate"):
        wait_for(lambda: bool(link.poll()))
    ends.close()
    with pytest.raises(LinkError, match=r"the device at .* has gone .*; connect it and start again"):
        link.poll()
    link.send(0.1, 0.1)  # raises nothing: poll names the cause
    link.close()


def test_a_port_without_permission_is_one_line_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    refused = serial.SerialException(13, "could not open port: [Errno 13] Permission denied: '/dev/ttyACM0'")
    monkeypatch.setattr(serial, "Serial", Mock(side_effect=refused))
    with pytest.raises(LinkError, match=r"^/dev/ttyACM0 needs a permission: .*: sudo usermod -aG dialout \$USER$"):
        SerialLink(port="/dev/ttyACM0", limits=LIMITS)


def test_two_boxes_with_one_id_are_refused(line: tuple[int, str, ExitStack], monkeypatch: pytest.MonkeyPatch) -> None:
    """Test: a second device of the same kind. Expected: refused with the same number, unless it is a second port of the first."""

    def usb(device: str, socket: str, number: str | None) -> SimpleNamespace:
        return SimpleNamespace(device=device, vid=0x2E8A, pid=0x000A, serial_number=number, location=f"{socket}:1.0")

    for other in (usb("/dev/ttyACM9", "1-2", "E67"), usb("/dev/ttyACM9", "1-1", "E66"), usb("/dev/ttyUSB9", "1-2", None)):
        monkeypatch.setattr(_serial_link, "comports", [usb(line[1], "1-1", "E66"), other].copy)
        SerialLink(port=line[1], limits=LIMITS).close()
    monkeypatch.setattr(_serial_link, "comports", [usb(line[1], "1-1", "E66"), usb("/dev/ttyACM9", "1-2", "E66")].copy)
    with pytest.raises(LinkError, match="two devices have the USB id 2e8a:000a E66; unplug one, or give its"):
        SerialLink(port=line[1], limits=LIMITS)


@pytest.mark.parametrize(
    ("inputs", "said"),
    [
        (Inputs(dead_man=False), "the dead-man switch at the box was released"),
        (Inputs(dead_man=True, stop=True), "the stop button at the box was pressed"),
        (Inputs(dead_man=True, drive_error=0x11), "the motor drives report error 0x11"),
        (Inputs(dead_man=True), None),
    ],
)
def test_what_forbids_a_rearm_is_named(inputs: Inputs, said: str | None, line: tuple[int, str, ExitStack]) -> None:
    link, box, readings = SerialLink(port=line[1], limits=LIMITS), DriveBox(), list[BoxReading]()
    box.tick(10, inputs)
    os.write(line[0], box.frame(Readings()))
    wait_for(lambda: not readings.extend(link.poll()) and bool(readings))
    assert [reading.error for reading in readings if isinstance(reading, DriveState)] == [said]
    link.close()


def test_states_that_arrive_together_keep_their_order_in_time(line: tuple[int, str, ExitStack]) -> None:
    link, box, readings = SerialLink(port=line[1], limits=LIMITS), DriveBox(), list[BoxReading]()
    frames = [box.tick(now_ms, SOUND) and box.frame(Readings(present=Present.IMU)) for now_ms in (10, 20, 30)]
    os.write(line[0], b"".join(frames))
    wait_for(lambda: not readings.extend(link.poll()) and len(readings) == 6)
    stamps_s = [reading.t_s for reading in readings if isinstance(reading, ImuSample)]
    assert [stamp_s - stamps_s[-1] for stamp_s in stamps_s] == pytest.approx([-0.02, -0.01, 0.0])
    link.close()


def test_a_box_that_reads_nothing_does_not_keep_the_host(line: tuple[int, str, ExitStack]) -> None:
    link = SerialLink(port=line[1], limits=LIMITS)
    sender = Thread(target=lambda: [link.stop() for _ in range(10_000)], daemon=True)  # 310 kB: more than a line holds
    sender.start()
    sender.join(60.0)
    assert not sender.is_alive()
    link.close()


def test_an_emulator_shows_nothing_of_the_one_before(tmp_path: Path) -> None:
    """Neither its last frame nor its calibration, which may be of another chair."""
    for name in ("chair.frame", "chair.camera.toml"):
        (tmp_path / name).touch()
    FrameFile(tmp_path / "chair")
    assert not list(tmp_path.iterdir())


def test_a_camera_whose_clock_goes_back_is_named() -> None:
    camera = CameraThread([SimpleNamespace(frame=StickReading(t_s=t_s, speed=0.0, turn=0.0)) for t_s in (1.0, 1.1, 0.6)])
    camera.close()
    assert (camera.count, camera.error) == (2, "its clock went back by 0.50 s; connect it anew and start again")


def test_a_speed_that_is_not_a_number_stops(line: tuple[int, str, ExitStack]) -> None:
    link = SerialLink(port=line[1], limits=LIMITS)
    for speed_m_s, kind in ((float("nan"), Kind.STOP), (1e9, Kind.DRIVE)):
        link.send(speed_m_s, 0.1)
        assert os.read(line[0], 100)[2] == kind
    link.close()


def test_a_fault_that_does_not_exist_is_named() -> None:
    with pytest.raises(SettingsError, match=r"fault 'lat@3': no kind 'lat'; did you mean 'late'\?"):
        Faults(["lat@3"])
    with pytest.raises(SettingsError, match=r"fault 'late@soon' is not written as KIND, .*, for example late@3=0.15"):
        Faults(["late@soon"])


def can_link(bus: dict[str, object], **changed: float) -> CanSimpleLink:
    numbers = {"left_node": 1, "right_node": 2, "wheel_radius_m": PULLEY_M} | changed
    return CanSimpleLink(limits=LIMITS, **numbers, **bus)


def test_two_axes_on_a_can_bus_drive_and_stop_together(tmp_path: Path) -> None:
    given = ["flipped@1", "unplugged@2=0.3", "second_host@4", "brown_out@6", "late@8=0.15"]
    events, states = axes_in_lockstep(tmp_path / "sensors", given, lambda t_s, _: t_s > 9.0)
    errors = {state.error for state in states}
    assert "two hosts send commands to drive 1; stop one of them" in errors
    assert "drive 1 left closed-loop control; check its supply and errors (odrivetool)" in errors
    assert max(state.left_m_s for state in states) == pytest.approx(0.2)
    # Each re-arm proves the watchdog: it trips once while the axis stands.
    events = events[2:]  # both axes start
    causes = [event.cause for event in events if event.axis == 1]
    proved, driven = ["ARMED", "WATCHDOG", "ARMED"], ["WATCHDOG", "STOPPED", "START", "WATCHDOG"]
    assert causes[: 4 * len(driven)] == [cause for stop in driven for cause in (*proved, stop)]
    stops = [event.t_s for event in events if event.axis == 1 and event.cause != "ARMED"][1::2]
    assert all(stop_s - fault_s <= 0.1 for fault_s, stop_s in zip((2.0, 4.0, 6.0, 8.0), stops, strict=False))
    assert all(event.age_ms <= 100 for event in events if event.cause == "WATCHDOG")
    axis_2 = [event.t_s for event in events if event.axis == 2 and event.cause == "STOPPED" and event.t_s > 6.0]
    assert axis_2[0] <= 6.1  # the sound axis stops with the one that restarted


def test_axes_without_a_watchdog_are_not_armed(tmp_path: Path) -> None:
    def is_named(_: float, states: list[DriveState]) -> bool:
        return bool(states) and str(states[-1].error).startswith("drive 1 has no watchdog; set it with odrivetool")

    _, states = axes_in_lockstep(tmp_path / "sensors", ["no_watchdog@0"], is_named, rearms=1)
    assert all(state.latched and state.left_m_s == 0.0 for state in states)


def test_two_drives_with_one_id_are_named(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"two drives have the node id 1; set another one with odrivetool"):
        axes_in_lockstep(tmp_path / "sensors", ["two_with_one_id@0"], lambda t_s, _: t_s > 1.0)


def test_a_can_bus_between_processes_carries_a_drive(tmp_path: Path) -> None:
    port = 20_000 + sum(str(tmp_path).encode()) % 20_000
    bus: dict[str, object] = {"interface": "udp_multicast", "channel": "239.74.163.2", "port": port, "fd": False}
    try:
        can.Bus(**bus).shutdown()
    except (can.CanError, OSError):
        pytest.skip("no multicast on this machine")
    with emulator(tmp_path / "sensors", "can", "--udp-port", port) as chair:
        drives, sensors = can_link(bus), SerialLink(port=str(tmp_path / "sensors"))
        drive(drives, lambda _: sum(event.cause == "ARMED" for event in events_in(chair.lines)) >= 4)
        wait_for(lambda: any(isinstance(reading, ImuSample) for reading in sensors.poll()))
        drives.close()
        sensors.close()
        wait_for(lambda: events_in(chair.lines)[-1].cause != "ARMED")


@pytest.mark.parametrize("error", [0x20, 0x40])  # CAN_ERR_ACK and CAN_ERR_BUSOFF of linux/can/error.h
def test_a_report_of_the_bus_itself_is_none_of_a_drive(tmp_path: Path, error: int) -> None:
    """SocketCAN reports faults of the bus as messages whose number reads like the version of a drive."""
    bus = {"interface": "virtual", "channel": str(tmp_path)}
    with can.Bus(**bus) as drives:
        link = can_link(bus)
        drives.send(can.Message(arbitration_id=error, data=bytes(8), is_extended_id=False, is_error_frame=True))
        assert link.poll() == []
        link.close()


def test_impossible_numbers_of_a_can_link_are_one_line_with_the_remedy(tmp_path: Path) -> None:
    bus = {"interface": "virtual", "channel": str(tmp_path)}
    with pytest.raises(LinkError, match=r"wheel_radius_m is 0.0; it must be above zero: measure the belt's drive pulley"):
        can_link(bus, wheel_radius_m=0.0)
    with pytest.raises(LinkError, match=r"left_node is 2 and right_node 2; give each drive an id of its own from 0 to 63"):
        can_link(bus, left_node=2)
    with pytest.raises(LinkError, match=r"no CAN bus nonesuch .*; bring it up, or correct interface and channel"):
        can_link(bus | {"interface": "nonesuch"})
    with can.Bus(**bus) as drives:
        link = can_link(bus)
        drives.send(can.Message(arbitration_id=1 << 5, data=bytes([1, *bytes(7)]), is_extended_id=False))
        with pytest.raises(LinkError, match=r"drive 1 speaks version 1 of CANSimple, not 2; update its firmware"):
            link.poll()
        link.close()
