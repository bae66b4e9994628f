"""What faults make of readings on their way to the mission: ``Readings -> Readings``.

A reading passes one machine per fault: one goes in, none, one or two come out. Without images (``camera = "statistical"``)
a fault of the image is what it would mean to a detector and to the figures by which a frame is judged. A false edge means nothing
then: in rendered frames a bar of -15 to 30° moves the heading by less than 0.05°.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import accumulate
from operator import itemgetter
from typing import get_args

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

from treadline.angles import DEG, quaternion_of, rotation_of, rotation_z
from treadline.attendant import REPORT_S, OperatorAct, does
from treadline.faults import SAME_TIME_S, Fault, FaultKind, Process
from treadline.signals import (
    TICK_S,
    FlipperReading,
    FrameQuality,
    HeadingMeasurement,
    ImuSample,
    OperatorInput,
    Reading,
    RgbdFrame,
    SeatReading,
    StairMap,
    TrackReading,
)
from treadline.sim.camera.camera import RenderedFrame

SIGHT = (RgbdFrame, FrameQuality, HeadingMeasurement, StairMap)
"""All that a camera hands over."""
HEARTBEAT_TICKS = round(REPORT_S / TICK_S)
DEPTH_ENOUGH = 0.4
"""Share of a depth image from which on nobody looks at the colours, dark or not: as ``perception.quality`` does."""
BLOTCH_PX = 12
"""Size of the smallest hole in the depth image: a return is lost with its neighbours."""
JUMP_LEAST_DEG, JUMP_S = 5.0, 0.1
"""From this size a bias is a jump; the gyro shows it within this time: 30° at once would be beyond its range of 2000 °/s."""

Passed = tuple[Reading, ...]


class Machine:
    """One fault in the readings' way.

    Args:
        place: Among the faults of its kind; each has random numbers of its own, at each instant.
    """

    def __init__(self, fault: Fault, seed: int, place: int) -> None:
        self.fault = fault
        self.last: dict[type, Reading] = {}
        """Of each kind of reading, the last before the fault."""
        self._stream = [seed, get_args(FaultKind).index(fault.kind), place]

    def step(self, reading: Reading) -> Passed:
        """Return what becomes of a reading."""
        if self.fault.active(reading.t_s):
            return SPOILT[self.fault.kind](self, reading)
        self.last[type(reading)] = reading
        return (reading,)

    def chance(self, t_s: float) -> np.random.Generator:
        """Return the random numbers of one instant."""
        return np.random.default_rng([*self._stream, round(t_s / TICK_S)])


def _lost(kinds: tuple[type, ...], _: Machine, reading: Reading) -> Passed:
    return () if isinstance(reading, kinds) else (reading,)


def _stuck(kinds: tuple[type, ...], machine: Machine, reading: Reading) -> Passed:
    """Repeat the last reading before the fault, or the first one in it, with new stamps."""
    if not isinstance(reading, kinds):
        return (reading,)
    return (restamped(machine.last.setdefault(type(reading), reading), reading.t_s),)


def _killed(machine: Machine, reading: Reading) -> Passed:
    """Of the processes only perception is in the sensors' way."""
    return _lost(SIGHT if machine.fault.size == Process.PERCEPTION else (), machine, reading)


def _dark(machine: Machine, reading: Reading) -> Passed:
    """Let colours fade into noise or drown in light; depth needs no light, unless ``value`` says that it is gone too."""
    factor, blind = abs(machine.fault.size), machine.fault.size < 0.0
    match reading:
        case RgbdFrame():
            # Painted when somebody looks, with this instant's noise: looking or not changes no other frame.
            painter = partial(_lit, reading, factor, machine.chance(reading.t_s))
            depth_m = np.full_like(reading.depth_m, np.nan) if blind else reading.depth_m
            return (RenderedFrame(t_s=reading.t_s, depth_m=depth_m, camera=reading.camera, painter=painter),)
        case FrameQuality() if blind or reading.valid_share < DEPTH_ENOUGH:
            faded = replace(
                reading, brightness=min(reading.brightness * factor, 1.0), contrast=reading.contrast * min(factor, 1 / factor)
            )
            return (replace(faded, valid_share=0.0) if blind else faded,)
        case HeadingMeasurement() | StairMap() if blind:
            return ()
    return (reading,)


