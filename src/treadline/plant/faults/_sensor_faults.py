"""Sensor faults: modification of readings between the plant and the mission.

Each fault maps one reading to zero, one or two readings. Without images (``camera = "statistical"``) an image fault modifies the
detector output and the frame quality accordingly. A false edge then has no effect: in rendered frames a bar of -15 to 30° changes
the heading by less than 0.05°.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import accumulate
from operator import itemgetter
from typing import Any, get_args

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.core.ports import Reading
from treadline.core.rotations import quaternion_of, rotation_of, rotation_z
from treadline.core.signals import (
    BUTTONS,
    ROUNDING_S,
    TICK_S,
    FlipperReading,
    FrameQuality,
    FreeGround,
    HeadingMeasurement,
    ImuSample,
    OperatorInput,
    SeatReading,
    StairMap,
    TrackReading,
)
from treadline.plant.sensors.camera import RenderedFrame
from treadline.scenario.faults import Fault, FaultKind, Process
from treadline.scenario.operator_actions import REPORT_TICKS, OperatorAct, does

CAMERA_READINGS = (RgbdFrame, FrameQuality, HeadingMeasurement, StairMap, FreeGround)
"""Types of camera readings."""
DEPTH_ENOUGH = 0.4
"""Valid fraction of a depth image above which the colours are not evaluated, as in ``perception.quality``."""
BLOTCH_PX = 12
"""Size of the smallest hole in the depth image [px]: lost returns are spatially correlated."""
JUMP_LEAST_DEG, JUMP_S = 5.0, 0.1
"""Magnitude above which an IMU bias is a jump [deg], and duration of the jump [s]: the gyro range of 2000 °/s excludes 30° in one
sample."""

Passed = tuple[Reading, ...]
"""Readings after a fault."""


class SensorFault:
    """Model of one sensor fault.

    Args:
        place: Index among the faults of the same kind; each has its own random numbers at each instant.
    """

    def __init__(self, fault: Fault, seed: int, place: int) -> None:
        self.fault = fault
        self.last: dict[type, Reading] = {}
        """Last reading of each type before the fault."""
        self._stream = [seed, get_args(FaultKind).index(fault.kind), place]

    def step(self, reading: Reading) -> Passed:
        """Return the readings that replace a reading."""
        if self.fault.active(reading.t_s):
            return CORRUPTIONS[self.fault.kind](self, reading)
        self.last[type(reading)] = reading
        return (reading,)

    def chance(self, t_s: float) -> np.random.Generator:
        """Return the random generator of one instant."""
        return np.random.default_rng([*self._stream, round(t_s / TICK_S)])


Corruption = Callable[[SensorFault, Any], Passed]
"""Function from a reading to the readings that replace it."""


def _only(kinds: type | tuple[type, ...], corrupt: Corruption, fault_model: SensorFault, reading: Reading) -> Passed:
    """Apply a fault to readings of some types; the others pass unmodified."""
    return corrupt(fault_model, reading) if isinstance(reading, kinds) else (reading,)


def _lost(_: SensorFault, __: Reading) -> Passed:
    return ()


def _stuck(fault_model: SensorFault, reading: Reading) -> Passed:
    """Repeat the last reading before the fault, or the first during the fault, with new stamps."""
    return (restamped(fault_model.last.setdefault(type(reading), reading), reading.t_s),)


def _killed(fault_model: SensorFault, reading: Reading) -> Passed:
    """Suppress camera readings if the perception process is stopped; other processes do not affect sensors."""
    return _only(CAMERA_READINGS if fault_model.fault.size == Process.PERCEPTION else (), _lost, fault_model, reading)


def _dark(fault_model: SensorFault, reading: Reading) -> Passed:
    """Scale the brightness of the colours, with noise; with a negative ``value`` also remove the depth."""
    factor, blind = abs(fault_model.fault.size), fault_model.fault.size < 0.0
    match reading:
        case RgbdFrame():
            # Rendered on first access, with a generator of this instant, so that access does not affect other frames.
            painter = partial(_lit, reading, factor, fault_model.chance(reading.t_s))
            depth_m = np.full_like(reading.depth_m, np.nan) if blind else reading.depth_m
            return (RenderedFrame(t_s=reading.t_s, depth_m=depth_m, camera=reading.camera, painter=painter),)
        case FrameQuality() if blind or reading.valid_share < DEPTH_ENOUGH:
            faded = replace(
                reading, brightness=min(reading.brightness * factor, 1.0), contrast=reading.contrast * min(factor, 1 / factor)
            )
            return (replace(faded, valid_share=0.0) if blind else faded,)
        case HeadingMeasurement() | StairMap() | FreeGround() if blind:
            return ()
    return (reading,)


def _holes(fault_model: SensorFault, reading: Reading) -> Passed:
    """Remove blotches of the depth image; without images, drop detections with the same probability."""
    share = fault_model.fault.size
    match reading:
        case RgbdFrame():
            lost = blotches(reading.depth_m.shape, share, fault_model.chance(reading.t_s))
            depth_m = np.where(lost, np.float32(np.nan), reading.depth_m)
            return (RenderedFrame(t_s=reading.t_s, depth_m=depth_m, camera=reading.camera, painter=partial(_colours, reading)),)
        case FrameQuality():
            return (replace(reading, valid_share=(1.0 - share) * reading.valid_share),)
        case HeadingMeasurement() | StairMap() | FreeGround() if fault_model.chance(reading.t_s).random() < share:
            return ()
    return (reading,)


def _imu_nan(_: SensorFault, reading: ImuSample) -> Passed:
    nothing = (math.nan, math.nan, math.nan)
    return (replace(reading, orientation=(math.nan, *nothing), angular_velocity_rad_s=nothing, linear_acceleration_m_s2=nothing),)


def _imu_bias(fault_model: SensorFault, reading: ImuSample) -> Passed:
    """Add a constant rate or a jump to the gyro, and the corresponding yaw to the attitude."""
    since_s, size = reading.t_s - fault_model.fault.at_s, fault_model.fault.size * DEG
    if abs(fault_model.fault.size) < JUMP_LEAST_DEG:
        rate, turned = size, size * (since_s + TICK_S)
    else:
        rate = size / JUMP_S if since_s < JUMP_S - ROUNDING_S else 0.0
        turned = size * min((since_s + TICK_S) / JUMP_S, 1.0)
    return (_turning(reading, rate, turned),)


def _gyro_ramp(fault_model: SensorFault, reading: ImuSample) -> Passed:
    """Add a rate that grows linearly to the gyro, and the corresponding yaw to the attitude."""
    since_s = reading.t_s - fault_model.fault.at_s
    growth = fault_model.fault.size * DEG / fault_model.fault.for_s
    return (_turning(reading, growth * since_s, 0.5 * growth * since_s * (since_s + TICK_S)),)


def _turning(reading: ImuSample, rate_rad_s: float, turned_rad: float) -> ImuSample:
    """Return a sample with an additional false rotation about the chair's z axis."""
    orientation = quaternion_of(rotation_z(turned_rad) @ rotation_of(reading.orientation))
    x, y, z = reading.angular_velocity_rad_s
    return replace(reading, orientation=tuple(orientation.tolist()), angular_velocity_rad_s=(x, y, z + rate_rad_s))


