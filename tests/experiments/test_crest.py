"""Crest, edge and foot on the plant: what the flipper buys, what it bears, and that without it these figures fail."""

from collections.abc import Callable
from functools import partial

import jaxtyping
import pytest
from crossing import CrestCase, Crossing, Direction, cross

from treadline.core.angles import DEG

NOMINAL_DEG_S, WITH_ERRORS_DEG_S, NEVER_DEG_S = 15.0, 20.0, 25.0
SEAT_DEG, PASSENGER_M_S2 = 3.0, 2.5
GRIPS = (1.0, 0.806)
"""Friction at which a tip that reaches 45° down hangs by itself: an empty chair was stuck there before the crest."""

Ride = Callable[[CrestCase], Crossing]
down = partial(CrestCase, direction="down")


@pytest.fixture
def ride(monkeypatch: pytest.MonkeyPatch) -> Ride:
    """Cross without the tests' shape checks, two thirds of a run's time; the last test here has them."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    return cross


def assert_gentle(crossing: Crossing, limit_deg_s: float) -> None:
    assert crossing.pitch_rate_deg_s <= limit_deg_s, crossing
    assert crossing.seat_deg <= SEAT_DEG, crossing
    assert crossing.vertical_m_s2 <= PASSENGER_M_S2, crossing


def last_stage(crossing: Crossing) -> str:
    return crossing.stages[-1][1]


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(CrestCase(slope_deg=30.0), id="up 30"),
        pytest.param(CrestCase(slope_deg=30.0, payload_kg=0.0, friction=GRIPS), id="up, empty, on ground that grips"),
        pytest.param(
            CrestCase(slope_deg=30.0, payload_kg=80.0, com_error_m=0.05, friction=GRIPS, seed=2),
            id="up, loaded behind, on ground that grips",
        ),
        pytest.param(down(slope_deg=30.0), id="down 30"),
        pytest.param(down(slope_deg=26.0, payload_kg=110.0), id="down 26, heavy"),
    ],
)
def test_the_flipper_lets_the_chair_over_gently(ride: Ride, case: CrestCase) -> None:
    crossing = ride(case)
    assert crossing.is_across, crossing
    assert_gentle(crossing, NOMINAL_DEG_S)


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(CrestCase(slope_deg=30.0, payload_kg=0.0, nosing_error_m=-0.15, seed=1), id="early, empty"),
        pytest.param(CrestCase(slope_deg=30.0, heading_deg=10.0, seed=1), id="at an angle, slipping on to a third try"),
        pytest.param(
            CrestCase(slope_deg=26.0, payload_kg=110.0, nosing_error_m=0.10, com_error_m=0.10, heading_deg=-10.0, seed=7),
            id="heavy, late and at an angle",
        ),
        pytest.param(down(gravity_error_deg=2.0), id="down, gravity off by 2 degrees"),
        pytest.param(
            CrestCase(payload_kg=110.0, motor_lost_at_deg=14.0), id="motor dead half way over the crest, let down by its brake"
        ),
        pytest.param(
            down(slope_deg=28.0, nosing_error_m=-0.15, com_error_m=0.10, payload_error_kg=30.0, seed=1),
            id="down, late, weight behind, declared heavier",
        ),
        pytest.param(
            down(slope_deg=30.0, nosing_error_m=0.10, com_error_m=-0.10, slope_error_deg=-1.0, seed=2),
            id="down, early, slope flatter",
        ),
        pytest.param(
            down(slope_deg=25.0, payload_kg=0.0, slope_error_deg=1.0, heading_deg=5.0, seed=3),
            id="down, empty, slope steeper, at an angle",
        ),
        pytest.param(
            down(slope_deg=26.0, payload_kg=110.0, payload_error_kg=-30.0, com_error_m=-0.10, heading_deg=-5.0, seed=4),
            id="down, heavy, weight ahead, at an angle, declared lighter",
        ),
    ],
)
def test_crest_and_top_entry_tolerate_errors_of_the_assumed_chair_and_a_dead_motor(ride: Ride, case: CrestCase) -> None:
    crossing = ride(case)
    assert crossing.is_across, crossing
    assert_gentle(crossing, WITH_ERRORS_DEG_S)


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(down(slope_deg=26.0, payload_kg=110.0, motor_lost_at_deg=14.0, duration_s=20.0), id="half way"),
        pytest.param(down(motor_lost_at_deg=27.0, duration_s=40.0), id="as the front is nearly lifted"),
    ],
)
def test_a_motor_that_dies_over_the_edge_lets_the_chair_back_onto_the_landing(ride: Ride, case: CrestCase) -> None:
    crossing = ride(case)
    assert last_stage(crossing) == "barred"
    assert abs(crossing.ticks[-1].truth.pitch_rad) < 0.01
    assert_gentle(crossing, WITH_ERRORS_DEG_S)


def test_a_motor_that_dies_as_the_rear_comes_down_leaves_the_chair_on_the_flight(ride: Ride) -> None:
    # Lifted to 28.0°, it settles from 27.5° on; the dead flipper props it up by 2° until its brake has let it down.
    crossing = ride(down(motor_lost_at_deg=27.6, duration_s=40.0))
    assert last_stage(crossing) == "done"
    assert crossing.ticks[-1].truth.pitch_rad == pytest.approx(28.0 * DEG, abs=1.0 * DEG)
    assert_gentle(crossing, WITH_ERRORS_DEG_S)


@pytest.mark.parametrize(
    ("case", "about_deg_s"),
    [
        pytest.param(CrestCase(chair="wheelchair-fixed", duration_s=16.0), 106.0, id="crest, no flipper"),
        pytest.param(CrestCase(motor_lost_at_deg=14.0, lost_damping_n_m_s_rad=0.0, duration_s=18.0), 80.0, id="crest, no brake"),
        pytest.param(down(chair="wheelchair-fixed", duration_s=14.0), 114.0, id="edge, no flipper"),
        pytest.param(down(torque_n_m=40.0, margin_deg=-60.0, duration_s=14.0), 77.0, id="edge, 40 N·m, belts that do not wait"),
    ],
)
def test_less_of_a_flipper_falls(ride: Ride, case: CrestCase, about_deg_s: float) -> None:
    # Contact in a fall hangs on the last digit: a fifth either way.
    rate_deg_s = ride(case).pitch_rate_deg_s
    assert rate_deg_s > NEVER_DEG_S
    assert rate_deg_s == pytest.approx(about_deg_s, rel=0.2)


def test_belts_that_do_not_wait_are_borne_by_the_whole_flipper(ride: Ride) -> None:
    # So what falls in the test above falls for want of flipper.
    assert ride(down(margin_deg=-60.0)).pitch_rate_deg_s <= NOMINAL_DEG_S


def test_a_flipper_too_short_in_range_stops_before_the_crest(ride: Ride) -> None:
    crossing = ride(CrestCase(range_deg=(-45.0, 60.0), com_error_m=-0.1, duration_s=8.0))
    assert not crossing.is_across
    assert last_stage(crossing) == "barred"
    assert "a flipper that turns to -45° is too short" in crossing.ticks[-1].command.cause
    assert crossing.pitch_rate_deg_s < NOMINAL_DEG_S


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(down(range_deg=(-45.0, 60.0), duration_s=22.0), id="-45 degrees"),
        pytest.param(down(torque_n_m=40.0, duration_s=18.0), id="40 N·m"),
    ],
)
def test_less_of_a_flipper_that_is_heeded_goes_back_onto_the_landing(ride: Ride, case: CrestCase) -> None:
    crossing = ride(case)
    assert last_stage(crossing) == "barred"
    assert crossing.ticks[-1].truth.x_m > crossing.ticks[0].truth.x_m - 1.0  # still on the landing
    assert_gentle(crossing, NOMINAL_DEG_S)


@pytest.mark.parametrize("direction", ["up", "down"])
def test_at_the_foot_a_tenth_of_a_metre_a_second_is_gentle_with_no_flipper_at_work(ride: Ride, direction: Direction) -> None:
    crossing = ride(CrestCase(at="foot", direction=direction, slope_deg=30.0))
    assert crossing.is_across, crossing
    assert_gentle(crossing, NOMINAL_DEG_S)


@pytest.mark.parametrize("direction", ["up", "down"])
def test_the_same_case_gives_the_same_crossing_and_another_seed_another(direction: Direction) -> None:
    first, again, other = (cross(CrestCase(direction=direction, seed=seed, duration_s=1.0)) for seed in (3, 3, 4))
    assert first.ticks == again.ticks
    assert first.ticks != other.ticks
