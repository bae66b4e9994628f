"""A model that explains less than half of each output's variance is not tuned, unless asked; a model typed in always is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from systems import fit, noise_record, system, white_record

import treadline as tl
from treadline.core.errors import ModelError
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.experiments.as_printed import paper_model

WEIGHTS = {"output_weight": (1.0, 1.0)}


def turning(noise: float) -> InputOutputRecord:
    """Return a record of a vehicle that turns by its belts, with noise of a share of the outputs' deviation."""
    plant = system([[0.9, 0.0], [0.0, 0.6]], [[-0.4, 0.4], [-0.4, 0.4]], np.eye(2), dt_s=0.25)
    return white_record(plant, 3, 800, noise)


def identified(record: InputOutputRecord) -> LinearModel:
    return fit(record, order=2, method="okid-era").model


def test_outputs_that_no_input_moves_give_no_controller() -> None:
    model = identified(noise_record(4, 800, dt_s=0.25))
    with pytest.raises(ModelError, match=r"explains \d+ % of 'y1', \d+ % of 'y2'; below 50 % .* give --accept-poor-fit"):
        tl.tune(model, **WEIGHTS)
    assert tl.tune(model, **WEIGHTS, accept_poor_fit=True).K.shape == (2, 2)


def test_the_share_survives_the_model_file(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    identified(noise_record(4, 800, dt_s=0.25)).save(path)
    with pytest.raises(ModelError, match="--accept-poor-fit"):
        tl.tune(path, **WEIGHTS)


# Noise of twice the deviation leaves a fifth of the variance to explain, of a half four fifths.
@pytest.mark.parametrize(("noise", "tuned"), [(0.1, True), (0.5, True), (2.0, False)])
def test_the_limit_lies_at_half_of_the_variance(noise: float, tuned: bool) -> None:
    model = identified(turning(noise))
    if tuned:
        assert np.isfinite(tl.tune(model, **WEIGHTS).K).all()
    else:
        with pytest.raises(ModelError, match="below 50 %"):
            tl.tune(model, **WEIGHTS)


def test_models_typed_in_are_tuned() -> None:
    printed = paper_model(0.2)
    assert tl.tune(printed, period_s=0.25).period_s == 0.25
    annotated = replace(printed, provenance={"note": "Eq. (12)", "explained_percent": "unknown"})
    assert tl.tune(annotated, period_s=0.25).period_s == 0.25
