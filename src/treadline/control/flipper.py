"""The flipper as a flipper: its geometry on landing and last nosing, and the load on its tip.

What crest and edge share (``control/crest.py``, ``control/edge.py``). ``ImuSample, FlipperReading -> load on the tip``.
"""

import math
from dataclasses import dataclass

from treadline.angles import DEG
from treadline.errors import MechanicsError
from treadline.mechanics.chair import GRAVITY_M_S2, ChairDescription, Flipper
from treadline.mechanics.loading import Loading
from treadline.signals import FlipperReading

CARRIES_N = 80.0
"""Load from which the tip counts as standing: five times what torque noise and the flipper's weight leave in doubt."""
CARRIES_SHARE, PRESS_SHARE = 0.2, 0.3
"""Of the chair's weight, where that is less: a light chair would be lifted off its last nosing."""
CARRIES_S = 0.1
"""For so long: a stop of the rotor is over by then."""
LIFTED_RAD = 1.0 * DEG
"""Of pitch by which the flipper has lifted the chair: its tip carries, however little it weighs."""
UNLOADED_N = 30.0
TIP_S = 0.05
"""Smoothing of the tip's load."""
FLIPPER_RAD_S2 = 120.0 * DEG
"""Change of the flipper's rate: the rotor's inertia then stays under 2 N·m and is no load."""
FLIPPER_PER_S = 2.0
"""Rate of a flipper that is brought to an angle, per angle that is left."""
OVER_BELTS_RAD = 2.0 * DEG
"""Where it waits, a little above the belts: in line with them it would carry on the nosings, and keep the chair from turning."""
SMALL_RAD = 8.0 * DEG
"""Below this pitch the flipper's angle tells the pivot's distance no more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlipperGeometry:
    """Chair, flipper and landing in the plane: belts on the last nosing, tip on the landing."""

    pivot_m: float
    """Of the front pulley's axis ahead of mid-track."""
    radius_m: float
    arm_m: float

    def depression(self, pitch_rad: float, past_m: float) -> float:
        """Return the flipper's angle below the level when its tip stands on the landing.

        Args:
            past_m: Of the pivot beyond the nosing, along the belts.
        """
        drop = past_m * math.sin(pitch_rad) - self.radius_m * (1.0 - math.cos(pitch_rad))
        return math.asin(min(max(drop / self.arm_m, -0.99), 0.99))

    def past(self, pitch_rad: float, angle_rad: float) -> float:
        """Return how far the pivot is beyond the nosing when the tip stands at this angle of the flipper: the inverse.

        Worth asking above ``SMALL_RAD`` of pitch alone: belts that lie level say nothing of where the nosing is.
        """
        drop = self.arm_m * math.sin(-(angle_rad + pitch_rad))
        return (drop + self.radius_m * (1.0 - math.cos(pitch_rad))) / math.sin(pitch_rad)

    def rates(self, pitch_rad: float, past_m: float) -> tuple[float, float]:
        """Return the flipper's change of angle per pitch, and per metre past the nosing [rad/m], tip on the landing."""
        level = self.arm_m * math.cos(self.depression(pitch_rad, past_m))
        per_pitch = (past_m * math.cos(pitch_rad) - self.radius_m * math.sin(pitch_rad)) / level
        return -(1.0 + per_pitch), -math.sin(pitch_rad) / level

    def reach(self, pitch_rad: float, past_m: float) -> float:
        """Return how far ahead of the nosing the tip stands, on the level."""
        level = self.arm_m * math.cos(self.depression(pitch_rad, past_m))
        return past_m * math.cos(pitch_rad) - self.radius_m * math.sin(pitch_rad) + level

    def slide(self, pitch_rad: float, past_m: float) -> float:
        """Return how far the tip slides over the landing per pitch that the chair goes down [m/rad]: ``-d reach / d pitch``."""
        c, s = math.cos(pitch_rad), math.sin(pitch_rad)
        sinks_m = past_m * c - self.radius_m * s
        return past_m * s + self.radius_m * c + math.tan(self.depression(pitch_rad, past_m)) * sinks_m


class Tip:
    """Load on the flipper's tip, smoothed, and for how long it has carried or not."""

    def __init__(self, loading: Loading) -> None:
        self._flipper = flipper_of(loading.chair)
        self._flipper_m = loading.chair.tracks.approach_m
        self._carries_n = min(CARRIES_N, CARRIES_SHARE * loading.weight_n)
        self._carried_s = 0.0
        self.load_n = 0.0
        self.unloaded_s = 0.0

    @property
    def carries(self) -> bool:
        """Whether it stands on something."""
        return self._carried_s > CARRIES_S

    def step(self, pitch_rad: float, flipper: FlipperReading, dt_s: float) -> None:
        """Take one tick's reading."""
        self.load_n += (self._load(pitch_rad, flipper) - self.load_n) * (1.0 - math.exp(-dt_s / TIP_S))
        self._carried_s = self._carried_s + dt_s if self.load_n > self._carries_n else 0.0
        self.unloaded_s = self.unloaded_s + dt_s if self.load_n < UNLOADED_N else 0.0

    def _load(self, pitch_rad: float, flipper: FlipperReading) -> float:
        """Return the tip's load from the motor's torque: what holds the flipper up, less its weight."""
        lever = self._flipper_m * math.cos(flipper.angle_rad + pitch_rad)
        if lever < 0.3 * self._flipper_m:
            return 0.0
        return 0.5 * self._flipper.mass_kg * GRAVITY_M_S2 - flipper.torque_n_m / lever


class FlipperRate:
    """The rate asked of the flipper, bounded in itself and in its change."""

    def __init__(self, flipper: Flipper) -> None:
        self._limit_rad_s = flipper.max_rate_deg_s * DEG
        self._rate_rad_s = 0.0

    def step(self, wanted_rad_s: float, dt_s: float) -> float:
        """Return what of a rate can be had now."""
        change = FLIPPER_RAD_S2 * dt_s
        rate = min(max(wanted_rad_s, self._rate_rad_s - change), self._rate_rad_s + change)
        self._rate_rad_s = min(max(rate, -self._limit_rad_s), self._limit_rad_s)
        return self._rate_rad_s


def geometry_of(chair: ChairDescription) -> FlipperGeometry:
    """Return the chair's flipper in the plane."""
    tracks = chair.tracks
    return FlipperGeometry(pivot_m=0.5 * tracks.flat_run_m, radius_m=tracks.pulley_radius_m, arm_m=tracks.approach_m)


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
