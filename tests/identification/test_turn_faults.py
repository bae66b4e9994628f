"""A log with exchanged sides, a wrong sign or a wrong unit gives a model that no controller is tuned from; honest drives pass."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float

import treadline as tl
from treadline.core.errors import ModelError, SettingsError
from treadline.core.models import ControllerDesign, InputOutputRecord
from treadline.core.turning import turn_faults

BELTS, TURNS = ("left_m_s", "right_m_s"), ("heading_unwrapped_rad", "yaw_rate_rad_s")
Change = Callable[[Float[np.ndarray, "T 2"], Float[np.ndarray, "T 2"]], tuple[Float[np.ndarray, "T 2"], Float[np.ndarray, "T 2"]]]


def drive(seed: int, *, rows: int = 600, period_s: float = 0.05) -> InputOutputRecord:
    """Return an honest drive: belts at random speeds, each behind a lag, gauge 0.4 to 1 m, noise of a gyro and of a compass."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-0.5, 0.5, (rows // 10, 2)), 10, axis=0)
    gauge_m, decay = rng.uniform(0.4, 1.0), rng.uniform(0.3, 0.9, 2)
    belts = np.zeros((rows + 1, 2))
    for k in range(rows):
        belts[k + 1] = decay * belts[k] + (1.0 - decay) * u[k]
    rate = (belts[:rows, 1] - belts[:rows, 0]) / gauge_m
    heading = period_s * np.concatenate([[0.0], np.cumsum(rate[:-1])])
    y = np.column_stack([heading, rate]) + rng.normal(size=(rows, 2)) * [0.003, 0.01]
    return InputOutputRecord(u=u, y=y, dt_s=period_s, input_names=BELTS, output_names=TURNS)


def changed(record: InputOutputRecord, change: Change) -> InputOutputRecord:
    u, y = change(record.u.copy(), record.y.copy())
    return replace(record, u=u, y=y)


FAULTS: dict[str, tuple[Change, str]] = {
    "sides exchanged": (lambda u, y: (u[:, ::-1], y), "exchange the columns"),
    "both clockwise": (lambda u, y: (u, -y), "negate heading and yaw rate"),
    "heading clockwise": (lambda u, y: (u, y * [-1.0, 1.0]), "one of them is counted clockwise"),
    "yaw rate clockwise": (lambda u, y: (u, y * [1.0, -1.0]), "negate"),
    "yaw rate in degrees": (lambda u, y: (u, y * [1.0, 180.0 / np.pi]), "in degrees|rad/s"),
    "left belt negated": (lambda u, y: (u * [-1.0, 1.0], y), "change its sign"),
    "right belt negated": (lambda u, y: (u * [1.0, -1.0], y), "change its sign"),
    "belts in mm/s": (lambda u, y: (1000.0 * u, y), "belts in m/s"),
}


@pytest.mark.parametrize("seed", [71, 72])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_log_gives_no_controller_and_says_what_to_change(fault: str, seed: int) -> None:
    change, remedy = FAULTS[fault]
    found = tl.identify(changed(drive(seed), change))
    with pytest.raises(ModelError, match=remedy):
        tl.tune(found)
    with pytest.raises(ModelError, match=remedy):
        tl.tune(found, accept_poor_fit=True)
    assert any(line in found.report.warnings for line in turn_faults(found.model))


@pytest.mark.parametrize("seed", range(81, 85))
def test_an_honest_drive_has_no_fault(seed: int) -> None:
    found = tl.identify(drive(seed))
    assert turn_faults(found.model) == []
    assert tl.tune(found).K.shape[0] == 2


def test_the_model_file_and_the_controller_file_are_tested_too(tmp_path: Path) -> None:
    wrong, right = (tl.identify(record) for record in (changed(drive(74), FAULTS["sides exchanged"][0]), drive(74)))
    wrong.model.save(tmp_path / "model.json")
    with pytest.raises(ModelError, match="exchange the columns"):
        tl.tune(tmp_path / "model.json")
    design = replace(tl.tune(right), model=wrong.model)
    design.save(tmp_path / "controller.json")
    with pytest.raises(SettingsError, match=r"controller\.json: the model does not turn .* exchange the columns"):
        ControllerDesign.load(tmp_path / "controller.json")


def test_a_yaw_gain_that_may_be_zero_is_a_fault() -> None:
    record = drive(75)
    still = replace(record, y=np.random.default_rng(75).normal(size=record.y.shape) * [0.003, 0.01])
    assert any("may be zero" in line for line in turn_faults(tl.identify(still).model))
