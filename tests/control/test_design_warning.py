"""A design that does not return its own model's chair in time gives a warning with its numbers."""

from dataclasses import replace

import numpy as np
import pytest
from systems import system

from treadline.control import tune
from treadline.control.tune import design_warning, heading_response
from treadline.core.models import LinearModel
from treadline.experiments.as_printed import paper_model


def found_model() -> LinearModel:
    """Return the model identified by ``best`` from 1000 samples on paper-28; in its basis a common belt speed is cheap."""
    A, B = [[0.16771, -0.2971], [-0.08549, 0.95563]], [[8.6903, -8.68665], [4.65157, -5.26269]]
    return system(A, B, [[0.00696, -0.02333], [-0.03306, -0.01104]], dt_s=0.25, input_offset=np.full(2, 0.2))


def test_a_gain_on_the_mean_of_the_belts_gives_a_warning() -> None:
    warning = design_warning(tune(found_model(), state_weight=(1.0, 1.0), input_weight=[0.05]))
    assert warning is not None
    assert "the model's heading is at 11" in warning
    assert "give --output-weight 1,0" in warning


def test_a_weight_on_the_outputs_of_the_same_model_gives_no_warning() -> None:
    assert design_warning(tune(found_model())) is None


@pytest.mark.parametrize("weights", [{}, {"state_weight": (1.0, 1.0), "input_weight": [0.05]}])
@pytest.mark.parametrize("period_s", [0.25, 1.0])
def test_the_paper_s_design_gives_no_warning(weights: dict[str, object], period_s: float) -> None:
    assert design_warning(tune(paper_model(0.2), period_s=period_s, **weights)) is None


def test_the_mean_of_the_belts_does_not_steer() -> None:
    design = tune(found_model())
    together = replace(design, K=design.K + np.ones((2, 1)) * 7.0)
    np.testing.assert_allclose(heading_response(together), heading_response(design), rtol=0.0, atol=1e-12)


def test_a_diverging_loop_is_reported_with_its_numbers_and_a_model_without_heading_is_not() -> None:
    design = tune(found_model())
    wild = replace(design, K=-2.0 * design.K)
    assert np.isfinite(heading_response(wild)).all()
    assert "° after 5 s" in str(design_warning(wild))
    blind = replace(design, model=replace(design.model, C=np.array([[0.0, 0.0], [-0.03306, -0.01104]])))
    assert "halve" not in str(design_warning(blind))
