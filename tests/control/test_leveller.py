"""Seat levelling loop with linkage and an actuator with lag, rate limit and ends of stroke."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.control.seat_leveller import DEAD_BAND_RAD, Leveller
from treadline.core.angles import DEG
from treadline.core.signals import SeatCommand, SeatReading
from treadline.scenario.chair import Seat, read_chair
from treadline.vehicle.linkage import SeatLinkage

TICK_S = 0.01
SEAT = read_chair("wheelchair").seat
LINKAGE = SeatLinkage(SEAT)
DEAD_BAND_DEG = DEAD_BAND_RAD / DEG


def reading(pitch_rad: float, stroke_m: float = 0.05, t_s: float = 0.0) -> SeatReading:
    return SeatReading(t_s=t_s, pitch_rad=pitch_rad, stroke_m=stroke_m)


@dataclass
class SeatOnStair:
    """Seat on a chassis of constant pitch."""

    chassis_pitch_rad: float
    seat: Seat = SEAT
    noise_rad: float = 0.0
    stroke_m: float = field(default_factory=lambda: LINKAGE.stroke(0.0))
    rate_m_s: float = 0.0

    @property
    def pitch_rad(self) -> float:
        return self.chassis_pitch_rad - LINKAGE.angle(self.stroke_m)

    def move(self, command: SeatCommand) -> None:
        self.rate_m_s += (command.rate_m_s - self.rate_m_s) * TICK_S / self.seat.lag_s
        low, high = self.seat.stroke_m
        self.stroke_m = min(max(self.stroke_m + TICK_S * self.rate_m_s, low), high)

    def run(self, seconds: float, seed: int = 0) -> tuple[list[float], list[float]]:
        """Return the seat's pitch [deg] and the commanded rates [m/s], tick by tick."""
        rng = np.random.default_rng(seed)
        leveller = Leveller(self.seat)
        pitch_deg, rates = [], []
        for k in range(round(seconds / TICK_S)):
            pitch_deg.append(self.pitch_rad / DEG)
            measured = self.pitch_rad + self.noise_rad * float(rng.normal())
            command = leveller.step(reading(measured, self.stroke_m, k * TICK_S))
            rates.append(command.rate_m_s)
            self.move(command)
        return pitch_deg, rates


@pytest.mark.parametrize("slope_deg", [-5.0, 0.0, 10.0, 25.0, 28.0, 30.0, 40.0])
def test_every_slope_within_the_linkages_range_is_levelled_without_overshoot(slope_deg: float) -> None:
    pitch_deg, rates = SeatOnStair(slope_deg * DEG).run(5.0)
    # The actuator's 17 °/s need 1.7 s for 28°, the loop's 0.5 s a few more time constants to the dead band.
    assert abs(pitch_deg[-1]) <= DEAD_BAND_DEG
    assert max(abs(rate) for rate in rates) <= SEAT.max_rate_m_s
    # Monotone up to rounding: the seat never moves away from level, so there is no overshoot.
    assert max(math.copysign(1.0, slope_deg) * np.diff(pitch_deg)) < 1e-9
    assert min(math.copysign(1.0, slope_deg) * np.array(pitch_deg)) > -DEAD_BAND_DEG


def test_sensor_noise_hardly_moves_the_seat() -> None:
    pitch_deg, _ = SeatOnStair(28.0 * DEG, noise_rad=0.05 * DEG).run(10.0, seed=3)
    # The dead band is twice this noise; inside it one reading in twenty moves the actuator, by less than the noise itself.
    assert max(abs(pitch) for pitch in pitch_deg[600:]) < 2.0 * DEAD_BAND_DEG
    assert np.std(pitch_deg[600:]) < 0.05


def test_a_slope_beyond_the_linkage_ends_at_the_end_of_the_stroke_and_stays() -> None:
    chair = SeatOnStair(50.0 * DEG)
    _, rates = chair.run(6.0)
    assert chair.stroke_m == SEAT.stroke_m[1]
    # The actuator is not pushed against its stop.
    assert rates[-1] == 0.0


@pytest.mark.parametrize(("stroke", "out"), [(SEAT.stroke_m[1], 1.0), (SEAT.stroke_m[0], -1.0), (9.0, 1.0), (-9.0, -1.0)])
def test_no_rate_is_asked_beyond_an_end_of_the_stroke_and_the_way_back_is_free(stroke: float, out: float) -> None:
    assert Leveller(SEAT).step(reading(out * 20.0 * DEG, stroke)).rate_m_s == 0.0
    # Front up (positive) needs a longer stroke, front down a shorter one.
    assert out * Leveller(SEAT).step(reading(-out * 20.0 * DEG, stroke)).rate_m_s < 0.0


@pytest.mark.parametrize(("pitch", "stroke"), [(math.nan, 0.05), (math.inf, 0.05), (0.3, math.nan), (-math.inf, math.inf)])
def test_a_reading_that_is_not_a_number_moves_nothing_then_and_later(pitch: float, stroke: float) -> None:
    leveller = Leveller(SEAT)
    before = leveller.step(reading(0.2))
    assert leveller.step(reading(pitch, stroke)) == SeatCommand(t_s=0.0, rate_m_s=0.0)
    assert leveller.step(reading(0.2)) == before


@given(pitch=st.floats(min_value=-math.pi, max_value=math.pi), stroke=st.floats(min_value=-1.0, max_value=1.0))
def test_the_rate_keeps_its_limit_and_works_against_the_pitch(pitch: float, stroke: float) -> None:
    rate = Leveller(SEAT).step(reading(pitch, stroke)).rate_m_s
    assert abs(rate) <= SEAT.max_rate_m_s
    assert rate * pitch >= 0.0
    if abs(pitch) <= DEAD_BAND_DEG * DEG:
        assert rate == 0.0


@given(stroke=st.floats(min_value=SEAT.stroke_m[0] + 1e-6, max_value=SEAT.stroke_m[1] - 1e-6))
def test_just_outside_the_dead_band_the_seat_turns_at_the_gain_wherever_the_linkage_stands(stroke: float) -> None:
    pitch = 1.01 * DEAD_BAND_DEG * DEG
    rate = Leveller(SEAT).step(reading(pitch, stroke)).rate_m_s
    # Seat rate = rate ratio × stroke rate = 2 /s × pitch: the linkage's own gain is compensated, up to rounding.
    assert rate * LINKAGE.rate_ratio(stroke) == pytest.approx(2.0 * pitch, rel=1e-9)
