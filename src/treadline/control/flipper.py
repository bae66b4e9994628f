"""Flipper on landing and last nosing: its geometry, the load on its tip, and the base of the crest and edge sequences.

``ImuSample, FlipperReading -> load on the tip``. ``ImuSample, FlipperReading, TrackReading -> PitchCommand``: clock, nosing
position, tip load, one command per tick. ``control/crest_sequence.py`` and ``control/edge_sequence.py`` add their stages.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Generic, TypeVar

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.core.signals import FlipperCommand, FlipperReading, ImuSample, TrackReading
from treadline.estimation.known_nosings import KnownNosings
from treadline.scenario.chair import GRAVITY_M_S2, ChairDescription, Flipper
from treadline.vehicle.loading import Loading, plumb

SLOW_M_S = 0.1
"""Belt speed onto a stair, off a stair and near the landing's edge [m/s]."""
TURN_RAD_S, TURN_RAD_S2 = 9.0 * DEG, 20.0 * DEG
"""Largest rate of the pitch [rad/s], and its angular acceleration at the start [rad/s²]: 0.2 m/s² at the passenger, half a metre
from the nosing."""
REACH_RAD_S = 16.0 * DEG
"""Rate at which the flipper reaches down for the landing [rad/s]; half of it at the expected contact, where the whole caused 3 m/s²
under a light chair."""
FLIPPER_RAD_S = 15.0 * DEG
"""Largest rate of a flipper that moves freely to an angle [rad/s]."""
STOW_RAD_S = 12.0 * DEG
"""Rate at which the flipper is raised from the landing [rad/s]."""
GENTLY_RAD_S = 4.0 * DEG
"""Rate of belts or an unloaded tip that touch the landing, and of a flipper that a chair may lean on or not follow [rad/s]: 5 cm/s
at the seat."""
YIELDS_RAD_S = 20.0 * DEG
"""Rate at which a flipper yields to a load of its full motor torque [rad/s]. With 200 N·m this is a spring of 1150 N·m/rad and a
damper of 570 N·m·s/rad, which lowers a chair that passes a high nosing. At twice the rate the servo oscillates."""
THERE_RAD = 5.0 * DEG
"""Angle off the commanded one within which the flipper is where it is to be [rad]."""
PLACE_M = 0.03
"""Error of the centre of mass's place before a nosing, by the tip's load or the map [m]: 5 % of weight and reach at
0.6 m of reach."""
CARRIES_N = 80.0
"""Load above which the tip counts as standing [N]: five times the uncertainty from torque noise and flipper weight."""
CARRIES_SHARE = 0.2
"""The same load as a share of the chair's weight, if smaller: a light chair would lift off its last nosing."""
CARRIES_S = 0.1
"""Duration above that load before the tip counts as standing [s]; longer than a rotor stop."""
LIFTED_RAD = 1.0 * DEG
"""Pitch by which the flipper has lifted the chair [rad]; the tip then carries at any load. The reference of the pitch leads by no
more."""
UNLOADED_SHARE = 0.375
"""Share of the load of a standing tip below which the tip counts as unloaded: 30 N, twice the uncertainty, under a heavy chair."""
TIP_S = 0.05
"""Time constant of the tip load filter [s]."""
FLIPPER_RAD_S2 = 120.0 * DEG
"""Angular acceleration limit of the flipper [rad/s²]: keeps the rotor's inertia torque below 2 N·m."""
FLIPPER_PER_S = 2.0
"""Rate of flipper or pitch per remaining angle [1/s]."""
OVER_BELTS_RAD = 2.0 * DEG
"""Waiting angle slightly above the belts [rad]: in line with them the flipper would carry load and impede turning."""
OFF_RAD = 4.0 * DEG
"""Pitch off the one at which the belts lie, at which the flipper props the chair up, or has yielded [rad]."""
LIES_RAD = 0.7 * DEG
"""Pitch below which the belts lie on floor or landing [rad], despite the error of gravity."""
PATIENCE_S = 8.0
"""Time to wait for the flipper to carry, to lift by one degree, or to stow, and for belts on the first nosings to come further [s]:
0.8 m of slow belts; a weak or dead motor exceeds it."""
SMALL_RAD = 8.0 * DEG
"""Pitch below which the flipper's angle no longer determines the distance of the pivot [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlipperGeometry:
    """Planar geometry of chair, flipper and landing: belts on one nosing, tip on a landing ``landing_m`` above that nosing."""

    pivot_m: float
    """Distance of the front pulley's axis ahead of mid-track [m]."""
    radius_m: float
    length_m: float

    def depression(self, pitch_rad: float, past_m: float, landing_m: float = 0.0) -> float:
        """Return the flipper's angle below horizontal with its tip on the landing [rad].

        Args:
            pitch_rad: Chair pitch.
            past_m: Distance of the pivot beyond the nosing, along the belts.
            landing_m: Height of the landing above the nosing.
        """
        drop = past_m * math.sin(pitch_rad) - self.radius_m * (1.0 - math.cos(pitch_rad)) - landing_m
        return math.asin(min(max(drop / self.length_m, -0.99), 0.99))

    def past(self, pitch_rad: float, angle_rad: float, landing_m: float = 0.0) -> float:
        """Return the distance of the pivot beyond the nosing for a flipper angle [m], tip on the landing.

        Inverse of ``depression``; meaningful only above ``SMALL_RAD`` of pitch, because horizontal belts do not determine the
        position of the nosing.
        """
        drop = self.length_m * math.sin(-(angle_rad + pitch_rad))
        return (drop + landing_m + self.radius_m * (1.0 - math.cos(pitch_rad))) / math.sin(pitch_rad)

    def rates(self, pitch_rad: float, past_m: float, landing_m: float = 0.0) -> tuple[float, float]:
        """Return the change of flipper angle per pitch, and per metre past the nosing [rad/m], tip on the landing."""
        level = self.length_m * math.cos(self.depression(pitch_rad, past_m, landing_m))
        per_pitch = (past_m * math.cos(pitch_rad) - self.radius_m * math.sin(pitch_rad)) / level
        return -(1.0 + per_pitch), -math.sin(pitch_rad) / level

    def reach(self, pitch_rad: float, past_m: float, landing_m: float = 0.0) -> float:
        """Return the horizontal distance of the tip ahead of the nosing [m]."""
        level = self.length_m * math.cos(self.depression(pitch_rad, past_m, landing_m))
        return past_m * math.cos(pitch_rad) - self.radius_m * math.sin(pitch_rad) + level

    def slide(self, pitch_rad: float, past_m: float, landing_m: float = 0.0) -> float:
        """Return the sliding distance of the tip over the landing per pitch reduction [m/rad]: ``-d reach / d pitch``."""
        c, s = math.cos(pitch_rad), math.sin(pitch_rad)
        sinks_m = past_m * c - self.radius_m * s
        return past_m * s + self.radius_m * c + math.tan(self.depression(pitch_rad, past_m, landing_m)) * sinks_m


