"""The driven flipper in the plant: servo, limits, belts, and what is left when its motor dies."""

import numpy as np
import pytest
from chairs import with_piece

from treadline.core.angles import DEG
from treadline.core.ports import Reading, Truth
from treadline.core.signals import FlipperCommand, FlipperReading, SeatCommand, TrackCommand
from treadline.plant.faults import Damage
from treadline.plant.mujoco import MujocoPlant, open_plant
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.scenario.scenario import Chair, Control, Scenario, Stair, Start

ARMED = read_chair("wheelchair")
NOISE_N_M = 2.0


def standing(chair: ChairDescription = ARMED, *, model: str = "wheelchair", payload_kg: float = 50.0) -> MujocoPlant:
    """Return a chair at rest on the landing."""
    scenario = Scenario(
        stair=Stair(walls="none", width_m=4.0, steps=3, landing_m=6.0),
        chair=Chair(model=model, belt_mismatch=0.0, payload_kg=payload_kg),
        control=Control(vision="truth"),
    ).model_copy(update={"start": Start(place="landing")})  # and no plan to go down: without a flipper it has no rear camera
    plant = open_plant(scenario, seed=1, chair=chair)
    plant.start()
    return plant


def turn(
    plant: MujocoPlant, rate_deg_s: float, begin_s: float, end_s: float, *, speed_m_s: float = 0.0
) -> tuple[list[FlipperReading], list[Truth], list[Reading]]:
    """Ask one rate of the flipper for a while."""
    plant.write(
        TrackCommand(t_s=begin_s, left_m_s=speed_m_s, right_m_s=speed_m_s),
        SeatCommand(t_s=begin_s, rate_m_s=0.0),
        FlipperCommand(t_s=begin_s, rate_rad_s=rate_deg_s * DEG),
    )
    plant.advance(end_s)
    readings = list(plant.read())
    return [reading for reading in readings if isinstance(reading, FlipperReading)], list(plant.truth()), readings


def test_a_chair_without_a_flipper_reports_none_and_ignores_its_command() -> None:
    standard, alone = (standing(read_chair("wheelchair-fixed"), model="wheelchair-fixed") for _ in range(2))
    flippers, truth, readings = turn(standard, 20.0, 0.0, 1.0, speed_m_s=0.2)
    alone.write(TrackCommand(t_s=0.0, left_m_s=0.2, right_m_s=0.2), SeatCommand(t_s=0.0, rate_m_s=0.0))
    alone.advance(1.0)
    assert flippers == []
    assert truth == list(alone.truth())
    assert len(readings) == len(alone.read())


@pytest.mark.parametrize("rate_deg_s", [10.0, -20.0])
def test_the_flipper_turns_at_the_rate_asked_and_stops_where_it_is(rate_deg_s: float) -> None:
    plant = standing()
    flippers, _, _ = turn(plant, rate_deg_s, 0.0, 1.0)
    # The servo starts within its torque: 200 N·m on 0.5 kg·m² need a few hundredths of a second.
    assert flippers[-1].angle_rad - flippers[0].angle_rad == pytest.approx(rate_deg_s * DEG, abs=0.5 * DEG)
    stopped, _, _ = turn(plant, 0.0, 1.0, 2.0)
    assert stopped[-1].angle_rad == pytest.approx(flippers[-1].angle_rad, abs=0.3 * DEG)


def test_the_flipper_is_no_faster_than_its_motor_and_stops_at_the_end_of_its_range() -> None:
    flippers, _, _ = turn(standing(), 400.0, 0.0, 2.0)
    angles = np.array([flipper.angle_rad for flipper in flippers]) / DEG
    assert np.diff(angles[20:]).max() / 0.01 < 30.5
    assert angles[-1] == pytest.approx(60.0, abs=0.1)


def test_the_flipper_lifts_the_chair_off_the_landing_and_its_tip_drives() -> None:
    plant = standing()
    turn(plant, -25.0, 0.0, 2.4)
    _, before, _ = turn(plant, 0.0, 2.4, 3.0)
    _, after, _ = turn(plant, 0.0, 3.0, 6.0, speed_m_s=0.2)
    # 20° below the flat run of 0.95 m, a flipper of 0.45 m: asin(0.45 sin 20° / 1.4) is about 6°.
    assert before[-1].pitch_rad == pytest.approx(6.3 * DEG, abs=1.5 * DEG)
    # It stands on the rear and the nose pulleys, and both carry the belt: 3 s less the drives' lag of 0.15 s.
    stair_slope = np.arctan2(0.16, 0.30)
    run_m = (after[-1].x_m - after[0].x_m) / np.cos(stair_slope)
    assert run_m == pytest.approx(0.2 * 2.85, rel=0.03)


def test_a_weak_motor_gives_way_and_owes_nothing_afterwards() -> None:
    plant = standing(with_piece("flipper", torque_n_m=40.0))
    pressed, truth, _ = turn(plant, -25.0, 0.0, 4.0)
    # Lifting a loaded chair by its nose takes some 100 N·m.
    assert abs(truth[-1].pitch_rad) < 0.5 * DEG
    assert min(flipper.torque_n_m for flipper in pressed) == pytest.approx(-40.0, abs=5.0 * NOISE_N_M)
    raised, _, _ = turn(plant, 25.0, 4.0, 5.0)
    # Wound up by full torque over its stiffness at most, 0.4°, the servo answers at once.
    assert raised[-1].angle_rad - pressed[-1].angle_rad > 23.0 * DEG


def test_a_dead_motor_brakes_rising_and_falls_freely() -> None:
    fastest = {}
    for damping in (0.0, 250.0):
        plant = standing(with_piece("flipper", lost_damping_n_m_s_rad=damping))
        turn(plant, -25.0, 0.0, 2.6)
        plant.set_damage(Damage(flipper_lost=True))
        flippers, truth, _ = turn(plant, -25.0, 2.6, 5.6)
        fastest[damping] = max(abs(sample.pitch_rate_rad_s) for sample in truth) / DEG
        assert abs(flippers[-1].torque_n_m) < 5.0 * NOISE_N_M
        assert abs(truth[-1].pitch_rad) < 1.0 * DEG
    assert fastest[0.0] > 3.0 * fastest[250.0]
    plant = standing()
    plant.set_damage(Damage(flipper_lost=True))
    fallen, _, _ = turn(plant, 0.0, 0.0, 1.0)
    # 4 N·m turn rotor and section, 0.5 kg·m², by 40° in well under a second; the brake does not hold that way.
    assert fallen[-1].angle_rad < 1.0 * DEG
