"""Rendered frames with a wrong mount or wrong IMU axes through the camera block, as in the loop and in the camera node."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scenes import RecordedDrive, ViewRecipe
from world import belts, imu_at, limits

from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.core.rotations import rotation_x, rotation_y
from treadline.core.signals import Event, HeadingMeasurement, ImuSample, StairMap, TrackReading
from treadline.mission._blocks import CameraBlock
from treadline.perception import StairDetector
from treadline.ros import channels as on
from treadline.ros.block_nodes import CameraNode
from treadline.ros.lockstep import InProcess

Take = Callable[[ImuSample | TrackReading | RgbdFrame], list[object]]
FRAME_S = 0.5


def by_the_block(detector: Any = None) -> Take:
    block = CameraBlock(detector or StairDetector())

    def take(reading: ImuSample | TrackReading | RgbdFrame) -> list[object]:
        if isinstance(reading, RgbdFrame):
            return list(block.step(reading, lambda _: True))
        block.update(reading)
        return []

    return take


def by_the_node() -> Take:
    node, bus = CameraNode(StairDetector(), limits(), 0.4), InProcess()
    node.listen(bus)
    got: list[object] = []
    for channel in (on.MEASURED, on.MAP, on.DIAGNOSTICS):
        bus.subscribe(channel, got.append)

    def take(reading: ImuSample | TrackReading | RgbdFrame) -> list[object]:
        got.clear()
        node.advance(reading.t_s)
        channel = on.IMU if isinstance(reading, ImuSample) else on.TRACKS if isinstance(reading, TrackReading) else on.CAMERA
        bus.publish(channel, reading)
        return list(got)

    return take


@dataclass
class Outcome:
    """What a drive up a flight with a wavy heading gave."""

    errors: list[tuple[float, float, float]] = field(default_factory=list)
    """Time [s], error of the heading and its sigma [rad]."""
    events: list[Event] = field(default_factory=list)
    corrections: list[float] = field(default_factory=list)
    """Corrections of earlier headings [rad], zeros left out."""
    maps: int = 0


@cache
def frames(**recipe: object) -> list[tuple[np.ndarray, float, RgbdFrame]]:
    """Return attitude, heading and frame at each half second of a drive up a flight."""
    road = RecordedDrive(
        np.random.default_rng(11),
        ViewRecipe(**{"scenes": ("up",), "steps": (48, 50), "place_m": (0.3, 0.5), "gravity_error_deg": 0.0, **recipe}),
    )
    taken = []
    for t_s in np.arange(0.0, 16.0, FRAME_S).tolist():
        heading_rad = 8.0 * DEG * math.sin(t_s / 4.0)
        pose = road.pose(0.2 * t_s, heading_rad)
        taken.append((pose.R_WB, heading_rad, road.view(t_s, pose).frame))
    return taken


def driven(take: Take, seconds: float, imu: np.ndarray | None = None, **recipe: object) -> Outcome:
    """Drive by rendered frames, with the IMU turned by ``imu`` against the chair."""
    outcome = Outcome()
    for R_WB, heading_rad, frame in frames(**recipe)[: round(seconds / FRAME_S)]:
        t_s = frame.t_s
        take(belts(t_s))
        take(imu_at(t_s, R_WB if imu is None else R_WB @ imu))
        for seen in take(frame):
            if isinstance(seen, HeadingMeasurement):
                outcome.errors.append((t_s, seen.heading_rad - heading_rad, seen.sigma_rad))
                outcome.corrections += [seen.correction_rad] if seen.correction_rad else []
            elif isinstance(seen, Event):
                outcome.events.append(seen)
            outcome.maps += isinstance(seen, StairMap)
    return outcome


@pytest.mark.parametrize(("wired", "roll_deg"), [(by_the_block, 3.0), (by_the_node, -5.0)])
def test_a_rolled_mount_is_reported_and_the_heading_stays_within_its_interval(wired: Callable[[], Take], roll_deg: float) -> None:
    rolled = (roll_deg, roll_deg)
    outcome = driven(wired(), 16.0, mount_roll_error_deg=rolled, mount_pitch_error_deg=(1.0, 1.0))
    assert [event.name for event in outcome.events] == ["imu_tilt", "camera_mount"]
    assert f"rolled by {roll_deg:+.1f}°" in outcome.events[1].cause
    # At first the sigma covers the error; after the report the heading is corrected.
    assert all(abs(error) <= 1.96 * sigma for _, error, sigma in outcome.errors)
    first_rad = abs(outcome.errors[0][1])
    assert first_rad == pytest.approx(math.sin(40.0 * DEG) * abs(roll_deg) * DEG, rel=0.1)
    after = [abs(error) for t_s, error, _ in outcome.errors if t_s >= outcome.events[1].t_s]
    # The nosing plane gives the roll within 0.1°, times sin 40°.
    assert after
    assert max(after) < 0.07 * DEG
    # The headings before were off by the first error, within a tenth: the heading error depends on the chair's pitch and heading.
    assert sum(outcome.corrections) == pytest.approx(-outcome.errors[0][1], rel=0.1)


def test_a_sound_mount_leaves_headings_as_the_detector_gives_them() -> None:
    class Bare:
        """The shipped detector with a result that the monitor does not read."""

        def __init__(self) -> None:
            self._detector = StairDetector()

        def see(self, frame: RgbdFrame, gravity_C: np.ndarray | None = None) -> object:
            seen = self._detector.see(frame, gravity_C)

            class Result:
                measurement, stair_map = seen.measurement, seen.stair_map

            return Result()

    watched, plain = driven(by_the_block(), 16.0), driven(by_the_block(Bare()), 16.0)
    assert watched.events == []
    assert len(watched.errors) > 20
    assert watched.errors == plain.errors
    assert watched.corrections == []


@pytest.mark.parametrize("imu", [rotation_x(math.pi / 2), rotation_y(-math.pi / 2), rotation_y(20.0 * DEG)])
def test_wrong_imu_axes_are_reported_with_the_angle_and_the_heading_is_not_used(imu: np.ndarray) -> None:
    outcome = driven(by_the_block(), 8.0, imu=imu)
    assert outcome.errors == []
    assert outcome.maps == 0
    # An IMU that is rolled by a quarter turn is also a camera that is.
    *others, event = outcome.events
    assert [other.name for other in others] == ["camera_calibration"] * int(imu[0, 0] == 1.0)
    assert event.name == "imu_axes"
    assert event.cause.endswith("off gravity: IMU axes?")


def test_a_faulty_calibration_is_reported_before_the_first_heading() -> None:
    block = by_the_block()

    def upside_down(reading: ImuSample | TrackReading | RgbdFrame) -> list[object]:
        if isinstance(reading, RgbdFrame):
            reading = replace(reading, depth_m=np.ascontiguousarray(reading.depth_m[::-1, ::-1]))
        return block(reading)

    outcome = driven(upside_down, 4.0)
    assert outcome.errors == []
    assert outcome.maps == 0
    (event,) = outcome.events
    assert event.name == "camera_calibration"
    assert event.cause.startswith("images are turned clockwise by 180° from gravity; turn them back")
