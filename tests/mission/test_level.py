"""On the level: square before it goes, gentle while it goes, and a search that ends."""

import itertools

import pytest
import world
from hypothesis import given, settings
from hypothesis import strategies as st

from treadline.core.angles import DEG
from treadline.core.signals import HeadingEstimate
from treadline.mission._flat_ground_steering import LevelSteering

GAUGE_M, TICK_S = 0.65, 0.01


def estimate(heading_deg: float) -> HeadingEstimate:
    return world.estimate(0.0, heading_deg * DEG)


def turned_by(half_m_s: float, skid: float) -> float:
    """Return how far a chair whose tracks skid turns in a tick."""
    return 2.0 * half_m_s / GAUGE_M / skid * TICK_S


@given(heading=st.floats(-180.0, 180.0))
def test_it_turns_square_and_never_faster_than_its_limit(heading: float) -> None:
    steering = LevelSteering(GAUGE_M)
    halves = [0.0, *(steering.towards(estimate(heading)) for _ in range(200))]
    # Turning left, heading growing, needs the right belt faster: half the difference positive.
    assert all(half * heading <= 0.0 for half in halves)
    # Two seconds are enough to set the belts apart as far as they ever go, gently.
    rate = min(abs(heading) * DEG * 1.5, 10.0 * DEG)
    assert abs(turned_by(halves[-1], 1.27)) == pytest.approx(rate * TICK_S, abs=1e-12)
    steps = [abs(after - before) for before, after in itertools.pairwise(halves)]
    assert max(steps) <= 0.15 * TICK_S + 1e-12


def test_a_turn_that_was_stopped_begins_from_rest() -> None:
    """Test: a chair that turns is braked. Expected result: the next turn sets its belts apart as slowly as the first did."""
    steering = LevelSteering(GAUGE_M)
    first = [steering.towards(estimate(25.0)) for _ in range(30)]
    steering.rest()
    assert [steering.towards(estimate(25.0)) for _ in range(30)] == first


@settings(max_examples=30)
@given(heading=st.floats(-35.0, 35.0), skid=st.floats(1.0, 2.0))
def test_whatever_the_skid_it_is_square_within_ten_seconds(heading: float, skid: float) -> None:
    steering, t_s = LevelSteering(GAUGE_M), 0.0
    while not steering.is_square(estimate(heading), t_s):
        heading += turned_by(steering.towards(estimate(heading)), skid) / DEG
        t_s += TICK_S
        assert t_s < 10.0  # hazard 20
    assert abs(heading) < 1.0


def test_square_means_half_a_second_of_it_and_a_glance_away_starts_anew() -> None:
    steering = LevelSteering(GAUGE_M)
    assert not steering.is_square(estimate(0.5), 0.0)
    assert not steering.is_square(estimate(0.5), 0.4)
    assert not steering.is_square(estimate(1.1), 0.45)
    assert not steering.is_square(estimate(0.9), 0.5)
    assert not steering.is_square(estimate(-0.9), 0.99)
    assert steering.is_square(estimate(-0.9), 1.0)


@given(heading=st.floats(-90.0, 90.0), target=st.floats(-3.0, 3.0))
def test_keeping_a_heading_is_gentle_and_the_right_way_round(heading: float, target: float) -> None:
    half = LevelSteering(GAUGE_M).keep(estimate(heading), target * DEG)
    assert abs(half) <= 0.1
    assert half * (target - heading) >= 0.0


@given(heading=st.floats(-90.0, 90.0), spare=st.floats(0.0, 5.0))
def test_within_what_is_spared_nothing_is_steered_and_beyond_it_gently(heading: float, spare: float) -> None:
    steering = LevelSteering(GAUGE_M)
    half = steering.keep(estimate(heading), spare_rad=spare * DEG)
    if abs(heading) <= spare:
        assert half == 0.0
    assert abs(half) <= abs(steering.keep(estimate(heading)))
    assert half * heading <= 0.0


def search(steering: LevelSteering, skid: float = 1.4) -> tuple[list[float], list[float]]:
    """Return where a blind chair has turned to [deg], and what was asked, tick by tick until the search ends."""
    heading, turned, asked, headings = 0.0, 0.0, [], []
    for k in range(6000):
        half = steering.sweep(k * TICK_S, turned)
        if steering.has_swept():
            return headings, asked
        asked.append(half)
        turned = turned_by(half, skid)
        heading += turned / DEG
        headings.append(heading)
    message = "the search did not end"
    raise AssertionError(message)


@pytest.mark.parametrize("skid", [1.0, 1.4, 2.0])
def test_the_search_looks_first_then_to_both_sides_then_ends_where_it_began(skid: float) -> None:
    headings, asked = search(LevelSteering(GAUGE_M), skid)
    assert asked[:50] == [0.0] * 50  # half a second
    # A leg ends 2° early, and belts that are set apart gently turn the chair on by up to four.
    assert max(headings) == pytest.approx(39.5, abs=2.5)
    assert min(headings) == pytest.approx(-39.5, abs=2.5)
    assert abs(headings[-1]) < 3.5
    assert headings.index(max(headings)) < headings.index(min(headings))
    fastest = max(abs(half) for half in asked)
    # Half the pace of a turn with a target: 10 °/s, a degree a frame.
    assert turned_by(fastest, 1.27) == pytest.approx(10.0 * DEG * TICK_S)