def _person_stops(fault_model: SensorFault, reading: OperatorInput) -> Passed:
    return (replace(reading, dead_man=False) if fault_model.fault.size == 1.0 else replace(reading, stop=True),)


def _clock_back(fault_model: SensorFault, reading: Reading) -> Passed:
    """Shift the stamps back; each reading is delivered twice."""
    earlier = restamped(reading, reading.t_s - fault_model.fault.size)
    return (earlier, earlier)


CORRUPTIONS: dict[FaultKind, Corruption] = {
    "camera_frozen": partial(_only, CAMERA_READINGS, _stuck),
    "depth_holes": _holes,
    "camera_dark": _dark,
    "camera_lost": partial(_only, CAMERA_READINGS, _lost),
    "imu_bias": partial(_only, ImuSample, _imu_bias),
    "gyro_ramp": partial(_only, ImuSample, _gyro_ramp),
    "imu_stuck": partial(_only, ImuSample, _stuck),
    "imu_nan": partial(_only, ImuSample, _imu_nan),
    "imu_lost": partial(_only, ImuSample, _lost),
    "readings_lost": partial(_only, (TrackReading, SeatReading, FlipperReading), _lost),
    "process_killed": _killed,
    "operator_stop": partial(_only, OperatorInput, _person_stops),
    "link_lost": partial(_only, OperatorInput, _lost),
    "clock_back": _clock_back,
}
"""Functions of the faults, in order of application: ``_dark`` uses the remaining depth; the clock is last, because the other faults
use true time."""


OF_THE_HANDSET: tuple[FaultKind, ...] = ("operator_stop", "link_lost")
"""Kinds of faults that need an operator with a handset."""


