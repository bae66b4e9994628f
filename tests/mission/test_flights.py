"""Two flights with a landing between: the phases come twice, a landing is no missing step, one that is too short is refused."""

from collections.abc import Sequence

import numpy as np
import pytest
from world import RISE_M, RUN_M, SLOPE_RAD, stair

from treadline.core.signals import StairMap
from treadline.estimation.stair_tracker import StairTracker
from treadline.run.episode import Traverse, traverse
from treadline.run.resolve import checked as check
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario
from treadline.scenario.shipped_files import shipped_controller

# Maps that a nosing, a gap and the next flight need, and the pause after which that is looked at anew (docs/decisions/0019).
KNOWN_AFTER, GAP_KNOWN_AFTER, NEXT_MAPS, NEXT_S = 2, 6, 5, 1.0
BETWEEN_M, STEPS = 2.5, 6
FLOOR_M, MAPPED_STEPS = 1.0, 4
"""Distance of the first nosing ahead of mid-track [m], and number of steps of the first flight, in the scripted maps."""


def scenario(direction: str, **stair: object) -> Scenario:
    place = "floor" if direction == "up" else "landing"
    return Scenario.model_validate(
        {
            "stair": {"slope_deg": 27, "steps": STEPS, "flights": 2, "landing_m": 3.0} | stair,
            "start": {"place": place},
            "drive": {"direction": direction, "duration_s": 150},
            "control": {"vision": "truth" if direction == "up" else "robust"},
            "sensors": {"camera": "statistical"},
        }
    )


@pytest.fixture(scope="module", params=["up", "down"])
def ride(request: pytest.FixtureRequest) -> Traverse:
    return traverse(scenario(request.param), controller=shipped_controller("wheelchair"), seed=2)


def test_two_flights_are_driven_in_the_same_phases_one_after_the_other(ride: Traverse) -> None:
    one = (
        ["search", "align", "approach", "mount", "traction", "climb", "crest", "land"]
        if ride.scenario.drive.direction == "up"
        else ["search", "align", "approach", "edge", "descend", "leave"]
    )
    assert (ride.verdict, ride.cause) == ("arrived", None)
    assert [phase for _, phase in ride.scores.phases] == [*one, *one, "arrived"]
    # Nominal: 15 °/s, as with one flight.
    assert ride.scores.max_pitch_rate_deg_s <= 15.0
    assert ride.scores.seat_max_deg <= 3.0
    assert ride.scores.min_stability_margin_deg > 0.0
    assert any("a landing" in (event.cause or "") for event in ride.events)


def test_the_chair_has_come_past_both_flights(ride: Traverse) -> None:
    stair = ride.scenario.stair
    # Truth's x runs on along the first flight's plane: two flights, the landing and a riser by their shares of it.
    c, s = np.cos(stair.slope_rad), np.sin(stair.slope_rad)
    along = (2 * (stair.steps - 1) * stair.run_m + stair.between_m) * c + (2 * stair.steps - 1) * stair.rise_m * s
    assert abs(ride.scores.climbed_m) > along


def test_a_landing_that_is_too_short_is_refused_with_the_depth_it_must_have() -> None:
    chair = read_chair("wheelchair")
    report = check(scenario("up", between_m=1.5), chair)
    assert report.verdict == "refuse"
    assert report.reasons == ["the landing between two flights is 1.50 m deep, the chair needs 2.00 m; take another way"]
    assert check(scenario("up", between_m=2.0), chair).verdict == "go"
    assert check(scenario("up", between_m=1.5, flights=1), chair).verdict == "go"


def test_missing_steps_of_every_flight_are_checked() -> None:
    chair = read_chair("wheelchair")
    gap = check(scenario("up", missing_steps=[STEPS + 1, STEPS + 2]), chair)
    assert gap.verdict == "refuse"
    assert any("at nosing" in reason for reason in gap.reasons)  # of the second flight, which begins at the seventh


def map_of(t_s: float, places: Sequence[tuple[float, float]], *, up: bool = True) -> StairMap:
    """Return a map for a chair that stands level at the foot of the first flight, or at the top of the second."""
    return stair(t_s, [(x, 0.0, z) for x, z in places], direction="up" if up else "down")


FIRST = [(FLOOR_M + k * RUN_M, (k + 1) * RISE_M) for k in range(MAPPED_STEPS)]
SECOND = [(FIRST[-1][0] + BETWEEN_M + k * RUN_M, FIRST[-1][1] + (k + 1) * RISE_M) for k in range(3)]


def downward(places: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the same places for a chair that stands above and behind them."""
    return [(-x, RISE_M - z) for x, z in places]


@pytest.mark.parametrize("up", [True, False])
def test_a_flight_across_a_landing_is_another_one_and_shows_where_this_one_ends(*, up: bool) -> None:
    first, second = (FIRST, SECOND) if up else (downward(FIRST), downward(SECOND))
    where = StairTracker()
    for k in range(KNOWN_AFTER):
        where.update(map_of(0.1 * k, first, up=up))
    before = where.ahead_m()
    assert not where.top_ends
    assert not where.bottom_ends
    for k in range(NEXT_MAPS):
        assert not where.shows_another
        where.update(map_of(0.3 + 0.1 * k, second, up=up))
    assert where.ahead_m() == before
    assert where.gaps_ahead_m() == []
    assert where.shows_another
    assert where.top_ends is up
    assert where.bottom_ends is not up


@pytest.mark.parametrize("missing", [1, 2, 3])
def test_missing_steps_stay_a_gap_in_this_flight(missing: int) -> None:
    where = StairTracker()
    beyond = [(FIRST[-1][0] + (missing + 1 + k) * RUN_M, FIRST[-1][1] + (missing + 1 + k) * RISE_M) for k in range(3)]
    for k in range(2 * GAP_KNOWN_AFTER):
        where.update(map_of(0.1 * k, FIRST if k < GAP_KNOWN_AFTER else beyond))
    assert where.gaps_ahead_m() == [pytest.approx((FIRST[-1][0], beyond[0][0]))]
    assert not where.shows_another


def test_a_flight_not_seen_for_a_while_is_looked_at_anew() -> None:
    where = StairTracker()
    near = [(x - 1.5, z) for x, z in SECOND]
    for k in range(NEXT_MAPS):
        where.update(map_of(0.1 * k, FIRST))
    for k in range(NEXT_MAPS):
        where.update(map_of(1.0 + 0.1 * k, near))
    assert where.shows_another
    where.update(map_of(1.5 + NEXT_S, near))
    assert not where.shows_another


def test_a_chair_that_wakes_up_on_a_flight_is_not_on_the_one_it_sees_across_the_landing() -> None:
    where = StairTracker()
    where.pitch_rad = SLOPE_RAD
    for k in range(KNOWN_AFTER):
        where.update(map_of(0.1 * k, [(2.5 + 0.3 * i, -1.1 + 0.1 * i) for i in range(3)]))
    assert where.map_count == 0
    assert where.top_ahead_m() is None
