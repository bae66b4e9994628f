"""Both links on emulated chairs: motion, faults of the line, of the box and of the host, and what each error says.

Limits are judged on the clock of the box: a fault stops it 0.1 s after the stamp of the newest command that it accepted.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from emulated_chair import LIMITS, PACE, Emulator, drive, emulator, in_lockstep
from firmware_memory import HAS_COMPILER
from processes import wait_for

pytest.importorskip("serial", reason="pyserial is not installed: pip install 'treadline[hardware]'")
pytest.importorskip("can", reason="python-can is not installed: pip install 'treadline[hardware]'")
if not HAS_COMPILER:
    pytest.skip("no C compiler (cc, gcc or clang) on the path", allow_module_level=True)

import can

from treadline.core.errors import LinkError, SettingsError
from treadline.core.signals import ImuSample, SeatReading
from treadline.hardware._can_link import CanSimpleLink
from treadline.hardware._frame import Kind, frame_of
from treadline.hardware._serial_link import SerialLink
from treadline.hardware.emulators._faults import Faults
from treadline.hardware.ports import BoxReading, DriveLink, DriveState, JointLink

HOST = """
import sys
from emulated_chair import LIMITS, drive
from treadline.hardware._serial_link import SerialLink
drive(SerialLink(port=sys.argv[1], limits=LIMITS), lambda states: False)
"""


def faults(*written: str) -> list[str]:
    return [part for fault in written for part in ("--fault", fault)]


def stop_after(chair: Emulator, t_s: float) -> tuple[str, float]:
    """Return cause and time of the first stop after a fault."""
    event = next(event for event in chair.events if event.cause != "ARMED" and event.t_s >= t_s)
    return event.cause, event.t_s - t_s


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
        wait_for(lambda: chair.events[-1].cause == "STOPPED")


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
        wait_for(lambda: any(event.cause == "ARMED" for event in chair.events), within_s=120.0)
        host.send_signal(end)
        wait_for(lambda: chair.events[-1].cause != "ARMED")
        assert chair.events[-1].cause == "WATCHDOG"
        assert chair.events[-1].age_ms <= 100
        host.kill()
        host.wait()


def test_errors_of_a_port_are_one_line_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"no device .*; connect the box, and look for its port with"):
        SerialLink(port=str(tmp_path / "none"), limits=LIMITS)
    near, far = os.openpty()
    port = os.ttyname(far)
    link = SerialLink(port=port, limits=LIMITS)
    with pytest.raises(LinkError, match=f"{port} is in use by another program; end it, or give another port"):
        SerialLink(port=port, limits=LIMITS)
    os.write(near, frame_of(b"\x02" + bytes(76)))
    with pytest.raises(LinkError, match=r"speaks version 2 .* program version 1; write the firmware of the same release"):
        wait_for(lambda: bool(link.poll()))
    os.write(near, b"\x55\0" * 10)
    with pytest.raises(LinkError, match=r"sent no frame of a box within 2 s \(\d+ broken ones\); check the port, the bit rate"):
        wait_for(lambda: bool(link.poll()))
    os.close(near)
    os.close(far)
    with pytest.raises(LinkError, match=r"the box at .* has gone .*; connect it and start again"):
        link.poll()
    link.send(0.1, 0.1)  # raises nothing: poll names the cause
    link.close()


def test_a_speed_that_is_not_a_number_stops() -> None:
    near, far = os.openpty()
    link = SerialLink(port=os.ttyname(far), limits=LIMITS)
    link.send(float("nan"), 0.1)
    assert os.read(near, 100)[2] == Kind.STOP
    link.send(1e9, 0.1)
    assert os.read(near, 100)[2] == Kind.DRIVE
    link.close()
    os.close(near)


def test_a_fault_that_does_not_exist_is_named() -> None:
    with pytest.raises(SettingsError, match=r"fault 'lat@3': no kind 'lat'; did you mean 'late'\?"):
        Faults(["lat@3"])
    with pytest.raises(SettingsError, match=r"fault 'late' has no times; write for example late@3 or late@3=0.15"):
        Faults(["late"])


def can_bus(tmp_path: Path) -> dict[str, object]:
    """Return a bus of this test alone, where the machine carries multicast."""
    port = 20_000 + sum(str(tmp_path).encode()) % 20_000
    options: dict[str, object] = {"interface": "udp_multicast", "channel": "239.74.163.2", "port": port, "fd": False}
    try:
        can.Bus(**options).shutdown()
    except (can.CanError, OSError):
        pytest.skip("no multicast on this machine")
    return options


def can_options(bus: dict[str, object], *given: object) -> list[object]:
    return ["can", "--pace", PACE, "--channel", bus["channel"], "--udp-port", bus["port"], *given]


def can_link(bus: dict[str, object], **changed: float) -> CanSimpleLink:
    numbers = {"left_node": 1, "right_node": 2, "wheel_radius_m": 0.07} | changed
    return CanSimpleLink(limits=LIMITS, **numbers, **bus)


def test_two_axes_on_a_can_bus_drive_and_stop_together(tmp_path: Path) -> None:
    bus = can_bus(tmp_path)
    given = faults("flipped@1", "unplugged@1.5=0.3", "second_host@3.5", "brown_out@5.5")
    with emulator(tmp_path / "box", *can_options(bus, *given)) as chair:
        link = can_link(bus)
        assert isinstance(link, DriveLink)

        def is_over(states: list[DriveState]) -> bool:
            return bool(states) and any(event.t_s > 5.5 and event.axis == 2 and event.cause == "STOPPED" for event in chair.events)

        states = drive(link, is_over)
        errors = {state.error for state in states}
        assert "two hosts send commands to drive 1; stop one of them" in errors
        assert any(error is not None and error.startswith("drive 1 left closed-loop control") for error in errors)
        # Each re-arm proves the watchdog: before the first drive, after the unplugged line, and after the second host.
        assert [event.cause for event in chair.events if event.axis == 1].count("WATCHDOG") >= 1 + 3
        cause, after_s = stop_after(chair, 1.5)
        assert cause == "WATCHDOG"
        assert after_s <= 0.1
        assert all(event.age_ms <= 100 for event in chair.events if event.cause == "WATCHDOG")
        assert max(state.left_m_s for state in states) == pytest.approx(0.2, abs=0.02)
        link.close()


@pytest.mark.parametrize(
    ("fault", "error"),
    [
        ("no_watchdog", "drive 1 has no watchdog; set it with odrivetool"),
        ("two_with_one_id", "two drives have the node id 1; set another one"),
    ],
)
def test_drives_that_must_not_be_armed_are_not(tmp_path: Path, fault: str, error: str) -> None:
    bus = can_bus(tmp_path)
    with emulator(tmp_path / "box", *can_options(bus, *faults(f"{fault}@0"))) as chair:
        link = can_link(bus)
        try:
            states = drive(link, lambda states: bool(states) and states[-1].error is not None and "report" not in states[-1].error)
            found = str(states[-1].error)
            assert all(state.latched for state in states)
        except LinkError as raised:
            found = str(raised)
        assert found.startswith(error)
        assert all(event.age_ms <= 100 or event.cause != "ARMED" for event in chair.events)
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
