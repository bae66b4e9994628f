"""The traction test: on two nosings, the rear still on the floor, ask the belts for a little more than the stair will.

Hazard 15. Pitched by θ and speeding up at a, belts ask friction for tan θ + a/(g·cos θ) of the normal force; a is chosen such that
this is (1 + share)·tan β. Where friction gives less, the chair falls behind its belts. The IMU tells by how much: specific force
along the chair, less what gravity and the sensor's bias were at rest.
"""

import math
from dataclasses import dataclass

from treadline.mechanics.chair import GRAVITY_M_S2
from treadline.signals import ImuSample, TrackReading

LEAST_M_S2 = 0.15
"""Asked at least: of a chair that is pitched more than the stair gravity alone asks for what is wanted; less could not be told."""
MOST_SLIP = 0.7
"""A chair that follows less of its belts has shown no grip, whatever it was asked for."""
STALLED_M_S = 0.02
"""Belts that the pulse has brought no further have shown nothing, whatever the IMU's noise adds up to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TractionConfig:
    """How hard the belts ask, and what counts as no."""

    share: float = 0.085
    """Over tan β."""
    wanted: float = 0.065
    """Over tan β, which friction must give: between the 1.05 that must be refused and the 1.10 that must not."""
    rest_s: float = 0.6
    """To rest before the pulse; its second half is what gravity and bias are taken from."""
    pulse_s: float = 0.6
    brake_s: float = 0.3


class TractionTest:
    """One pulse of the belts and its verdict."""

    def __init__(self, config: TractionConfig, slope_rad: float) -> None:
        self._config = config
        self._slope_rad = slope_rad
        self._begin()

    def _begin(self) -> None:
        self._pitch_rad = self._slope_rad
        self._began_s: float | None = None
        self._t_s = 0.0
        self._rest_sum, self._rest_count = 0.0, 0
        self._moved_m_s = 0.0
        self._belts_m_s = 0.0
        self._slip: float | None = None

    def update(self, signal: ImuSample | TrackReading) -> None:
        """Take one signal. A test whose belts are braked has shown nothing, and begins again once they are free."""
        if isinstance(signal, TrackReading):
            if signal.brake_on:
                self._begin()
            self._belts_m_s = 0.5 * (signal.left_m_s + signal.right_m_s)
            return
        if self._began_s is None:
            self._began_s = self._t_s = signal.t_s
        since, dt_s = signal.t_s - self._began_s, signal.t_s - self._t_s
        self._t_s = signal.t_s
        push = float(signal.linear_acceleration_m_s2[0]) - GRAVITY_M_S2 * math.sin(signal.pitch_rad)
        if 0.5 * self._config.rest_s < since <= self._config.rest_s:
            self._rest_sum += push
            self._pitch_rad = signal.pitch_rad
            self._rest_count += 1
        elif since > self._config.rest_s and self._slip is None:
            self._moved_m_s += dt_s * (push - self._rest_sum / max(self._rest_count, 1))
            if since > self._config.rest_s + self._config.pulse_s:
                self._slip = 1.0 - self._moved_m_s / self._belts_m_s if self._belts_m_s > STALLED_M_S else 1.0

    @property
    def speed_m_s(self) -> float:
        """What the belts are to do now."""
        since = 0.0 if self._began_s is None else self._t_s - self._began_s - self._config.rest_s
        if since <= 0.0 or since > self._config.pulse_s:
            return 0.0
        return self._asked_m_s2 * since

    @property
    def _asked_m_s2(self) -> float:
        return max(self._speeding_up(self._config.share), LEAST_M_S2)

    def _speeding_up(self, share: float) -> float:
        """Return the acceleration along the belts at which they ask for friction of (1 + share)·tan β."""
        friction = (1.0 + share) * math.tan(self._slope_rad)
        return GRAVITY_M_S2 * (friction * math.cos(self._pitch_rad) - math.sin(self._pitch_rad))

    @property
    def over(self) -> bool:
        """Whether the pulse is over, and the stop after one that did not hold: belts that hold go on, a stop would be a jolt."""
        since = -math.inf if self._began_s is None else self._t_s - self._began_s - self._config.rest_s - self._config.pulse_s
        return self._slip is not None and since > (0.0 if self.holds else self._config.brake_s)

    @property
    def slip(self) -> float:
        """Share of the belts' speed that the chair did not follow, at the pulse's end."""
        return 0.0 if self._slip is None else self._slip

    @property
    def holds(self) -> bool:
        """Whether friction gave what was wanted."""
        return self.slip < min(1.0 - self._speeding_up(self._config.wanted) / self._asked_m_s2, MOST_SLIP)
