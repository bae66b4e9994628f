"""What crest and edge share: a clock, the place of the nosing, the load on the flipper's tip, one command a tick.

``ImuSample, FlipperReading, TrackReading -> PitchCommand``. ``control/crest.py`` and ``control/edge.py`` add their stages.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeVar

from treadline.angles import DEG
from treadline.control.flipper import FLIPPER_PER_S, SMALL_RAD, UNLOADED_N, FlipperRate, Tip, flipper_of, geometry_of
from treadline.mechanics.loading import Loading, plumb
from treadline.signals import FlipperCommand, FlipperReading, ImuSample, TrackReading

StageT = TypeVar("StageT", bound=str)
STEP_MAX_S = 0.1
"""A longer pause is not time in which belts or flipper were waited for."""
REFINE_S = 0.2
"""In which the flipper's angle corrects the nosing's place."""


@dataclass(frozen=True, kw_only=True)  # with slots, an alias such as CrestCommand could not make one (Python 3.11)
class PitchCommand(Generic[StageT]):
    """What a crossing asks of belts and flipper."""

    t_s: float
    stage: StageT
    speed_m_s: float
    """Of both belts; negative backs down."""
    flipper: FlipperCommand
    tip_n: float
    """Load on the flipper's tip, as the torque tells it."""
    cause: str = ""
    """Why a stage begins again, or the chair is barred; empty otherwise."""


class Sequencer(ABC, Generic[StageT]):
    """One crossing of the landing's nosing, stage by stage.

    Args:
        nosing_ahead_m: Of that nosing ahead of mid-track along the belts, at the first step.
    """

    UNTOUCHED: ClassVar[frozenset[str]]
    """Stages in which no contact tells where the nosing is."""

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
        """Where the flipper leads the pitch to, and how fast."""

    def step(self, imu: ImuSample, flipper: FlipperReading, tracks: TrackReading) -> PitchCommand[StageT]:
        """Answer one tick's readings. A braked chair is held: nobody obeys, so nothing is waited for, and nothing speeds up."""
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
        """Enter the next stage where it is due."""

    @abstractmethod
    def _act(self, pitch: float, flipper: FlipperReading, speed: float, dt_s: float) -> tuple[float, float]:
        """Return belt speed and flipper rate."""

    def _lead_from(self, pitch: float) -> None:
        """Lead the pitch from here, from rest."""
        self._lead_rad, self._lead_rad_s = pitch, 0.0

    @property
    def _past_m(self) -> float:
        """Of the flipper's axis beyond the nosing, along the belts."""
        return self._geometry.pivot_m - self._ahead_m

    def _com_beyond(self, pitch: float) -> float:
        """Return how far the plumb line through the centre of mass is beyond the nosing, along the belts."""
        return plumb(self._loading, pitch) - self._ahead_m

    def _towards(self, angle_rad: float, flipper: FlipperReading) -> float:
        """Return the rate that brings the flipper to an angle above the belts."""
        return FLIPPER_PER_S * (angle_rad - flipper.angle_rad)

    def _see(self, ahead_m: float) -> None:
        """Take a better place of the nosing, as long as no contact tells it."""
        if self._stage in self.UNTOUCHED:
            self._ahead_m = ahead_m

    def _refine(self, pitch: float, flipper: FlipperReading, dt_s: float) -> None:
        """Let the flipper's angle tell where the nosing is: belts on it, tip on the landing."""
        if self._tip.load_n > UNLOADED_N:
            self._ahead_m += (self._by_the_flipper(pitch, flipper) - self._ahead_m) * (1.0 - math.exp(-dt_s / REFINE_S))

    def _by_the_flipper(self, pitch: float, flipper: FlipperReading) -> float:
        """Return how far ahead the nosing is, the tip on the landing; as known before where the belts lie too level to tell."""
        if pitch <= SMALL_RAD:
            return self._ahead_m
        return self._geometry.pivot_m - self._geometry.past(pitch, flipper.angle_rad)