def _order(model: SensorFault) -> int:
    return list(CORRUPTIONS).index(model.fault.kind)


class Burst:
    """Buffer that delays readings while the mission's computer is stalled, and delivers them in bursts."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault
        self._held: list[Reading] = []
        self._count = 0

    def deliver(self, t_s: float, readings: list[Reading]) -> list[Reading]:
        """Return the readings delivered at ``t_s``."""
        self._held += readings
        if self._fault.active(t_s):
            count = math.floor((t_s - self._fault.at_s + ROUNDING_S) / self._fault.size)
            if count == self._count:
                return []
            self._count = count
        arrived, self._held = self._held, []
        return arrived


class SensorFaults:
    """All sensor faults of a run, in order, and the operator's handset."""

    def __init__(self, faults: Sequence[Fault], seed: int, acts: Sequence[OperatorAct] = ()) -> None:
        self._seed, self._acts = seed, acts
        self._sensor_faults: list[SensorFault] = []
        self._bursts: list[Burst] = []
        self._has_operator, self._next_beat = bool(acts), 0
        for fault in faults:
            self.add(fault, 0.0)

    def add(self, fault: Fault, t_s: float) -> None:
        """Add a fault at ``t_s`` of a run; the handset reports from then on if the fault concerns the handset."""
        if fault.kind in CORRUPTIONS:
            place = sum(model.fault.kind == fault.kind for model in self._sensor_faults)
            self._sensor_faults = sorted([*self._sensor_faults, SensorFault(fault, self._seed, place)], key=_order)
        if fault.kind == "late_tick":
            self._bursts.append(Burst(fault))
        if fault.kind in OF_THE_HANDSET and not self._has_operator:
            self._has_operator = True
            self._next_beat = math.ceil(t_s / (REPORT_TICKS * TICK_S) - ROUNDING_S)

    def deliver(self, t_s: float, readings: list[Reading]) -> list[Reading]:
        """Return the readings delivered to the mission at ``t_s``."""
        beats = list(self._heartbeat(t_s)) if self._has_operator else []
        arrived = _merged(readings, beats) if beats else readings
        for fault_model in self._sensor_faults:
            arrived = [passed for reading in arrived for passed in fault_model.step(reading)]
        for burst in self._bursts:
            arrived = burst.deliver(t_s, arrived)
        return arrived

    def _heartbeat(self, until_s: float) -> Iterator[OperatorInput]:
        while (t_s := self._next_beat * REPORT_TICKS * TICK_S) <= until_s + ROUNDING_S:
            pressed = {kind: does(self._acts, kind, t_s) for kind in BUTTONS}
            yield OperatorInput(t_s=t_s, dead_man=not does(self._acts, "release", t_s), **pressed)
            self._next_beat += 1


def restamped(reading: Reading, t_s: float) -> Reading:
    """Return a reading with another stamp; the colours of a frame stay lazily rendered."""
    if isinstance(reading, RgbdFrame):
        return RenderedFrame(t_s=t_s, depth_m=reading.depth_m, camera=reading.camera, painter=partial(_colours, reading))
    return replace(reading, t_s=t_s)


def blotches(shape: tuple[int, ...], share: float, rng: np.random.Generator) -> Bool[np.ndarray, "h w"]:
    """Return a mask with the fraction ``share`` set, in connected patches."""
    height, width = shape
    coarse = rng.standard_normal((max(height // BLOTCH_PX, 2), max(width // BLOTCH_PX, 2))).astype(np.float32)
    smooth = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(smooth < np.quantile(smooth, share))


def _merged(readings: Sequence[Reading], beats: Sequence[Reading]) -> list[Reading]:
    """Return readings and heartbeats in the order of arrival: a late reading arrives after the newest stamp before it."""
    arrivals_s = accumulate((reading.t_s for reading in readings), max)
    timed = [*zip(arrivals_s, readings, strict=True), *((beat.t_s, beat) for beat in beats)]
    return [reading for _, reading in sorted(timed, key=itemgetter(0))]


def _colours(frame: RgbdFrame) -> UInt8[np.ndarray, "h w 3"]:
    return frame.rgb


def _lit(frame: RgbdFrame, factor: float, rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """Return the colours of a frame at a scaled light, with shot noise."""
    light = frame.rgb.astype(np.float32) * np.float32(factor)
    noise = rng.standard_normal(light.shape, dtype=np.float32)
    return np.clip(light + noise * (1.5 + 0.25 * np.sqrt(light)), 0.0, 255.0).astype(np.uint8)
