"""What one link has and others do not, beyond ``test_drive_contract``: ports, versions, joints, axes; and what each error says."""

import os
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from threading import Event, Thread
from types import SimpleNamespace
from unittest.mock import Mock

import pytest
from emulated_chair import LIMITS, PULLEY_M, can_rig, unthreaded
from firmware_memory import HAS_COMPILER
from processes import wait_for

pytest.importorskip("serial", reason="pyserial is not installed: pip install 'treadline[hardware]'")
pytest.importorskip("can", reason="python-can is not installed: pip install 'treadline[hardware]'")
if not HAS_COMPILER:
    pytest.skip("no C compiler (cc, gcc or clang) on the path", allow_module_level=True)

import can
import serial

from treadline.core.errors import LinkError, SettingsError
from treadline.core.signals import ImuSample
from treadline.hardware import _can_link, _serial_link
from treadline.hardware._can_link import CanSimpleLink
from treadline.hardware._frame import Present, frame_of
from treadline.hardware._robot_plant import CameraThread
from treadline.hardware._serial_link import SerialLink
from treadline.hardware.device_threads import ARRIVED, WAITING, DeviceThreads
from treadline.hardware.emulators._faults import Faults
from treadline.hardware.emulators._firmware import DriveBox, Inputs, Readings
from treadline.hardware.emulators._serial import SOUND
from treadline.hardware.emulators.camera import FrameFile
from treadline.hardware.ports import BoxReading, DriveState, StickReading


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
    os.write(near, b"\x55\0" * 10)
    with pytest.raises(LinkError, match=r"sent no frame of a box within 2 s \(\d+ broken ones\); check the port, the bit rate"):
        wait_for(lambda: bool(link.poll()))
    ends.close()
    wait_for(lambda: link._line._threads._error)
    with pytest.raises(LinkError, match=r"the device at .* has gone .*; connect it and start again"):
        link.poll()
    link.send(0.1, 0.1)  # raises nothing: poll names the cause
    link.close()


def test_a_box_of_another_version_is_named(line: tuple[int, str, ExitStack]) -> None:
    link = SerialLink(port=line[1], limits=LIMITS)
    os.write(line[0], frame_of(b"\x01" + bytes(76)))
    with pytest.raises(LinkError, match=r"speaks version 1 .* program version 2; write the firmware of the same release"):
        wait_for(lambda: bool(link.poll()))
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


@pytest.mark.parametrize("side", ["reader", "writer"])
def test_a_thread_that_ends_is_named_after_what_had_arrived(side: str) -> None:
    items, broken = iter([b"first", b"second"]), Mock(side_effect=RuntimeError("no driver"))
    receive = Mock(side_effect=lambda _: next(items, None) or (broken() if side == "reader" else None))
    threads: DeviceThreads[bytes, bytes] = DeviceThreads(receive, broken, lambda error: f"the device has gone ({error})")
    threads.write(b"command")
    wait_for(lambda: receive.call_count > 2 and broken.called and threads._error)
    assert [item for _, item in threads.read()] == [b"first", b"second"]
    with pytest.raises(LinkError, match=r"^the device has gone \(no driver\)$"):
        threads.read()
    threads.close()


def test_a_device_that_waits_keeps_nobody_waiting_and_then_gets_the_newest_command_alone() -> None:
    """Test: a device that neither reads nor writes for a moment. Expected: stamps of arrival; of 1,000 commands those in hand."""
    waits, written = Event(), list[int]()
    threads: DeviceThreads[bytes, int] = DeviceThreads(
        lambda _: waits.wait() and b"state", lambda item: (waits.wait(), written.append(item)), str
    )
    began_s = time.monotonic()
    for number in range(1000):
        threads.write(number)
    assert time.monotonic() - began_s < 0.1
    waits.set()
    threads.close()
    assert written[-1] == 999
    assert len(written) <= 1 + WAITING
    arrived = threads.read()
    assert 0 < len(arrived) <= ARRIVED
    assert all(began_s <= t_s <= time.monotonic() for t_s, _ in arrived)


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


def test_a_fault_that_does_not_exist_is_named() -> None:
    with pytest.raises(SettingsError, match=r"fault 'lat@3': no kind 'lat'; did you mean 'late'\?"):
        Faults(["lat@3"])
    with pytest.raises(SettingsError, match=r"fault 'late@soon' is not written as KIND, .*, for example late@3=0.15"):
        Faults(["late@soon"])


def can_link(bus: dict[str, object], **changed: float) -> CanSimpleLink:
    numbers = {"left_node": 1, "right_node": 2, "wheel_radius_m": PULLEY_M} | changed
    with unthreaded():
        return CanSimpleLink(limits=LIMITS, **numbers, **bus)


def test_each_rearm_of_the_axes_proves_their_watchdogs_and_an_axis_stops_with_the_other(tmp_path: Path) -> None:
    rig = can_rig(tmp_path, "brown_out@2")  # of axis 1
    rig.rearm()
    rig.run(2.0)
    rig.link.close()
    causes = [[event.cause for event in rig.events if event.axis == axis] for axis in (1, 2)]
    # Both start; the watchdog trips once while the axis stands.
    assert [found[:4] for found in causes] == [["START", "ARMED", "WATCHDOG", "ARMED"]] * 2
    assert next(event.t_s for event in rig.events if event.axis == 2 and event.cause == "STOPPED") <= 2.1


def test_axes_without_a_watchdog_are_not_armed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = can_rig(tmp_path, "no_watchdog@0")
    monkeypatch.setattr(_can_link, "time", SimpleNamespace(monotonic=lambda: rig.chair.t_s))
    rig.rearm()
    states = rig.run(3.0)
    assert all(state.latched and state.left_m_s == 0.0 for state in states)
    assert str(states[-1].error).startswith("drive 1 has no watchdog; set it with odrivetool")


def test_two_drives_with_one_id_are_named(tmp_path: Path) -> None:
    rig = can_rig(tmp_path, "two_with_one_id@0")
    with pytest.raises(LinkError, match=r"two drives have the node id 1; set another one with odrivetool"):
        rig.run(1.0)
    rig.link.close()


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
