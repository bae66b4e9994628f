"""The crest on the plant: what the arm buys, what it bears, and that without it these figures fail."""

import pytest

from treadline.experiments.crest import CrestCase, Crossing, cross

NOMINAL_DEG_S, WITH_ERRORS_DEG_S = 15.0, 20.0
SEAT_DEG, PASSENGER_M_S2 = 3.0, 2.5


def assert_gentle(crossing: Crossing, limit_deg_s: float) -> None:
    assert crossing.is_across, crossing
    assert crossing.pitch_rate_deg_s <= limit_deg_s, crossing
    assert crossing.seat_deg <= SEAT_DEG, crossing
    assert crossing.vertical_m_s2 <= PASSENGER_M_S2, crossing


@pytest.mark.parametrize("slope_deg", [25.0, 30.0])
def test_the_arm_lets_the_chair_down_gently(slope_deg: float) -> None:
    assert_gentle(cross(CrestCase(slope_deg=slope_deg)), NOMINAL_DEG_S)


@pytest.mark.parametrize(
    "case",
    [
        CrestCase(slope_deg=28.0, nosing_error_m=-0.15, com_error_m=-0.10, seed=1),
        CrestCase(slope_deg=30.0, com_error_m=0.10, seed=2),
        CrestCase(slope_deg=25.0, payload_kg=0.0, seed=3),
        CrestCase(slope_deg=26.0, payload_kg=110.0, nosing_error_m=0.10, com_error_m=0.10, heading_deg=-10.0, seed=7),
    ],
    ids=["early", "weight behind", "empty", "heavy, late and askew"],
)
def test_it_bears_what_the_chair_believes_wrongly(case: CrestCase) -> None:
    assert_gentle(cross(case), WITH_ERRORS_DEG_S)


def test_a_motor_that_dies_half_way_lets_the_chair_down_on_its_brake() -> None:
    assert_gentle(cross(CrestCase(payload_kg=110.0, motor_lost_at_deg=14.0)), WITH_ERRORS_DEG_S)


@pytest.mark.parametrize(
    "case",
    [
        CrestCase(chair="wheelchair-fixed", duration_s=16.0),
        CrestCase(torque_n_m=40.0, duration_s=18.0),
        CrestCase(range_deg=(-45.0, 60.0), com_error_m=-0.10, duration_s=18.0),
        CrestCase(motor_lost_at_deg=14.0, lost_damping_n_m_s_rad=0.0, duration_s=18.0),
    ],
    ids=["no arm", "40 N·m", "-45 degrees, centre of mass believed too far back", "dead motor without a brake"],
)
def test_less_of_an_arm_falls(case: CrestCase) -> None:
    # About 106, 54, 38 and 80 °/s: the limit above tells them apart with room to spare.
    assert cross(case).pitch_rate_deg_s > 1.5 * WITH_ERRORS_DEG_S


def test_an_arm_too_short_in_range_stays_before_the_crest_when_it_knows_where_its_weight_is() -> None:
    crossing = cross(CrestCase(range_deg=(-45.0, 60.0), duration_s=16.0))
    assert not crossing.is_across
    assert crossing.stages[-1][1] == "carry"
    assert crossing.pitch_rate_deg_s < NOMINAL_DEG_S


def test_the_same_case_gives_the_same_crossing_and_another_seed_another() -> None:
    first, again, other = (cross(CrestCase(seed=seed, duration_s=3.0)) for seed in (3, 3, 4))
    assert first.moments == again.moments
    assert first.moments != other.moments
