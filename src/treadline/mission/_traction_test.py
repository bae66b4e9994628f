"""Traction test: accelerate on two nosings, the rear just off the floor, with slightly more friction demand than the flight needs.

``ImuSample, TrackReading -> belt speed, slip, verdict``; hazard 15. At pitch θ and acceleration a the belts need friction of
tan θ + a/(g·cos θ); a is chosen such that this equals (1 + share)·tan β. With less friction the chair falls behind its belts. Its
speed is the integral of the IMU's specific force along the chair, minus gravity and the bias measured at rest.
"""

import math

from treadline.control.belt_allocation import GENTLE_M_S2
from treadline.core.signals import ImuSample, TrackReading
from treadline.scenario.chair import GRAVITY_M_S2
from treadline.vehicle.traction import NORMAL_SLIP, RESERVE, TEST_EXCESS, friction_needed

DEMAND = 0.085
"""Friction demand of the pulse in excess of tan β, as a share of tan β."""
PULSE_S = 0.6
"""Duration of the pulse, and of the rest before it [s]; gravity and bias are averaged over the second half of the rest."""


class TractionTest:
    """One test pulse of the belts and its verdict.

    Args:
        slope_rad: Slope β of the flight [rad].
        pulse: Number of this pulse among those on one flight.
    """

    def __init__(self, slope_rad: float, pulse: int = 1) -> None:
        self._slope_rad = slope_rad
        self.pulse = pulse
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
        """Update with one signal; a test during which the belts were braked begins again."""
        if isinstance(signal, TrackReading):
            if signal.brake_on:
                self._begin()
            self._belts_m_s = 0.5 * (signal.left_m_s + signal.right_m_s)
            return
        if self._began_s is None:
            self._began_s = self._t_s = signal.t_s
        since, dt_s = signal.t_s - self._began_s, signal.t_s - self._t_s
        self._t_s = signal.t_s
        push = signal.linear_acceleration_m_s2[0] - GRAVITY_M_S2 * math.sin(signal.pitch_rad)
        if 0.5 * PULSE_S < since <= PULSE_S:
            self._rest_sum += push
            self._pitch_rad = signal.pitch_rad
            self._rest_count += 1
        elif since > PULSE_S and self._slip is None:
            self._moved_m_s += dt_s * (push - self._rest_sum / max(self._rest_count, 1))
            if since > 2.0 * PULSE_S:
                # Belts that stall lose the test: they are counted as the slowest that a pulse asks for.
                self._slip = 1.0 - self._moved_m_s / max(self._belts_m_s, GENTLE_M_S2 * PULSE_S)

    @property
    def speed_m_s(self) -> float:
        """Belt speed to command at present [m/s]."""
        since = 0.0 if self._began_s is None else self._t_s - self._began_s - PULSE_S
        if since <= 0.0 or since > PULSE_S:
            return 0.0
        return self._asked_m_s2 * since

    @property
    def _asked_m_s2(self) -> float:
        # With the chair pitched more than the stair, gravity alone demands the required friction; a smaller acceleration than the
        # gentle one is below the resolution of the measurement.
        return max(self._speeding_up(DEMAND), GENTLE_M_S2)

    def _speeding_up(self, share: float) -> float:
        """Return the acceleration along the belts that needs friction of (1 + share)·tan β [m/s²]."""
        friction = friction_needed(self._slope_rad, share)
        return GRAVITY_M_S2 * (friction * math.cos(self._pitch_rad) - math.sin(self._pitch_rad))

    @property
    def over(self) -> bool:
        """Whether the pulse has ended; after a passed test the belts continue without a jolt."""
        return self._slip is not None

    @property
    def slip(self) -> float:
        """Slip ratio at the end of the pulse; 0 before."""
        return 0.0 if self._slip is None else self._slip

    @property
    def holds(self) -> bool:
        """Whether the friction suffices, by that which ``check`` asks for, and the excess of this test.

        A chair that is pitched more than the stair must still follow the belts by the ratio that may slip normally.
        """
        least_m_s2 = self._speeding_up(RESERVE + TEST_EXCESS)
        return self.slip < 1.0 - max(least_m_s2 / self._asked_m_s2, NORMAL_SLIP)