def _holes(machine: Machine, reading: Reading) -> Passed:
    """Take depth away in blotches; a detector without images fails as often as its pixels do."""
    share = machine.fault.size
    match reading:
        case RgbdFrame():
            lost = blotches(reading.depth_m.shape, share, machine.chance(reading.t_s))
            depth_m = np.where(lost, np.float32(np.nan), reading.depth_m)
            return (RenderedFrame(t_s=reading.t_s, depth_m=depth_m, camera=reading.camera, painter=partial(_colours, reading)),)
        case FrameQuality():
            return (replace(reading, valid_share=(1.0 - share) * reading.valid_share),)
        case HeadingMeasurement() | StairMap() if machine.chance(reading.t_s).random() < share:
            return ()
    return (reading,)


def _imu_nan(_: Machine, reading: Reading) -> Passed:
    if not isinstance(reading, ImuSample):
        return (reading,)
    nothing = np.full(3, np.nan)
    return (replace(reading, orientation=np.full(4, np.nan), angular_velocity_rad_s=nothing, linear_acceleration_m_s2=nothing),)


def _imu_bias(machine: Machine, reading: Reading) -> Passed:
    """Report a turn that is none; the attitude's yaw goes with it."""
    if not isinstance(reading, ImuSample):
        return (reading,)
    since_s, size = reading.t_s - machine.fault.at_s, machine.fault.size * DEG
    if abs(machine.fault.size) < JUMP_LEAST_DEG:
        rate, turned = size, size * (since_s + TICK_S)
    else:
        rate = size / JUMP_S if since_s < JUMP_S - SAME_TIME_S else 0.0
        turned = size * min((since_s + TICK_S) / JUMP_S, 1.0)
    return (_turning(reading, rate, turned),)


def _gyro_ramp(machine: Machine, reading: Reading) -> Passed:
    """Report a turn that grows evenly."""
    if not isinstance(reading, ImuSample):
        return (reading,)
    since_s = reading.t_s - machine.fault.at_s
    growth = machine.fault.size * DEG / machine.fault.for_s
    return (_turning(reading, growth * since_s, 0.5 * growth * since_s * (since_s + TICK_S)),)


def _turning(reading: ImuSample, rate_rad_s: float, turned_rad: float) -> ImuSample:
    """Return a sample with a turn about the chair's z that is none."""
    orientation = quaternion_of(rotation_z(turned_rad) @ rotation_of(reading.orientation))
    wrong = reading.angular_velocity_rad_s + np.array([0.0, 0.0, rate_rad_s])
    return replace(reading, orientation=orientation, angular_velocity_rad_s=wrong)


def _person_stops(machine: Machine, reading: Reading) -> Passed:
    if not isinstance(reading, OperatorInput):
        return (reading,)
    return (replace(reading, dead_man=False) if machine.fault.size == 1.0 else replace(reading, stop=True),)


def _clock_back(machine: Machine, reading: Reading) -> Passed:
    """Name times that were before; each reading comes twice."""
    earlier = restamped(reading, reading.t_s - machine.fault.size)
    return (earlier, earlier)


# In the order in which a reading passes: dark asks what depth is left; the clock comes last, for the others go by true time.
SPOILT: dict[FaultKind, Callable[[Machine, Reading], Passed]] = {
    "camera_frozen": partial(_stuck, SIGHT),
    "depth_holes": _holes,
    "camera_dark": _dark,
    "camera_lost": partial(_lost, SIGHT),
    "imu_bias": _imu_bias,
    "gyro_ramp": _gyro_ramp,
    "imu_stuck": partial(_stuck, (ImuSample,)),
    "imu_nan": _imu_nan,
    "imu_lost": partial(_lost, (ImuSample,)),
    "readings_lost": partial(_lost, (TrackReading, SeatReading, FlipperReading)),
    "process_killed": _killed,
    "operator_stop": _person_stops,
    "link_lost": partial(_lost, (OperatorInput,)),
    "clock_back": _clock_back,
}


