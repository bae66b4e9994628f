"""Crossings of crest, top edge and foot, with and without the flipper: pitch rate, seat error and vertical acceleration.

The sequencers receive the nosing's position and the load with the errors of the case; ground truth sets the start and the scores.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from treadline.control.belt_allocation import CRUISE_M_S
from treadline.control.crest_sequence import Crest, CrestCommand
from treadline.control.edge_sequence import Edge, EdgeCommand
from treadline.control.seat_leveller import Leveller, PitchFeedForward
from treadline.core.angles import DEG
from treadline.core.ports import Reading, Truth
from treadline.core.signals import TICK_S, FlipperReading, ImuSample, SeatReading, TrackCommand, TrackReading
from treadline.estimation.known_nosings import KnownNosing, KnownNosings
from treadline.plant.faults import Damage
from treadline.plant.mujoco import MujocoPlant, open_plant
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.scenario.scenario import Chair, Control, Scenario, Sensors, Stair, Start
from treadline.vehicle.comfort import lasting_change
from treadline.vehicle.loading import Loading

STEPS = 8
Direction = Literal["up", "down"]
STARTS: dict[tuple[str, str], Literal["floor", "flight", "landing"]] = {
    ("foot", "up"): "floor",
    ("foot", "down"): "flight",
    ("top", "up"): "flight",
    ("top", "down"): "landing",
}
LEVEL_RAD = 2.0 * DEG
NOSING_SIGMA_M = 0.001
"""Standard deviation of a nosing's height that the sequencers receive [m]: that of the stair tracker near the chair."""
HEADING_GAIN_M_S_RAD = 0.3
"""Belt-speed difference to each side per heading error [m/s/rad]: a proportional controller of the initial heading, in place of the
LQR."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CrestCase:
    """Conditions of one crossing: stair, load, and errors of the assumed values."""

    direction: Direction = "up"
    """Direction of travel: forwards up the flight, or rearwards down it."""
    at: Literal["top", "foot"] = "top"
    """End of the flight that is crossed. At the foot no sequencer runs and the flipper keeps its position."""
    speed_m_s: float = 0.1
    """Belt speed where no sequencer runs [m/s]: at the foot, and without a flipper."""
    slope_deg: float = 28.0
    friction: tuple[float, float] = (0.62, 0.5)
    """Friction coefficients along and across the belt, on stair, floor and landing."""
    chair: str = "wheelchair"
    payload_kg: float = 50.0
    payload_error_kg: float = 0.0
    """Assumed minus true payload [kg]."""
    heading_deg: float = 0.0
    nosing_error_m: float = 0.0
    """Assumed minus true position of the nosing [m], positive up the flight."""
    com_error_m: float = 0.0
    """Assumed minus true position of the centre of mass along the chair [m], positive forward."""
    slope_error_deg: float = 0.0
    """Assumed minus true slope of the flight [°], descent only."""
    gravity_error_deg: float = 0.0
    """Tilt of the IMU's gravity direction [°]."""
    margin_deg: float | None = None
    """Tip-over margin of the lifted chair before the edge [°], in place of ``Edge``'s; far below zero the belts never wait
    for the flipper."""
    range_deg: tuple[float, float] | None = None
    torque_n_m: float | None = None
    motor_lost_at_deg: float | None = None
    """Pitch at which the flipper motor fails [°]; None if the motor works."""
    lost_damping_n_m_s_rad: float | None = None
    seed: int = 0
    duration_s: float = 40.0

    def description(self) -> ChairDescription:
        """Return the chair with the flipper of this case."""
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
        """Return the stair and the start: up from two nosings before the last, otherwise from floor, flight or landing."""
        return Scenario(
            stair=Stair(slope_deg=self.slope_deg, friction=self.friction, steps=STEPS, walls="none", width_m=4.0, landing_m=3.0),
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
class CrossingTick:
    """Ground truth and command of one tick."""

    truth: Truth
    command: CrestCommand | EdgeCommand | None
    height_m: float
    """Height of the passenger's centre in W [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """Result of a crossing."""

    is_across: bool
    """Whether the sequencer has ended; without a sequencer, whether the chair lies on the next surface."""
    pitch_rate_deg_s: float
    """Largest magnitude of the pitch rate [°/s]."""
    seat_deg: float
    """Largest magnitude of the seat pitch [°]."""
    vertical_m_s2: float
    """Largest vertical acceleration of the passenger, mean over 50 ms [m/s²]."""
    ticks: tuple[CrossingTick, ...] = field(repr=False)

    @property
    def stages(self) -> tuple[tuple[float, str], ...]:
        """Start time [s] and name of each stage of the sequencer."""
        commands = [tick.command for tick in self.ticks if tick.command is not None]
        return tuple(
            (command.t_s, command.stage) for i, command in enumerate(commands) if i == 0 or commands[i - 1].stage != command.stage
        )


def cross(case: CrestCase) -> Crossing:
    """Simulate one crossing."""
    chair = case.description()
    plant = open_plant(case.scenario(), case.seed, chair=chair)
    plant.start()
    run = _CrestRun(case, chair, plant)
    for tick in range(1, round(case.duration_s / TICK_S) + 1):
        if run.step():
            break
        plant.advance(tick * TICK_S)
    plant.close()
    return run.result()


class _CrestRun:
    """Control loop of one crossing."""

    def __init__(self, case: CrestCase, chair: ChairDescription, plant: MujocoPlant) -> None:
        self._case, self._chair, self._plant = case, chair, plant
        self._leveller = Leveller(chair.levelled_seat)
        self._feed_forward = PitchFeedForward(chair.levelled_seat)
        self._slope_rad = plant.staircase.slope_rad
        self._nosing_m = (STEPS - 1) * plant.staircase.pitch_m if case.at == "top" else 0.0
        self._sequencer: Crest | Edge | None = None
        self._top_m = 0.0
        """Distance of the uppermost nosing ahead of mid-track along the belts, as the sequencer receives it [m]."""
        self._ticks: list[CrossingTick] = []
        self._is_lost = False

    def step(self) -> bool:
        """Read the sensors, compute and send the commands; return whether the chair is across."""
        imu, seat, tracks, flipper = _newest(self._plant.read())
        truth = self._plant.truth()[-1]
        command = None if flipper is None or self._case.at == "foot" else self._command(truth, imu, tracks, flipper)
        self._ticks.append(CrossingTick(truth=truth, command=command, height_m=self._plant.passenger_height_m))
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
        """Return the scores."""
        samples = [tick.truth for tick in self._ticks]
        velocity = np.diff([tick.height_m for tick in self._ticks]) / TICK_S
        return Crossing(
            is_across=self._is_across(),
            pitch_rate_deg_s=max(abs(sample.pitch_rate_rad_s) for sample in samples) / DEG,
            seat_deg=max(abs(sample.seat_pitch_rad) for sample in samples) / DEG,
            vertical_m_s2=float(np.abs(lasting_change(velocity)).max()),
            ticks=tuple(self._ticks),
        )

    def _command(self, truth: Truth, imu: ImuSample, tracks: TrackReading, flipper: FlipperReading) -> CrestCommand | EdgeCommand:
        """Return the sequencer's command; it is configured at the first tick from ground truth and the errors of the case."""
        case = self._case
        if self._sequencer is None:
            level = math.cos(self._slope_rad) if case.direction == "down" else 1.0
            self._top_m = (self._nosing_m - truth.x_m) / (level * math.cos(truth.heading_rad)) + case.nosing_error_m
        self._top_m -= 0.5 * (tracks.left_m_s + tracks.right_m_s) * TICK_S
        around = self._around(imu.pitch_rad)
        if self._sequencer is None:
            payload_kg = case.payload_kg + case.payload_error_kg
            loading = Loading(chair=self._chair, payload_kg=payload_kg, com_error_m=case.com_error_m)
            margins_rad = () if case.margin_deg is None else (case.margin_deg * DEG,) * 2
            up = case.direction == "up"
            self._sequencer = Crest(loading, CRUISE_M_S, around) if up else Edge(loading, around, *margins_rad)
        return self._sequencer.step(imu, flipper, tracks, around)

    def _around(self, pitch_rad: float) -> KnownNosings:
        """Return the nosings relative to the chair by the belts' travel, the uppermost on the belts' line."""
        error_deg = self._case.slope_error_deg if self._case.direction == "down" else 0.0
        turned_rad, step_m = self._slope_rad + error_deg * DEG - pitch_rad, self._plant.staircase.pitch_m
        below = [(step_m * k * math.cos(turned_rad), step_m * k * math.sin(turned_rad)) for k in range(STEPS)]
        zero_m = min(0.0, below[1][1])
        return KnownNosings(
            pitch_rad, tuple(KnownNosing(self._top_m - along_m, zero_m - down_m, NOSING_SIGMA_M) for along_m, down_m in below[::-1])
        )

    def _is_across(self) -> bool:
        now = self._ticks[-1]
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
            self._plant.set_damage(Damage(flipper_lost=True))
            self._is_lost = True


def _newest(readings: Sequence[Reading]) -> tuple[ImuSample, SeatReading, TrackReading, FlipperReading | None]:
    """Return the newest reading of each kind that the crest needs."""
    newest: dict[type[Reading], Any] = {type(reading): reading for reading in readings}
    return newest[ImuSample], newest[SeatReading], newest[TrackReading], newest.get(FlipperReading)
