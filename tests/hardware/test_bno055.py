"""BNO055 by UART: units, axes and faults, against an emulated sensor; numbers are those of its data sheet."""

import time
from collections.abc import Callable, Iterator

import pytest
from emulated_bno055 import EmulatedBno055
from processes import wait_for

pytest.importorskip("serial", reason="pyserial is not installed: pip install 'treadline[hardware]'")

from treadline.core.errors import LinkError
from treadline.core.signals import ImuSample
from treadline.hardware._bno055 import Bno055Link, axis_map
from treadline.hardware.ports import SensorLink

SILENT = "does not answer; cross TX and RX, check its supply, and that PS1 is high"
SAID = {"silent": SILENT, "cut": SILENT, "overrun": r"answers with status 0x07 \(0x07: bus overrun; .*\); check the line"}
SAID |= {
    "other chip": "reports chip id 0xa1, not 0xa0: another device; correct port",
    "restarted": "has no attitude: it has started",
}


@pytest.fixture
def sensor() -> Iterator[EmulatedBno055]:
    made = EmulatedBno055()
    yield made
    made.end()


def samples_of(link: Bno055Link, until: Callable[[list[ImuSample]], bool]) -> list[ImuSample]:
    found: list[ImuSample] = []
    wait_for(lambda: until(found) or bool(found.extend(link.poll())), pause_s=0.005)
    return found


def test_a_sample_has_the_units_of_the_data_sheet_and_each_answer_is_one(sensor: EmulatedBno055) -> None:
    link = Bno055Link(port=sensor.port, forward="-y")
    assert isinstance(link, SensorLink)
    samples = samples_of(link, lambda found: len(found) >= 20)
    assert samples[0].orientation == (1.0, 0.0, 0.0, -1 / 16384)
    assert samples[0].angular_velocity_rad_s == (1.0, 0.0, -0.1)
    assert samples[0].linear_acceleration_m_s2 == (0.0, -0.01, 9.81)
    stamps_s = [sample.t_s for sample in samples]
    assert stamps_s == sorted(set(stamps_s))
    assert 0.0 <= time.monotonic() - stamps_s[-1] <= 0.1
    assert tuple(sensor.registers[0x3B:0x43]) == (0x82, 0, 0x08, 0, 0, 0, 0x21, 0x04)  # rad/s and m/s², IMU mode, placement P0
    link.close()
    link.close()


def test_axes_are_the_placements_of_the_data_sheet_and_impossible_ones_are_one_line() -> None:
    placements = {  # P0 to P7 of section 3.4
        ("-y", "z"): (0x21, 0x04),
        ("x", "z"): (0x24, 0x00),
        ("-x", "z"): (0x24, 0x06),
        ("y", "z"): (0x21, 0x02),
        ("x", "-z"): (0x24, 0x03),
        ("y", "-z"): (0x21, 0x01),
        ("-y", "-z"): (0x21, 0x07),
        ("-x", "-z"): (0x24, 0x05),
    }
    assert {axes: tuple(axis_map(*axes)) for axes in placements} == placements
    for forward, up in (("x", "-x"), ("a", "z"), ("", "z"), ("xy", "z")):
        with pytest.raises(LinkError, match="give two different axes of x, -x"):
            axis_map(forward, up)


@pytest.mark.parametrize("fault", ["silent", "cut", "overrun", "other chip"])
def test_a_sensor_that_is_wrong_from_the_start_is_named(fault: str, sensor: EmulatedBno055) -> None:
    sensor.fault = fault
    with pytest.raises(LinkError, match=f"the BNO055 at {sensor.port} {SAID[fault]}"):
        Bno055Link(port=sensor.port)


@pytest.mark.parametrize("fault", ["silent", "cut", "overrun", "restarted"])
def test_a_fault_of_a_moment_costs_its_samples_and_one_of_two_seconds_is_named(fault: str, sensor: EmulatedBno055) -> None:
    link = Bno055Link(port=sensor.port)
    samples_of(link, bool)
    sensor.fault = fault
    end_s = time.monotonic() + 0.2
    assert len(samples_of(link, lambda _: time.monotonic() > end_s)) <= 1  # of an answer that was under way
    if fault != "restarted":
        sensor.fault = ""
        samples_of(link, bool)
        sensor.fault = fault
    with pytest.raises(LinkError, match=f"the BNO055 at {sensor.port} {SAID[fault]}"):
        samples_of(link, lambda _: False)
