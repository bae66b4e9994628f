"""Over the crest, with the flipper and without: pitch rate, seat error and what the passenger feels.

The crest gets the last nosing's place with an error and a belief of the load; truth only scores.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from treadline.angles import DEG
from treadline.control.crest import Crest, CrestCommand, CrestConfig
from treadline.control.edge import Edge, EdgeCommand, EdgeConfig
from treadline.mechanics.chair import ChairDescription, read_chair
from treadline.mechanics.comfort import lasting_change
from treadline.ports import Truth
from treadline.scenario import Chair, Control, Scenario, Sensors, Stair, Start
from treadline.seat import Leveller, LevellerConfig
from treadline.seat.feed_forward import PitchFeedForward
from treadline.signals import TICK_S, FlipperReading, ImuSample, Reading, SeatReading, TrackCommand, TrackReading
from treadline.sim import MujocoPlant, open_plant

STEPS = 8
Direction = Literal["up", "down"]
STARTS: dict[tuple[str, str], Literal["floor", "flight", "landing"]] = {
    ("foot", "up"): "floor",
    ("foot", "down"): "flight",
    ("top", "up"): "flight",
    ("top", "down"): "landing",
}
LEVEL_RAD = 2.0 * DEG
HEADING_GAIN_M_S_RAD = 0.3
"""Stands in for the heading controller: the belts' difference keeps the heading that the run began with."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CrestCase:
    """One crossing: the stair, the load, and what is wrong."""

    direction: Direction = "up"
    """Up over the crest, or rearwards down over the edge."""
    at: Literal["top", "foot"] = "top"
    """At the foot nothing is sequenced, and the flipper rests: up mounts the flight, down leaves it rearwards."""
    speed_m_s: float = 0.1
    """Of the belts where nothing is sequenced: at the foot, and without a flipper."""
    slope_deg: float = 28.0
    friction: tuple[float, float] = (0.62, 0.5)
    """Of the belts along and across, on stair, floor and landing alike."""
    chair: str = "wheelchair"
    payload_kg: float = 50.0
    payload_error_kg: float = 0.0
    """Believed payload less the true one."""
    heading_deg: float = 0.0
    nosing_error_m: float = 0.0
    """Believed place less the true one: positive has the nosing further ahead than it is."""
    com_error_m: float = 0.0
    slope_error_deg: float = 0.0
    """Of the flight's slope as the edge believes it."""
    gravity_error_deg: float = 0.0
    """Of the IMU's idea of down."""
    keep_m: float | None = None
    """Of the centre of mass before the edge; far below zero the belts go on whatever the flipper does."""
    range_deg: tuple[float, float] | None = None
    torque_n_m: float | None = None
    motor_lost_at_deg: float | None = None
    """Pitch at which the flipper's motor dies."""
    lost_damping_n_m_s_rad: float | None = None
    seed: int = 0
    duration_s: float = 40.0

    def description(self) -> ChairDescription:
        """Return the chair, its flipper as this case has it."""
        chair = read_chair(self.chair)
        if chair.flipper is None:
            return chair
        changes = {
            "range_deg": self.range_deg,
            "torque_n_m": self.torque_n_m,
            "lost_damping_n_m_s_rad": self.lost_damping_n_m_s_rad,
        }
        flipper = chair.flipper.model_copy(update={key: value for key, value in changes.items() if value is not None})
        return chair.model_copy(update={"flipper": flipper})

    def scenario(self) -> Scenario:
        """Return the stair and the start: upwards the front pulley two nosings before the last, or all of it on the floor."""
        return Scenario(
            stair=Stair.model_validate(
                {
                    "slope_deg": self.slope_deg,
                    "friction": self.friction,
                    "steps": STEPS,
                    "walls": "none",
                    "width_m": 4.0,
                    "landing_m": 3.0,
                }
            ),
            chair=Chair(model=self.chair, payload_kg=self.payload_kg),
            start=Start(
                place=STARTS[self.at, self.direction],
                step=STEPS - 3 if self.at == "top" else STEPS - 4,
                heading_deg=self.heading_deg,
            ),
            control=Control(vision="truth"),
            sensors=Sensors(gravity_error_deg=self.gravity_error_deg),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """One tick of a crossing."""

    truth: Truth
    command: CrestCommand | EdgeCommand | None
    flipper: FlipperReading | None
    height_m: float
    """Of the passenger's centre."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """What a crossing came to."""

    is_across: bool
    """Whether the rear has left the last nosing; without a flipper, whether the chair lies on the landing."""
    duration_s: float
    pitch_rate_deg_s: float
    """Largest, whichever way."""
    seat_deg: float
    vertical_m_s2: float
    moments: tuple[Moment, ...] = field(repr=False)

    @property
    def stages(self) -> tuple[tuple[float, str], ...]:
        """When each stage began."""
        commands = [moment.command for moment in self.moments if moment.command is not None]
        return tuple(
            (command.t_s, command.stage) for i, command in enumerate(commands) if i == 0 or commands[i - 1].stage != command.stage
        )


def cross(case: CrestCase) -> Crossing:
    """Drive one crossing."""
    chair = case.description()
    plant = open_plant(case.scenario(), case.seed, chair=chair)
    plant.start()
    ride = _Ride(case, chair, plant)
    for tick in range(1, round(case.duration_s / TICK_S) + 1):
        if ride.step():
            break
        plant.advance(tick * TICK_S)
    plant.close()
    return ride.result()


class _Ride:
    """One chair on its way over the crest, tick by tick."""

    def __init__(self, case: CrestCase, chair: ChairDescription, plant: MujocoPlant) -> None:
        self._case, self._chair, self._plant = case, chair, plant
        self._leveller = Leveller(LevellerConfig(seat=chair.levelled_seat))
        self._feed_forward = PitchFeedForward(chair.levelled_seat)
        self._slope_rad = plant.staircase.slope_rad
        self._nosing_m = (STEPS - 1) * plant.staircase.pitch_m if case.at == "top" else 0.0
        self._sequencer: Crest | Edge | None = None
        self._moments: list[Moment] = []
        self._is_lost = False

    def step(self) -> bool:
        """Feel, decide, act; say whether the chair is across."""
        imu, seat, tracks, flipper = _newest(self._plant.read())
        truth = self._plant.truth()[-1]
        command = None if flipper is None or self._case.at == "foot" else self._sequence(truth).step(imu, flipper, tracks)
        self._moments.append(Moment(truth=truth, command=command, flipper=flipper, height_m=self._plant.passenger_height_m))
        if self._is_across():
            return True
        self._fail(truth)
        open_loop = self._case.speed_m_s if self._case.direction == "up" else -self._case.speed_m_s
        speed = open_loop if command is None else command.speed_m_s
        turn = HEADING_GAIN_M_S_RAD * (truth.heading_rad - self._case.heading_deg * DEG)
        self._plant.write(
            TrackCommand(t_s=imu.t_s, left_m_s=speed + turn, right_m_s=speed - turn),
            self._feed_forward.step(imu, seat, self._leveller.step(seat)),
            None if command is None else command.flipper,
        )
        return False

    def result(self) -> Crossing:
        """Return the figures."""
        samples = [moment.truth for moment in self._moments]
        velocity = np.diff([moment.height_m for moment in self._moments]) / TICK_S
        return Crossing(
            is_across=self._is_across(),
            duration_s=samples[-1].t_s,
            pitch_rate_deg_s=max(abs(sample.pitch_rate_rad_s) for sample in samples) / DEG,
            seat_deg=max(abs(sample.seat_pitch_rad) for sample in samples) / DEG,
            vertical_m_s2=float(np.abs(lasting_change(velocity)).max()),
            moments=tuple(self._moments),
        )

    def _sequence(self, truth: Truth) -> Crest | Edge:
        """Return the sequencer; at the first tick truth and the case's errors make what it believes."""
        if self._sequencer is None:
            case = self._case
            load: Any = {
                "chair": self._chair,
                "payload_kg": case.payload_kg + case.payload_error_kg,
                "com_error_m": case.com_error_m,
            }
            if case.direction == "up":
                ahead_m = (self._nosing_m - truth.x_m) / math.cos(truth.heading_rad)
                self._sequencer = Crest(CrestConfig(**load), ahead_m + case.nosing_error_m)
            else:
                behind_m = (truth.x_m - self._nosing_m) / (math.cos(self._slope_rad) * math.cos(truth.heading_rad))
                belief = EdgeConfig(**load)
                if case.keep_m is not None:
                    belief = replace(belief, keep_m=case.keep_m)
                slope_rad = self._slope_rad + case.slope_error_deg * DEG
                self._sequencer = Edge(belief, behind_m - case.nosing_error_m, slope_rad)
        return self._sequencer

    def _is_across(self) -> bool:
        now = self._moments[-1]
        if now.command is not None:
            return now.command.stage == "done"
        case = self._case
        ahead_m = (now.truth.x_m - self._nosing_m) * (1.0 if case.direction == "up" else -1.0)
        goes_level = (case.direction == "up") == (case.at == "top")
        left_rad = now.truth.pitch_rad if goes_level else self._slope_rad - now.truth.pitch_rad
        return left_rad < LEVEL_RAD and ahead_m > 0.25 * self._chair.tracks.flat_run_m

    def _fail(self, truth: Truth) -> None:
        lost_deg = self._case.motor_lost_at_deg
        if lost_deg is None or self._is_lost:
            return
        if truth.pitch_rad < lost_deg * DEG if self._case.direction == "up" else truth.pitch_rad > lost_deg * DEG:
            self._plant.lose_flipper_motor()
            self._is_lost = True


def _newest(readings: Sequence[Reading]) -> tuple[ImuSample, SeatReading, TrackReading, FlipperReading | None]:
    """Return the newest reading of each kind that the crest needs."""
    newest: dict[type[Reading], Any] = {type(reading): reading for reading in readings}
    return newest[ImuSample], newest[SeatReading], newest[TrackReading], newest.get(FlipperReading)