class Tip:
    """Filtered load on the flipper's tip, and its durations above and below the thresholds."""

    def __init__(self, loading: Loading) -> None:
        self._flipper = flipper_of(loading.chair)
        self._flipper_m = loading.chair.tracks.approach_m
        self.carries_n = min(CARRIES_N, CARRIES_SHARE * loading.weight_n)
        """Load above which the tip counts as standing [N]."""
        self._carried_s = 0.0
        self.load_n = 0.0
        self.unloaded_s = 0.0

    @property
    def carries(self) -> bool:
        """Whether the tip stands on a surface."""
        return self._carried_s > CARRIES_S

    @property
    def is_unloaded(self) -> bool:
        """Whether nothing leans on the tip."""
        return self.load_n < UNLOADED_SHARE * self.carries_n

    def step(self, pitch_rad: float, flipper: FlipperReading, dt_s: float) -> None:
        """Take the reading of one tick."""
        self.load_n += (self._load(pitch_rad, flipper) - self.load_n) * (1.0 - math.exp(-dt_s / TIP_S))
        self._carried_s = self._carried_s + dt_s if self.load_n > self.carries_n else 0.0
        self.unloaded_s = self.unloaded_s + dt_s if self.is_unloaded else 0.0

    def _load(self, pitch_rad: float, flipper: FlipperReading) -> float:
        """Return the tip load from the motor torque: the torque that supports the flipper minus its weight."""
        lever = self._flipper_m * math.cos(flipper.angle_rad + pitch_rad)
        if lever < 0.3 * self._flipper_m:
            return 0.0
        return 0.5 * self._flipper.mass_kg * GRAVITY_M_S2 - flipper.torque_n_m / lever


