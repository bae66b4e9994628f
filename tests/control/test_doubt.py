"""A design that would not bring its own model's chair back is doubted, with its numbers; one that would is not."""

from dataclasses import replace

import numpy as np
import pytest

from treadline.control import tune
from treadline.control.doubt import ASKEW_RAD, HALVED_S, askew, doubt
from treadline.experiments.as_printed import paper_model
from treadline.models import LinearModel


def found_model() -> LinearModel:
    """Return what ``identify`` made of 1000 samples on paper-28 by ``best``: in this basis a mean of both belts is cheap."""
    return LinearModel(
        A=np.array([[0.16771, -0.2971], [-0.08549, 0.95563]]),
        B=np.array([[8.6903, -8.68665], [4.65157, -5.26269]]),
        C=np.array([[0.00696, -0.02333], [-0.03306, -0.01104]]),
        D=np.zeros((2, 2)),
        dt_s=0.25,
        input_offset=np.full(2, 0.2),
        output_offset=np.zeros(2),
    )


def test_a_gain_on_the_mean_of_the_belts_is_doubted() -> None:
    told = doubt(tune(found_model(), state_weight=(1.0, 1.0), input_weight=[0.05]))
    assert told is not None
    assert "the model's heading is at 39" in told
    assert "give --output-weight 1,0" in told


def test_a_weight_on_the_outputs_of_the_same_model_is_not() -> None:
    assert doubt(tune(found_model())) is None


@pytest.mark.parametrize("weights", [{}, {"state_weight": (1.0, 1.0), "input_weight": [0.05]}])
@pytest.mark.parametrize("period_s", [0.25, 1.0])
def test_the_paper_s_design_is_not_doubted(weights: dict[str, object], period_s: float) -> None:
    assert doubt(tune(paper_model(0.2), period_s=period_s, **weights)) is None


def test_the_doubt_says_how_long_the_heading_takes_to_halve() -> None:
    design = tune(found_model())
    slow = replace(design, K=0.03 * design.K)
    heading = askew(slow)
    assert heading[0] == pytest.approx(ASKEW_RAD)
    halved_s = 0.25 * int(np.argmax(heading < 0.5 * ASKEW_RAD))
    assert halved_s > HALVED_S
    assert f"takes {halved_s:.1f} s to halve" in str(doubt(slow))


def test_the_mean_of_the_belts_does_not_steer() -> None:
    design = tune(found_model())
    together = replace(design, K=design.K + np.ones((2, 1)) * 7.0)
    np.testing.assert_allclose(askew(together), askew(design), rtol=0.0, atol=1e-12)


def test_a_loop_that_runs_away_is_told_in_numbers_and_one_without_a_heading_is_left_alone() -> None:
    design = tune(found_model())
    wild = replace(design, K=-2.0 * design.K)
    assert np.isfinite(askew(wild)).all()
    assert "° after 5 s" in str(doubt(wild))
    blind = replace(design, model=replace(design.model, C=np.array([[0.0, 0.0], [-0.03306, -0.01104]])))
    assert "halve" not in str(doubt(blind))
