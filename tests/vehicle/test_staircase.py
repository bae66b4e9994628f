"""Staircase in the world as described by the scenario."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.scenario.scenario import Stair
from treadline.vehicle.stair_solids import Box, stair_boxes
from treadline.vehicle.staircase import Staircase, build_staircase

# Literals, so that a changed value in the code is detected here.
TREAD_THICKNESS_M = 0.04


def build(seed: int = 1, **keys: object) -> Staircase:
    return build_staircase(Stair.model_validate(keys), np.random.default_rng(seed))


def span_z(box: Box) -> tuple[float, float]:
    return box.centre_W[2] - box.half_m[2], box.centre_W[2] + box.half_m[2]


def span_x(box: Box) -> tuple[float, float]:
    return box.centre_W[0] - box.half_m[0], box.centre_W[0] + box.half_m[0]


def treads(staircase: Staircase) -> list[Box]:
    return [box for box in stair_boxes(staircase) if box.kind in ("step", "landing")]


@given(rise=st.floats(0.05, 0.3), run=st.floats(0.15, 0.6), steps=st.integers(2, 60))
def test_without_jitter_the_nosings_lie_on_one_line_one_pitch_apart(rise: float, run: float, steps: int) -> None:
    staircase = build(rise_m=rise, run_m=run, steps=steps)
    assert staircase.pitch_m == pytest.approx(math.hypot(rise, run), rel=1e-12)
    in_S = (staircase.nosings_W - staircase.p_WS) @ staircase.R_WS
    expected = np.outer(np.arange(steps) * math.hypot(rise, run), [1.0, 0.0, 0.0])
    np.testing.assert_allclose(staircase.nosings_W[0], [0.0, 0.0, rise])
    # Heights are summed step by step: rounding grows with the 60 of them.
    np.testing.assert_allclose(in_S, expected, atol=1e-12)


@given(rise=st.floats(0.01, 0.3), landing=st.floats(0.6, 3.0))
def test_one_step_is_a_kerb(rise: float, landing: float) -> None:
    """Test: ``steps = 1``. Expected result: a floor, one nosing at W's origin, and a landing of the given depth behind it."""
    staircase = build(rise_m=rise, steps=1, landing_m=landing, walls="none")
    floor, kerb = stair_boxes(staircase)
    np.testing.assert_allclose(staircase.nosings_W, [[0.0, 0.0, rise]], atol=1e-12)
    assert (floor.kind, kerb.kind) == ("floor", "landing")
    assert span_x(kerb) == pytest.approx((0.0, landing))
    assert span_z(kerb)[1] == pytest.approx(rise)
    assert staircase.last_nosing_m == pytest.approx(0.0)
    assert staircase.pitch_m == pytest.approx(math.hypot(rise, 0.30))


def test_jitter_comes_from_the_seed_alone() -> None:
    keys = {"rise_jitter_m": 0.005, "nosing_yaw_jitter_deg": 1.0}
    assert build(3, **keys) == build(3, **keys)
    assert build(3, **keys).steps != build(4, **keys).steps


def test_jitter_has_the_requested_standard_deviation() -> None:
    staircase = build(5, steps=2000, rise_jitter_m=0.004, nosing_yaw_jitter_deg=2.0, slope_deg=28)
    assert staircase.slope_rad == pytest.approx(math.radians(28.0), rel=1e-12)
    # The standard deviation of 2000 draws is known to 1/√4000 = 1.6 %; 8 % is five sigma.
    assert np.std([step.rise_m for step in staircase.steps]) == pytest.approx(0.004, rel=0.08)
    assert np.degrees(np.std([step.yaw_rad for step in staircase.steps])) == pytest.approx(2.0, rel=0.08)


@given(missing=st.sets(st.integers(0, 8)))
def test_a_missing_step_leaves_neither_box_nor_nosing_and_moves_no_other(missing: set[int]) -> None:
    whole, holed = (build(7, steps=10, rise_jitter_m=0.01, missing_steps=sorted(gone)) for gone in (set(), missing))
    there = [index for index in range(10) if index not in missing]
    assert [box.index for box in treads(holed)] == there
    np.testing.assert_array_equal(holed.nosings_W, whole.nosings_W[there])


def test_closed_risers_leave_no_gap_and_open_ones_do() -> None:
    for below, above in pairwise(treads(build())):
        assert span_z(above)[0] < span_z(below)[1]
    for below, above in pairwise(treads(build(open_risers=True))):
        assert span_z(above)[0] - span_z(below)[1] == pytest.approx(0.16 - TREAD_THICKNESS_M)


