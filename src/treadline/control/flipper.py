"""The flipper: load on its tip, a rate that it can follow, and the rates and waits of what commands it.

``ImuSample, FlipperReading -> load on the tip``. ``wanted rate -> FlipperCommand's rate``.
"""

import math

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.core.signals import FlipperReading
from treadline.scenario.chair import GRAVITY_M_S2, ChairDescription, Flipper
from treadline.vehicle.loading import Loading

SLOW_M_S = 0.1
"""Belt speed onto a stair, off a stair and near the landing's edge [m/s]."""
FLIPPER_RAD_S = 15.0 * DEG
"""Largest rate of a flipper that moves freely to an angle [rad/s]."""
GENTLY_RAD_S = 4.0 * DEG
"""Rate of belts or an unloaded tip that touch the landing, and of a flipper that a chair may lean on or not follow [rad/s]: 5 cm/s
at the seat."""
YIELDS_RAD_S = 20.0 * DEG
"""Rate at which a flipper yields to a load of its full motor torque [rad/s]. With 200 N·m this is a spring of 1150 N·m/rad and a
damper of 570 N·m·s/rad, which lowers a chair that passes a high nosing. At twice the rate the servo oscillates."""
THERE_RAD = 5.0 * DEG
"""Angle off the commanded one within which the flipper is where it is to be [rad]."""
CARRIES_N = 80.0
"""Load above which the tip counts as standing [N]: five times the uncertainty from torque noise and flipper weight."""
CARRIES_SHARE = 0.2
"""The same load as a share of the chair's weight, if smaller: a light chair would lift off its last nosing."""
CARRIES_S = 0.1
"""Duration above that load before the tip counts as standing [s]; longer than a rotor stop."""
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
"""Pitch below which the chair still stands on the floor, and off that of the flight at which its belts lie on it [rad]."""
LIES_RAD = 0.7 * DEG
"""Pitch below which the belts lie on floor or landing [rad], despite the error of gravity."""
PATIENCE_S = 8.0
"""Time in which a chair must come further over the end of a flight [s]: 0.8 m of slow belts; a weak or dead motor exceeds it."""


class Tip:
    """Filtered load on the flipper's tip, and how long it has been above the threshold."""

    def __init__(self, loading: Loading) -> None:
        self._flipper = flipper_of(loading.chair)
        self._flipper_m = loading.chair.tracks.approach_m
        self.carries_n = min(CARRIES_N, CARRIES_SHARE * loading.weight_n)
        """Load above which the tip counts as standing [N]."""
        self._carried_s = 0.0
        self.load_n = 0.0

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

    def _load(self, pitch_rad: float, flipper: FlipperReading) -> float:
        """Return the tip load from the motor torque: the torque that supports the flipper minus its weight."""
        lever = self._flipper_m * math.cos(flipper.angle_rad + pitch_rad)
        if lever < 0.3 * self._flipper_m:
            return 0.0
        return 0.5 * self._flipper.mass_kg * GRAVITY_M_S2 - flipper.torque_n_m / lever


class FlipperRate:
    """Limiter of the flipper's rate and acceleration."""

    def __init__(self, flipper: Flipper) -> None:
        self._limit_rad_s = flipper.max_rate_deg_s * DEG
        self._rate_rad_s = 0.0

    def stop(self) -> None:
        """Begin from rest."""
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