class _FlipperRate:
    """Limiter of the flipper's rate and acceleration."""

    def __init__(self, flipper: Flipper) -> None:
        self._limit_rad_s = flipper.max_rate_deg_s * DEG
        self._rate_rad_s = 0.0

    def step(self, wanted_rad_s: float, dt_s: float) -> float:
        """Return the achievable rate closest to the wanted rate."""
        change = FLIPPER_RAD_S2 * dt_s
        rate = min(max(wanted_rad_s, self._rate_rad_s - change), self._rate_rad_s + change)
        self._rate_rad_s = min(max(rate, -self._limit_rad_s), self._limit_rad_s)
        return self._rate_rad_s


def load_share(flipper: FlipperReading, most_n_m: float) -> float:
    """Return the load that turns the flipper up, as a share of its motor's torque."""
    return max(-flipper.torque_n_m / most_n_m, 0.0)


def flipper_of(chair: ChairDescription) -> Flipper:
    """Return the chair's flipper.

    Raises:
        MechanicsError: If it has none.
    """
    if chair.flipper is None:
        raise MechanicsError(
            f"chair {chair.name!r} has no driven flipper, and falls over a crest at 120 degrees a second; "
            "use wheelchair, or end the run before the last nosing"
        )
    return chair.flipper


StageT = TypeVar("StageT", bound=str)
STEP_MAX_S = 0.1
"""Longest time step [s]; a longer pause does not count as waiting for belts or flipper."""
REFINE_S = 0.2
"""Time constant with which the flipper's angle corrects the nosing position [s]."""


@dataclass(frozen=True, kw_only=True)  # with slots, an alias such as CrestCommand could not make one (Python 3.11)
class PitchCommand(Generic[StageT]):
    """Belt speed and flipper rate commanded by a sequence."""

    t_s: float
    stage: StageT
    speed_m_s: float
    """Speed of both belts [m/s]; negative backs down."""
    flipper: FlipperCommand
    tip_n: float
    """Load on the flipper's tip from motor torque [N]."""
    is_unloaded: bool
    """Whether nothing leans on the tip."""
    cause: str = ""
    """Reason for a retry or for stopping; otherwise empty."""