@given(jitter=st.floats(0.0, 0.01), open_risers=st.booleans())
def test_each_tread_begins_at_its_nosing_and_reaches_under_the_next(jitter: float, open_risers: bool) -> None:
    staircase = build(2, rise_jitter_m=jitter, open_risers=open_risers)
    for step, box in zip(staircase.steps, treads(staircase), strict=True):
        assert span_z(box)[1] == pytest.approx(step.z_m)
        assert span_x(box)[0] == pytest.approx(step.x_m)
        assert span_x(box)[1] > step.x_m + step.depth_m or box.kind == "landing"


def test_a_turned_nosing_keeps_its_front_at_mid_width() -> None:
    staircase = build(2, nosing_yaw_jitter_deg=3.0)
    for step, box in zip(staircase.steps, treads(staircase), strict=True):
        front = np.array(box.centre_W[:2]) - box.half_m[0] * np.array([math.cos(box.yaw_rad), math.sin(box.yaw_rad)])
        np.testing.assert_allclose(front, [step.x_m, 0.0], atol=1e-12)
        assert box.yaw_rad == step.yaw_rad


@pytest.mark.parametrize(("landing_m", "depth_m"), [(1.5, 1.5), (0.0, 0.30)])
def test_the_last_tread_is_the_landing_and_never_less_than_a_step(landing_m: float, depth_m: float) -> None:
    last = treads(build(landing_m=landing_m))[-1]
    assert last.kind == "landing"
    assert 2.0 * last.half_m[0] == pytest.approx(depth_m)


@pytest.mark.parametrize(("walls", "sides"), [("none", []), ("left", [1.0]), ("right", [-1.0]), ("both", [1.0, -1.0])])
def test_walls_stand_at_the_requested_sides(walls: str, sides: list[float]) -> None:
    staircase = build(walls=walls, width_m=2.0)
    found = [box for box in stair_boxes(staircase) if box.kind == "wall"]
    assert [math.copysign(1.0, box.centre_W[1]) for box in found] == sides
    for box in found:
        assert abs(box.centre_W[1]) - box.half_m[1] == pytest.approx(1.0)  # flush with the flight
        assert span_z(box)[1] > staircase.steps[-1].z_m + 2.0


@given(flights=st.integers(2, 4), steps=st.integers(2, 8), between_m=st.floats(0.5, 4.0))
def test_each_flight_is_the_first_one_moved_over_a_landing(flights: int, steps: int, between_m: float) -> None:
    staircase = build(flights=flights, steps=steps, between_m=between_m)
    assert staircase.pitch_m == pytest.approx(math.hypot(0.16, 0.30), rel=1e-12)
    first = np.array([(step.x_m, step.z_m) for step in staircase.flights[0]])
    onward = np.array([(steps - 1) * 0.30 + between_m, steps * 0.16])
    for k, flight in enumerate(staircase.flights):
        np.testing.assert_allclose([(step.x_m, step.z_m) for step in flight], first + k * onward, atol=1e-9)
    for lower, upper in pairwise(staircase.flights):
        assert lower[-1].depth_m == pytest.approx(upper[0].x_m - lower[-1].x_m)
    assert [box.index for box in treads(staircase) if box.kind == "landing"] == [(k + 1) * steps - 1 for k in range(flights)]


@pytest.mark.parametrize("open_risers", [False, True])
def test_below_an_open_flight_the_floor_goes_on(open_risers: bool) -> None:
    """Expected result: a camera that looks through the risers sees a floor, as in a building, and no drop."""
    boxes = stair_boxes(build(steps=6, landing_m=2.0, open_risers=open_risers))
    (floor,) = (box for box in boxes if box.kind == "floor")
    assert span_x(floor)[0] == pytest.approx(-6.5)
    assert span_z(floor)[1] == pytest.approx(0.0)
    assert (span_x(floor)[1] > 5 * 0.30 + 2.0) == open_risers


def test_walls_leave_the_landing_between_two_flights_free() -> None:
    staircase = build(flights=2, steps=5, walls="left", between_m=2.0)
    lower, upper = (span_x(box) for box in stair_boxes(staircase) if box.kind == "wall")
    assert lower == pytest.approx((0.0, 1.2))
    assert upper == pytest.approx((3.2, 4.4))
