"""The leveller on the simulated seat: sensor, loop, actuator, linkage and 50 kg, as in Fig. 11."""

import numpy as np
import pytest
from jaxtyping import Float
from oracles.plant_runs import plant_on

from treadline.control.seat_leveller import Leveller
from treadline.core.angles import DEG
from treadline.core.ports import Truth
from treadline.core.signals import SeatCommand, SeatReading, TrackCommand
from treadline.plant.mujoco import MujocoPlant
from treadline.scenario.chair import read_chair
from treadline.vehicle.linkage import SeatLinkage

SEAT = read_chair("wheelchair").seat


def on_the_flight(slope_deg: float, seat: str) -> MujocoPlant:
    return plant_on(slope_deg, seed=0, start={"seat": seat})


def levelled(plant: MujocoPlant, speed_m_s: float, duration_s: float) -> list[Truth]:
    """Close the seat's loop at 100 Hz while the belts run, and return the truth."""
    leveller = Leveller(SEAT)
    tracks = TrackCommand(t_s=0.0, left_m_s=speed_m_s, right_m_s=speed_m_s)
    for tick in range(1, round(duration_s / 0.01) + 1):
        reading = [reading for reading in plant.read() if isinstance(reading, SeatReading)][-1]
        plant.write(tracks, leveller.step(reading))
        plant.advance(0.01 * tick)
    return list(plant.truth())


def driven(rate_m_s: float, duration_s: float) -> tuple[list[Truth], Float[np.ndarray, " n"]]:
    """Hold one actuator rate from a level seat at 28°, and return the truth and the strokes."""
    plant = on_the_flight(28.0, "level")
    plant.write(TrackCommand.stop(0.0), SeatCommand(t_s=0.0, rate_m_s=rate_m_s))
    plant.advance(duration_s)
    strokes = [reading.stroke_m for reading in plant.read() if isinstance(reading, SeatReading)]
    return list(plant.truth()), np.array(strokes)


@pytest.mark.parametrize(("slope_deg", "speed_m_s"), [(25.0, 0.0), (28.0, 0.0), (28.0, 0.2), (30.0, 0.2)])
def test_a_seat_that_leans_with_the_chair_is_level_within_four_seconds(slope_deg: float, speed_m_s: float) -> None:
    samples = levelled(on_the_flight(slope_deg, "chassis"), speed_m_s, 5.0)
    pitch_deg = np.array([sample.seat_pitch_rad for sample in samples]) / DEG
    # It starts as steep as the chassis, which sinks into its nosings by a tenth or two of a degree.
    assert pitch_deg[0] == pytest.approx(slope_deg, abs=0.3)
    # The loop goes idle within its dead band of 0.1°; what the sensor's noise of 0.05° still moves stays inside.
    assert np.abs(pitch_deg[400:]).max() < 0.1
    # With damping above one it never tips forward.
    assert pitch_deg.min() > -0.1


@pytest.mark.parametrize(("rate_m_s", "end"), [(5.0, 1), (-5.0, 0)], ids=["out", "in"])
def test_the_actuator_keeps_its_rate_and_stops_at_its_ends(rate_m_s: float, end: int) -> None:
    samples, strokes = driven(rate_m_s, 3.0)
    assert strokes[-1] == SEAT.stroke_m[end]
    fastest = float(np.abs(np.diff(strokes)).max()) / 0.01
    assert 0.95 * SEAT.max_rate_m_s < fastest <= SEAT.max_rate_m_s * (1.0 + 1e-9)
    # At the end of its stroke the seat stands at the linkage's angle: chassis pitch less that.
    expected = samples[-1].pitch_rad - SeatLinkage(SEAT).angle(float(strokes[-1]))
    assert samples[-1].seat_pitch_rad == pytest.approx(expected, abs=0.2 * DEG)


def test_the_seats_sensor_has_its_noise_and_no_offset() -> None:
    plant = on_the_flight(28.0, "level")
    plant.write(TrackCommand.stop(0.0), SeatCommand(t_s=0.0, rate_m_s=0.0))
    plant.advance(10.0)
    readings = [reading.pitch_rad for reading in plant.read() if isinstance(reading, SeatReading)]
    errors = (np.array(readings) - [sample.seat_pitch_rad for sample in plant.truth()]) / DEG
    # 1001 samples give the standard deviation to 2.2 % and the mean to 0.0016°.
    assert errors.std() == pytest.approx(0.05, rel=0.08)
    assert abs(errors.mean()) < 0.006