class Burst:
    """Withholds readings while the mission's computer stands, and hands them over together when it goes on."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault
        self._held: list[Reading] = []
        self._count = 0

    def deliver(self, t_s: float, readings: list[Reading]) -> list[Reading]:
        """Return what arrives at ``t_s`` of what was sensed until then."""
        self._held += readings
        if self._fault.active(t_s):
            count = math.floor((t_s - self._fault.at_s + SAME_TIME_S) / self._fault.size)
            if count == self._count:
                return []
            self._count = count
        arrived, self._held = self._held, []
        return arrived


class SensorFaults:
    """All faults on the way from the sensors to the mission."""

    def __init__(self, faults: Sequence[Fault], seed: int, acts: Sequence[OperatorAct] = ()) -> None:
        machines = [Machine(fault, seed, place) for place, fault in _numbered(faults) if fault.kind in SPOILT]
        order = list(SPOILT)
        self._machines = sorted(machines, key=lambda machine: order.index(machine.fault.kind))
        self._bursts = [Burst(fault) for fault in faults if fault.kind == "late_tick"]
        self._acts = acts
        self._has_operator = bool(acts) or any(fault.kind in ("operator_stop", "link_lost") for fault in faults)
        self._next_beat = 0

    def deliver(self, t_s: float, readings: list[Reading]) -> list[Reading]:
        """Return what the mission gets at ``t_s`` of what was sensed since the last call."""
        beats = list(self._heartbeat(t_s)) if self._has_operator else []
        arrived = _merged(readings, beats) if beats else readings
        for machine in self._machines:
            arrived = [passed for reading in arrived for passed in machine.step(reading)]
        for burst in self._bursts:
            arrived = burst.deliver(t_s, arrived)
        return arrived

    def _heartbeat(self, until_s: float) -> Iterator[OperatorInput]:
        while (t_s := self._next_beat * HEARTBEAT_TICKS * TICK_S) <= until_s + SAME_TIME_S:
            stop, release, rearm = (does(self._acts, kind, t_s) for kind in ("stop", "release", "rearm"))
            yield OperatorInput(t_s=t_s, dead_man=not release, stop=stop, rearm=rearm)
            self._next_beat += 1


def restamped(reading: Reading, t_s: float) -> Reading:
    """Return a reading with another stamp; a frame's colours are still painted at the first look."""
    if isinstance(reading, RgbdFrame):
        return RenderedFrame(t_s=t_s, depth_m=reading.depth_m, camera=reading.camera, painter=partial(_colours, reading))
    return replace(reading, t_s=t_s)


def blotches(shape: tuple[int, ...], share: float, rng: np.random.Generator) -> Bool[np.ndarray, "h w"]:
    """Return a mask of which ``share`` is set, in connected patches."""
    height, width = shape
    coarse = rng.standard_normal((max(height // BLOTCH_PX, 2), max(width // BLOTCH_PX, 2))).astype(np.float32)
    smooth = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(smooth < np.quantile(smooth, share))


def _numbered(faults: Sequence[Fault]) -> Iterator[tuple[int, Fault]]:
    """Yield each fault with its place among those of its kind."""
    counts: dict[FaultKind, int] = {}
    for fault in faults:
        counts[fault.kind] = counts.get(fault.kind, -1) + 1
        yield counts[fault.kind], fault


def _merged(readings: Sequence[Reading], beats: Sequence[Reading]) -> list[Reading]:
    """Return readings and heartbeats in the order of arrival: a late reading arrives after the newest stamp before it."""
    arrivals_s = accumulate((reading.t_s for reading in readings), max)
    timed = [*zip(arrivals_s, readings, strict=True), *((beat.t_s, beat) for beat in beats)]
    return [reading for _, reading in sorted(timed, key=itemgetter(0))]


def _colours(frame: RgbdFrame) -> UInt8[np.ndarray, "h w 3"]:
    return frame.rgb


def _lit(frame: RgbdFrame, factor: float, rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """Return a frame's colours under so much more or less light, with shot noise of their own."""
    light = frame.rgb.astype(np.float32) * np.float32(factor)
    noise = rng.standard_normal(light.shape, dtype=np.float32)
    return np.clip(light + noise * (1.5 + 0.25 * np.sqrt(light)), 0.0, 255.0).astype(np.uint8)
