"""Over the crest, with the arm and without: pitch rate, seat error and what the passenger feels.

The crest gets the last nosing's place with an error and a belief of the load; truth only scores.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from treadline.angles import DEG
from treadline.control.crest import Crest, CrestCommand, CrestConfig
from treadline.mechanics.chair import ChairDescription, read_chair
from treadline.mission.rates import TICK_S
from treadline.ports import Truth
from treadline.scenario import Chair, Control, Scenario, Sensors, Stair, Start
from treadline.seat import Leveller, LevellerConfig
from treadline.seat.feed_forward import PitchFeedForward
from treadline.signals import ArmReading, ImuSample, Reading, SeatReading, TrackCommand, TrackReading
from treadline.sim import MujocoPlant, open_plant

STEPS = 8
OPEN_LOOP_M_S = 0.1
"""Without an arm nothing is sequenced."""
LEVEL_RAD = 2.0 * DEG
HEADING_GAIN_M_S_RAD = 0.3
"""Stands in for the heading controller: the belts' difference keeps the heading that the run began with."""
COMFORT_TICKS = 5
"""Acceleration is the mean over 50 ms: what a body follows (ISO 2631-1 weighs vertical motion below some 10 Hz)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CrestCase:
    """One crossing: the stair, the load, and what is wrong."""

    slope_deg: float = 28.0
    chair: str = "wheelchair"
    payload_kg: float = 50.0
    heading_deg: float = 0.0
    nosing_error_m: float = 0.0
    """Believed place less the true one: positive has the nosing further ahead than it is."""
    com_error_m: float = 0.0
    range_deg: tuple[float, float] | None = None
    torque_n_m: float | None = None
    motor_lost_below_deg: float | None = None
    """Pitch at which the arm's motor dies."""
    lost_damping_n_m_s_rad: float | None = None
    seed: int = 0
    duration_s: float = 40.0

    def description(self) -> ChairDescription:
        """Return the chair, its arm as this case has it."""
        chair = read_chair(self.chair)
        if chair.arm is None:
            return chair
        changes = {
            "range_deg": self.range_deg,
            "torque_n_m": self.torque_n_m,
            "lost_damping_n_m_s_rad": self.lost_damping_n_m_s_rad,
        }
        arm = chair.arm.model_copy(update={key: value for key, value in changes.items() if value is not None})
        return chair.model_copy(update={"arm": arm})

    def scenario(self) -> Scenario:
        """Return the stair and the start: the front pulley on the last nosing but one."""
        return Scenario(
            stair=Stair.model_validate(
                {"slope_deg": self.slope_deg, "steps": STEPS, "walls": "none", "width_m": 4.0, "landing_m": 3.0}
            ),
            chair=Chair(model=self.chair, payload_kg=self.payload_kg),
            start=Start(place="flight", step=STEPS - 3, heading_deg=self.heading_deg),
            control=Control(vision="truth"),
            sensors=Sensors(),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """One tick of a crossing."""

    truth: Truth
    command: CrestCommand | None
    arm: ArmReading | None
    height_m: float
    """Of the passenger's centre."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """What a crossing came to."""

    is_across: bool
    """Whether the rear has left the last nosing; without an arm, whether the chair lies on the landing."""
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
        self._leveller = Leveller(LevellerConfig(seat=chair.seat))
        self._feed_forward = PitchFeedForward(chair.seat)
        self._last_m = (STEPS - 1) * plant.staircase.pitch_m
        self._crest: Crest | None = None
        self._moments: list[Moment] = []
        self._is_lost = False

    def step(self) -> bool:
        """Feel, decide, act; say whether the chair is across."""
        imu, seat, tracks, arm = _newest(self._plant.read())
        truth = self._plant.truth()[-1]
        command = None if arm is None else self._sequencer(truth).step(imu, arm, tracks)
        self._moments.append(Moment(truth=truth, command=command, arm=arm, height_m=self._plant.passenger_height_m))
        if self._is_across():
            return True
        self._fail(truth)
        speed = OPEN_LOOP_M_S if command is None else command.speed_m_s
        turn = HEADING_GAIN_M_S_RAD * (truth.heading_rad - self._case.heading_deg * DEG)
        self._plant.write(
            TrackCommand(t_s=imu.t_s, left_m_s=speed + turn, right_m_s=speed - turn),
            self._feed_forward.step(imu, seat, self._leveller.step(seat)),
            None if command is None else command.arm,
        )
        return False

    def result(self) -> Crossing:
        """Return the figures."""
        samples = [moment.truth for moment in self._moments]
        velocity = np.diff([moment.height_m for moment in self._moments]) / TICK_S
        acceleration = (velocity[COMFORT_TICKS:] - velocity[:-COMFORT_TICKS]) / (COMFORT_TICKS * TICK_S)
        return Crossing(
            is_across=self._is_across(),
            duration_s=samples[-1].t_s,
            pitch_rate_deg_s=max(abs(sample.pitch_rate_rad_s) for sample in samples) / DEG,
            seat_deg=max(abs(sample.seat_pitch_rad) for sample in samples) / DEG,
            vertical_m_s2=float(np.abs(acceleration).max()),
            moments=tuple(self._moments),
        )

    def _sequencer(self, truth: Truth) -> Crest:
        if self._crest is None:
            ahead_m = (self._last_m - truth.x_m) / math.cos(truth.heading_rad) + self._case.nosing_error_m
            belief = CrestConfig(chair=self._chair, payload_kg=self._case.payload_kg, com_error_m=self._case.com_error_m)
            self._crest = Crest(belief, ahead_m)
        return self._crest

    def _is_across(self) -> bool:
        now = self._moments[-1]
        if now.command is not None:
            return now.command.stage == "done"
        return now.truth.pitch_rad < LEVEL_RAD and now.truth.x_m - self._last_m > 0.25 * self._chair.tracks.flat_run_m

    def _fail(self, truth: Truth) -> None:
        below_deg = self._case.motor_lost_below_deg
        if below_deg is not None and not self._is_lost and truth.pitch_rad < below_deg * DEG:
            self._plant.lose_arm_motor()
            self._is_lost = True


def _newest(readings: Sequence[Reading]) -> tuple[ImuSample, SeatReading, TrackReading, ArmReading | None]:
    """Return the newest reading of each kind that the crest needs."""
    newest: dict[type[Reading], Any] = {type(reading): reading for reading in readings}
    return newest[ImuSample], newest[SeatReading], newest[TrackReading], newest.get(ArmReading)
