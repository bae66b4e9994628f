"""Base of the crest and edge sequences: clock, nosing position, tip load, one command per tick.

``ImuSample, FlipperReading, TrackReading -> PitchCommand``. ``crest_sequence.py`` and ``edge_sequence.py`` add their stages.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeVar

from treadline.control.flipper_geometry import FLIPPER_PER_S, SMALL_RAD, UNLOADED_N, FlipperRate, Tip, flipper_of, geometry_of
from treadline.core.angles import DEG
from treadline.core.signals import FlipperCommand, FlipperReading, ImuSample, TrackReading
from treadline.vehicle.loading import Loading, plumb

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
    cause: str = ""
    """Reason for a retry or for stopping; otherwise empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceConfig(Loading):
    """Chair, assumed load and what both sequences share."""

    cruise_m_s: float = 0.2
    """Belt speed before the sequence slows down [m/s]."""
    slow_within_m: float = 0.5
    """Distance before the nosing (crest), or before the pressing position (edge), at which the chair slows down [m]."""
    trim_per_s: float = 2.0
    """Flipper rate per pitch lag behind the reference [1/s]."""
    patience_s: float = 8.0
    """Time to wait for the flipper to carry, to lift by one degree, or to stow [s]; a weak or dead motor exceeds it."""


class Sequencer(ABC, Generic[StageT]):
    """State machine for one crossing of the landing's nosing.

    Args:
        loading: Chair and load.
        stage: Initial stage.
        nosing_ahead_m: Distance of that nosing ahead of mid-track along the belts, at the first step.
    """

    UNTOUCHED: ClassVar[frozenset[str]]
    """Stages without a contact that determines the position of the nosing."""

    def __init__(self, loading: Loading, stage: StageT, nosing_ahead_m: float) -> None:
        self._loading = loading
        self._geometry = geometry_of(loading.chair)
        self._tip = Tip(loading)
        self._rate = FlipperRate(flipper_of(loading.chair))
        self._rest_rad = loading.chair.tracks.approach_angle_deg * DEG
        self._stage = stage
        self._cause = ""
        self._ahead_m = nosing_ahead_m
        self._t_s: float | None = None
        self._lead_rad = self._lead_rad_s = 0.0
        """Reference of the pitch [rad] and its rate [rad/s]."""

    def step(self, imu: ImuSample, flipper: FlipperReading, tracks: TrackReading) -> PitchCommand[StageT]:
        """Return the command for one tick. While the brake is on, time does not advance and the reference is held."""
        dt_s = 0.0 if self._t_s is None else min(max(imu.t_s - self._t_s, 0.0), STEP_MAX_S)
        self._t_s = imu.t_s
        speed = 0.5 * (tracks.left_m_s + tracks.right_m_s)
        self._ahead_m -= speed * dt_s
        pitch = imu.pitch_rad
        self._tip.step(pitch, flipper, dt_s)
        if tracks.brake_on:
            dt_s = 0.0
            self._rate = FlipperRate(flipper_of(self._loading.chair))
            self._lead_from(pitch)
        self._sequence(pitch, flipper, dt_s)
        belts, rate = self._act(pitch, flipper, speed, dt_s)
        return PitchCommand(
            t_s=imu.t_s,
            stage=self._stage,
            speed_m_s=belts,
            flipper=FlipperCommand(t_s=imu.t_s, rate_rad_s=self._rate.step(rate, dt_s)),
            tip_n=self._tip.load_n,
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
    def _past_m(self) -> float:
        """Distance of the flipper's axis beyond the nosing, along the belts [m]."""
        return self._geometry.pivot_m - self._ahead_m

    def _com_beyond(self, pitch: float) -> float:
        """Return the distance of the centre of mass's plumb line beyond the nosing, along the belts [m]."""
        return plumb(self._loading, pitch) - self._ahead_m

    def _towards(self, angle_rad: float, flipper: FlipperReading) -> float:
        """Return the rate that moves the flipper to an angle above the belts."""
        return FLIPPER_PER_S * (angle_rad - flipper.angle_rad)

    def _see(self, ahead_m: float) -> None:
        """Update the position of the nosing, as long as no contact has measured it."""
        if self._stage in self.UNTOUCHED:
            self._ahead_m = ahead_m

    def _refine(self, pitch: float, flipper: FlipperReading, dt_s: float) -> None:
        """Correct the position of the nosing from the flipper's angle: belts on the nosing, tip on the landing."""
        if self._tip.load_n > UNLOADED_N:
            self._ahead_m += (self._by_the_flipper(pitch, flipper) - self._ahead_m) * (1.0 - math.exp(-dt_s / REFINE_S))

    def _by_the_flipper(self, pitch: float, flipper: FlipperReading) -> float:
        """Return the distance of the nosing ahead with the tip on the landing; the previous value for nearly horizontal belts."""
        if pitch <= SMALL_RAD:
            return self._ahead_m
        return self._geometry.pivot_m - self._geometry.past(pitch, flipper.angle_rad)