class Sequencer(ABC, Generic[StageT]):
    """State machine for one crossing of the landing's edge.

    Args:
        loading: Chair and assumed load.
        stage: Initial stage.
        around: Nosings around the chair.
    """

    def __init__(self, loading: Loading, stage: StageT, around: KnownNosings) -> None:
        self._loading = loading
        self._flipper = flipper_of(loading.chair)
        tracks = loading.chair.tracks
        self._geometry = FlipperGeometry(
            pivot_m=0.5 * tracks.flat_run_m, radius_m=tracks.pulley_radius_m, length_m=tracks.approach_m
        )
        self._tip = Tip(loading)
        self._rate = _FlipperRate(self._flipper)
        self._lowest_rad = self._flipper.range_deg[0] * DEG
        self._rest_rad = tracks.approach_angle_deg * DEG
        self._stage = stage
        self._cause = ""
        self._around = around
        self._offset_m = 0.0
        """Place of the nosings by contact of the flipper, less their place by the stair tracker, along the belts [m]."""
        self._t_s: float | None = None
        self._lead_rad = self._lead_rad_s = 0.0
        """Reference of the pitch [rad] and its rate [rad/s]."""

    def step(self, imu: ImuSample, flipper: FlipperReading, tracks: TrackReading, around: KnownNosings) -> PitchCommand[StageT]:
        """Return the command for one tick. While the brake is on, time does not advance and the reference is held."""
        dt_s = 0.0 if self._t_s is None else min(max(imu.t_s - self._t_s, 0.0), STEP_MAX_S)
        self._t_s = imu.t_s
        speed = 0.5 * (tracks.left_m_s + tracks.right_m_s)
        self._around = around
        pitch = imu.pitch_rad
        self._tip.step(pitch, flipper, dt_s)
        if tracks.brake_on:
            dt_s = 0.0
            self._rate = _FlipperRate(self._flipper)
            self._lead_from(pitch)
        self._sequence(pitch, flipper, dt_s)
        belts, rate = self._act(pitch, flipper, speed, dt_s)
        return PitchCommand(
            t_s=imu.t_s,
            stage=self._stage,
            speed_m_s=belts,
            flipper=FlipperCommand(t_s=imu.t_s, rate_rad_s=self._rate.step(rate, dt_s)),
            tip_n=self._tip.load_n,
            is_unloaded=self._tip.is_unloaded,
            cause=self._cause,
        )

    @abstractmethod
    def _sequence(self, pitch: float, flipper: FlipperReading, dt_s: float) -> None:
        """Enter the next stage when its condition holds."""

    @abstractmethod
    def _act(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> tuple[float, float]:
        """Return belt speed [m/s] and flipper rate [rad/s]."""

    def _lead_from(self, pitch: float) -> None:
        """Restart the pitch reference at the given pitch, from rest."""
        self._lead_rad, self._lead_rad_s = pitch, 0.0

    @property
    def _ahead_m(self) -> float:
        """Distance of the crossed nosing ahead of mid-track, along the belts [m]."""
        return self._around.crossed.ahead_m + self._offset_m

    @property
    def _edge_past_m(self) -> float:
        """Distance of the flipper's axis beyond the landing's edge, along the belts [m]."""
        return self._geometry.pivot_m - self._around.top.ahead_m - self._offset_m

    @property
    def _place(self) -> tuple[float, float]:
        """How far the flipper's axis is past the crossed nosing, along the belts, and the landing's height above that [m]."""
        return self._geometry.pivot_m - self._ahead_m, self._around.landing_m

    def _most_before_m(self, pitch: float) -> float:
        """Return how far before the landing's edge the centre of mass may be for the flipper to stand on the landing [m].

        Infinite for nearly horizontal belts, from which the flipper always reaches down to the landing.
        """
        if pitch <= SMALL_RAD:
            return math.inf
        return self._geometry.past(pitch, self._lowest_rad) - self._geometry.pivot_m + plumb(self._loading, pitch)

    def _lies(self, ahead_m: float = 0.0) -> tuple[float, float]:
        """Return the pitch at which the belts lie with the edge ahead of mid-track, and its standard deviation [rad].

        Without a distance, the edge is at mid-track: there the centre of mass passes it.
        """
        return self._around.lies(self._geometry.pivot_m, ahead_m, self._geometry.radius_m)

    def _com_beyond(self, pitch: float) -> float:
        """Return the distance of the centre of mass's plumb line beyond the crossed nosing, along the belts [m]."""
        return plumb(self._loading, pitch) - self._ahead_m

    def _towards(self, angle_rad: float, flipper: FlipperReading) -> float:
        """Return the rate that moves the flipper to an angle above the belts."""
        return FLIPPER_PER_S * (angle_rad - flipper.angle_rad)

    def _reach(self, pitch: float, flipper: FlipperReading) -> float:
        """Return the rate of a flipper that reaches down for the landing, slower near the expected contact."""
        return -min(max(FLIPPER_PER_S * self._to_go(pitch, flipper), 0.5 * REACH_RAD_S), REACH_RAD_S)

    def _to_go(self, pitch: float, flipper: FlipperReading) -> float:
        """Return the flipper's angle above the expected contact of its tip with the landing."""
        return flipper.angle_rad + pitch + self._geometry.depression(pitch, *self._place)

    def _refine(self, pitch: float, flipper: FlipperReading, dt_s: float) -> None:
        """Correct the place of the nosings by the flipper's angle: belts on the crossed one, tip on the landing."""
        if not self._tip.is_unloaded:
            self._offset_m += (self._by_the_flipper(pitch, flipper) - self._offset_m) * (1.0 - math.exp(-dt_s / REFINE_S))

    def _by_the_flipper(self, pitch: float, flipper: FlipperReading) -> float:
        """Return the offset by a tip on the landing; the previous one for nearly horizontal belts."""
        if pitch <= SMALL_RAD:
            return self._offset_m
        past_m = self._geometry.past(pitch, flipper.angle_rad, self._around.landing_m)
        return self._geometry.pivot_m - past_m - self._around.crossed.ahead_m
