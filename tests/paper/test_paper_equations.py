"""Equations of the paper that are one line of code each: offset, state space, Markov parameters, Hankel, cost, seat."""

import math

import numpy as np
import pytest
from jaxtyping import Float

from treadline.control import lqr_gain
from treadline.core import paper
from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError, PoorExcitation
from treadline.core.linear_systems import impulse_response, simulate
from treadline.estimation.offset import heading_offset
from treadline.experiments.as_printed import paper_model
from treadline.identification import era
from treadline.identification._deconvolution import deconvolve, input_matrix
from treadline.identification._era import hankel
from treadline.scenario.chair import read_chair
from treadline.vehicle.linkage import SeatLinkage
from treadline.vehicle.tracks import minimum_track_length, nosings_touched

Markov = Float[np.ndarray, "n p m"]


@pytest.fixture
def markov() -> Markov:
    return impulse_response(paper_model(), 20)


def test_equation_5_is_a_difference_that_wraps() -> None:
    assert heading_offset(0.3, 0.1) == pytest.approx(0.2)
    assert heading_offset(170 * DEG, -170 * DEG) == pytest.approx(-20 * DEG)


def test_equation_7_is_what_equation_6_answers_to_a_unit_impulse(markov: Markov) -> None:
    for j in range(2):
        u = np.zeros((20, 2))
        u[0, j] = 1.0
        np.testing.assert_allclose(simulate(paper_model(), u, np.zeros(2)), markov[:, :, j], atol=1e-15)


def test_equation_9b_sums_past_inputs_with_equation_7s_weights(markov: Markov) -> None:
    u = np.random.default_rng(5).uniform(-1.0, 1.0, (20, 2))
    summed = sum(markov[i] @ u[19 - i] for i in range(20))
    np.testing.assert_allclose(summed, simulate(paper_model(), u, np.zeros(2))[19], atol=1e-14)


def test_the_matrices_of_equation_8_start_at_y1_and_y2(markov: Markov) -> None:
    H, shifted = hankel(markov, 3, 3, 0), hankel(markov, 3, 3, 1)
    np.testing.assert_array_equal(H[:2, :2], markov[1])
    np.testing.assert_array_equal(H[4:, 4:], markov[5])
    np.testing.assert_array_equal(shifted[:2, :2], markov[2])
    np.testing.assert_array_equal(H[2:], shifted[:4])


def test_era_finds_equation_12_from_its_own_impulse_response(markov: Markov) -> None:
    A, B, C, D = era(markov, paper.RANK)
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(A)), np.sort_complex(np.linalg.eigvals(paper.A)), atol=1e-9)
    np.testing.assert_allclose(C @ A @ B, markov[2], atol=1e-12)
    np.testing.assert_array_equal(D, paper.D)


def test_equation_9c_gives_the_impulse_response_of_one_input_that_starts_large() -> None:
    h = np.array([0.0, 0.5, 0.25, 0.125])
    u = np.array([[1.0], [0.3], [-0.2], [0.1]])
    y = np.convolve(h, u[:, 0])[:4, None]
    np.testing.assert_allclose(deconvolve(u, y)[:, 0, 0], h, atol=1e-14)


def test_equation_9c_has_half_the_rank_it_needs_with_two_inputs() -> None:
    u = np.random.default_rng(6).uniform(-1.0, 1.0, (30, 2))
    assert np.linalg.matrix_rank(input_matrix(u)) == 30
    with pytest.raises(PoorExcitation, match="rank 30"):
        deconvolve(u, np.zeros((30, 2)))


@pytest.mark.parametrize("change", [0.5, 0.9, 1.1, 2.0])
def test_any_other_gain_costs_more_by_equation_10(change: float) -> None:
    K = lqr_gain(paper.A, paper.B, paper.Q, paper.R)
    assert _cost(K) < _cost(change * K)


def _cost(K: Float[np.ndarray, "2 2"]) -> float:
    """J of Eq. (10) summed over both unit starts; 400 steps leave nothing at a radius below 0.95."""
    total, x = 0.0, np.eye(2)
    for _ in range(400):
        u = -K @ x
        total += float(np.trace(x.T @ paper.Q @ x + u.T @ paper.R @ u))
        x = paper.A @ x + paper.B @ u
    return total


@pytest.mark.parametrize("phase", [0.0, 0.1, 0.25, 0.399])
def test_a_track_as_long_as_the_inequality_asks_lies_on_two_edges_at_every_phase(phase: float) -> None:
    rise, run = 0.17, 0.30
    length = minimum_track_length(rise, run)
    assert length == pytest.approx(2.0 * math.hypot(rise, run))
    assert nosings_touched(length, 0.5 * length, phase * length) >= 2


def test_the_shipped_chair_fulfils_the_inequality_on_every_slope_of_the_paper() -> None:
    flat = read_chair("wheelchair").tracks.flat_run_m
    assert all(flat > minimum_track_length(0.30 * math.tan(slope * DEG), 0.30) for slope in (25, 28, 30))


def test_the_slider_and_bar_level_the_seat_on_every_slope_of_the_paper() -> None:
    linkage = SeatLinkage(read_chair("wheelchair").seat)
    for slope in (0, 25, 28, 30):
        stroke = linkage.stroke(slope * DEG)
        # Closed form both ways: rounding alone.
        assert linkage.angle(stroke) == pytest.approx(slope * DEG, abs=1e-12)
        assert linkage.stroke_range[0] < stroke < linkage.stroke_range[1]


def test_a_slope_beyond_the_linkage_is_refused() -> None:
    with pytest.raises(MechanicsError, match="outside the linkage's"):
        SeatLinkage(read_chair("wheelchair").seat).stroke(60 * DEG)
