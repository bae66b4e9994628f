"""What the paper's own numbers say: where they agree with each other, and what they ask of the chair."""

import numpy as np
import pytest

from treadline.control import lqr_gain
from treadline.core import paper
from treadline.experiments.as_printed import asked_at
from treadline.experiments.plan import WHOLE
from treadline.identification._okid import ObserverMarkov, system_markov
from treadline.scenario.chair import read_chair


def test_another_weight_does_not_give_equation_14() -> None:
    halved = lqr_gain(paper.A, paper.B, paper.Q, 0.5 * paper.R)
    assert np.abs(halved - paper.K).max() > 0.1


def test_equation_11b_can_be_solved_with_the_printed_matrices() -> None:
    # 2.42 is what the printed digits give; the third digit is theirs.
    assert np.linalg.cond(paper.C - paper.D @ paper.K) == pytest.approx(2.42, abs=0.005)


def test_the_recipe_asks_more_of_the_right_track_at_30_degrees_than_a_track_can_do() -> None:
    left, right = asked_at(30.0)
    assert right == pytest.approx(-2.68, abs=0.005)
    assert left == pytest.approx(0.57, abs=0.005)
    assert abs(right) > 2.5 * paper.MAX_SPEED_M_S


def test_the_recipe_stays_within_the_track_below_eleven_degrees() -> None:
    assert np.abs(asked_at(11.0)).max() < paper.MAX_SPEED_M_S < np.abs(asked_at(11.3)).max()


def test_the_printed_model_is_stable_and_so_forgets_its_heading() -> None:
    # A turn on a stair stays turned; a model without an integrator says it comes back by itself.
    assert np.abs(np.linalg.eigvals(paper.A)).max() < 0.75


def test_an_impulse_on_either_track_turns_the_printed_model_the_same_way() -> None:
    first = np.array([paper.D, paper.C @ paper.B])
    heading, rate = first[0, 0], first[:, 1]
    # Opposite signs would be physics: a faster left track turns right, a faster right track turns left.
    assert heading[0] < 0.0
    assert heading[1] < 0.0
    assert (rate > 0.0).all()


def test_the_printed_model_turns_for_ever_at_a_constant_heading() -> None:
    heading, rate = paper.C @ np.linalg.solve(np.eye(2) - paper.A, paper.B) + paper.D
    # Under a constant input the heading comes to rest, and the turn rate, its derivative, does not come to zero.
    assert np.abs(heading).max() < 0.06
    assert np.abs(rate).min() > 0.05


@pytest.mark.parametrize("start_deg", [30, -30])
def test_the_averages_of_table_2_are_those_of_its_columns(start_deg: int) -> None:
    values = [paper.TABLE_II[(slope, start_deg)] for slope in (25, 28, 30)]
    # Printed to two decimals.
    assert np.mean(values) == pytest.approx(paper.TABLE_II_AVERAGE[start_deg], abs=0.005)


def test_speed_and_turn_rate_of_table_1_imply_the_gauge_of_the_chair() -> None:
    implied = 2.0 * paper.MAX_SPEED_M_S / paper.MAX_TURN_RATE_RAD_S
    assert implied == pytest.approx(0.65, abs=0.005)
    assert read_chair("wheelchair").tracks.gauge_m == pytest.approx(implied, abs=0.005)


def test_the_chair_has_the_masses_and_the_speed_of_table_1() -> None:
    chair = read_chair("wheelchair")
    assert chair.masses.chassis_kg == paper.MASS_KG
    assert chair.drives.max_speed_m_s == paper.MAX_SPEED_M_S


def test_a_rank_of_2_is_all_that_the_printed_impulse_response_has() -> None:
    still = np.zeros((1, 2, 2))
    observer = ObserverMarkov(
        bias=np.zeros(2),
        D=paper.D,
        alpha=(paper.C @ paper.B)[None],
        beta=still + paper.C @ paper.A @ np.linalg.inv(paper.C),
        residual_covariance=np.eye(2),
        information=np.eye(5),
        count=1.0,
        feedthrough=True,
    )
    Y = system_markov(observer, 9)
    H = np.block([[Y[1 + i + j] for j in range(4)] for i in range(4)])
    assert np.linalg.matrix_rank(H, tol=1e-9) == paper.RANK


def test_the_whole_reproduction_takes_the_papers_samples_and_times() -> None:
    assert (WHOLE.samples, WHOLE.straight_s, WHOLE.turn_s) == (
        paper.SAMPLES,
        paper.FIG9_DURATION_S,
        paper.FIG10_DURATION_S,
    )
