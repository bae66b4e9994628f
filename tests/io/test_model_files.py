"""Models in file formats of other tools: MATLAB reads the numbers and names that were written."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from treadline.core.errors import ModelError, SettingsError, TreadlineError
from treadline.core.models import LinearModel


def model(order: int = 3, *, gain: bool = True) -> LinearModel:
    rng = np.random.default_rng(4)
    return LinearModel(
        A=rng.normal(size=(order, order)),
        B=rng.normal(size=(order, 2)),
        C=rng.normal(size=(1, order)),
        D=rng.normal(size=(1, 2)),
        dt_s=0.1,
        input_offset=rng.normal(size=2),
        output_offset=rng.normal(size=1),
        observer_gain=rng.normal(size=(order, 1)) if gain else None,
        input_names=("left_m_s", "right_m_s"),
        output_names=("heading_rad",),
        provenance={"command": "identify", "vaf": {"heading_rad": 99.5}, "note": "κλίμαξ"},
    )


@pytest.mark.parametrize(("order", "gain"), [(3, True), (3, False), (1, True)])
def test_a_mat_file_holds_the_model_bit_for_bit(tmp_path: Path, order: int, gain: bool) -> None:
    wanted = model(order, gain=gain)
    path = tmp_path / "deep" / "model.MAT"
    wanted.save(path)
    found = loadmat(path)
    columns = {"u0": wanted.input_offset[:, None], "y0": wanted.output_offset[:, None], "dt": np.array([[0.1]])}
    columns |= {name: getattr(wanted, name) for name in "ABCD"} | ({"K": wanted.observer_gain} if gain else {})
    for name, values in columns.items():
        assert found[name].shape == values.shape, name
        assert np.ascontiguousarray(found[name]).tobytes() == values.tobytes(), name
    assert ("K" in found) is gain
    assert [str(cell[0]) for cell in found["input_names"].ravel()] == ["left_m_s", "right_m_s"]
    assert json.loads(str(found["provenance"][0])) == wanted.provenance
    assert [item.name for item in path.parent.iterdir()] == ["model.MAT"]


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(TreadlineError, match="cannot be written"):
        model().save(tmp_path / "file" / "model.mat")


@pytest.mark.parametrize("given", [(1,), (1, 2, 3), (-1, 0), (1.5, 0), (True, 0)])
def test_dead_times_that_are_none_are_rejected(tmp_path: Path, given: tuple[float, ...]) -> None:
    plant = model()
    with pytest.raises(ModelError, match=r"give one whole number of samples per input \(2\)"):
        replace(plant, input_delay=given)
    path = tmp_path / "model.json"
    plant.save(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"input_delay": given}))
    with pytest.raises(SettingsError, match="input_delay is"):
        LinearModel.load(path)
