"""Models in file formats of other tools: exact round trip, and reasons for rejected files."""

from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.signal import dlti

from treadline.core.errors import ModelError, SettingsError, TreadlineError
from treadline.core.models import LinearModel
from treadline.io.model_files import from_statespace, read_model, to_statespace, write_model


def model(order: int = 3, *, gain: bool = True, seed: int = 4) -> LinearModel:
    rng = np.random.default_rng(seed)
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


def assert_same(a: LinearModel, b: LinearModel) -> None:
    for item in fields(LinearModel):
        x, y = getattr(a, item.name), getattr(b, item.name)
        if isinstance(x, np.ndarray):
            assert x.shape == y.shape, item.name
            assert x.tobytes() == np.ascontiguousarray(y).tobytes(), item.name
        else:
            assert x == y, item.name


@pytest.mark.parametrize("suffix", [".json", ".mat", ".MAT"])
@pytest.mark.parametrize(("order", "gain"), [(3, True), (3, False), (1, True)])
def test_a_model_comes_back_bit_for_bit(tmp_path: Path, suffix: str, order: int, gain: bool) -> None:
    wanted = model(order, gain=gain)
    path = tmp_path / f"deep/model{suffix}"
    write_model(wanted, path)
    assert_same(wanted, read_model(path))
    assert [item.name for item in path.parent.iterdir()] == [path.name]


def test_a_mat_file_has_the_names_that_matlab_users_expect(tmp_path: Path) -> None:
    write_model(model(), tmp_path / "model.mat")
    found = loadmat(tmp_path / "model.mat")
    assert {"A", "B", "C", "D", "K", "dt", "u0", "y0"} <= set(found)
    assert found["u0"].shape == (2, 1)


def test_four_matrices_and_a_period_are_a_model(tmp_path: Path) -> None:
    bare = {name: getattr(model(), name) for name in "ABCD"}
    savemat(tmp_path / "bare.mat", bare | {"dt": 0.1})
    found = read_model(tmp_path / "bare.mat")
    assert found.dt_s == 0.1
    assert found.observer_gain is None
    assert not found.input_offset.any()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"A": None}, "no A"),
        ({"dt": None}, "no dt"),
        ({"dt": 0.0}, "period"),
        ({"dt": [1.0, 2.0]}, "not a model"),
        ({"B": np.ones((2, 2))}, "B is"),
        ({"A": np.eye(3) * 1j}, "not real"),
        ({"A": np.full((3, 3), np.nan)}, "NaN"),
        ({"provenance": "{"}, "not a model"),
    ],
)
def test_a_mat_file_that_is_no_model_says_why(tmp_path: Path, changes: dict[str, object], words: str) -> None:
    path = tmp_path / "model.mat"
    variables = {name: getattr(model(), name) for name in "ABCD"} | {"dt": 0.1} | changes
    savemat(path, {name: value for name, value in variables.items() if value is not None})
    with pytest.raises(SettingsError, match=rf"model\.mat.*{words}") as caught:
        read_model(path)
    assert "\n" not in str(caught.value)


def test_other_suffixes_and_missing_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"supported: \.json, \.mat"):
        write_model(model(), tmp_path / "model.pkl")
    with pytest.raises(SettingsError, match="no such file"):
        read_model(tmp_path / "none.mat")
    (tmp_path / "text.mat").write_text("A = 1")
    with pytest.raises(SettingsError, match="MAT"):
        read_model(tmp_path / "text.mat")
    (tmp_path / "file").write_text("")
    with pytest.raises(TreadlineError, match="cannot be written"):
        write_model(model(), tmp_path / "file" / "model.mat")


def test_python_control_gets_the_matrices_and_gives_them_back() -> None:
    pytest.importorskip("control", reason="python-control is an extra")
    wanted = model()
    system = to_statespace(wanted)
    assert system.input_labels == ["left_m_s", "right_m_s"]
    back = from_statespace(system)
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(back, name), getattr(wanted, name))
    assert (back.dt_s, back.input_names, back.output_names) == (wanted.dt_s, wanted.input_names, wanted.output_names)
    # The same answer to the same input.
    u = np.random.default_rng(1).normal(size=(20, 2))
    import control

    x, outputs = np.zeros(3), []
    for row in u:
        outputs.append(wanted.C @ x + wanted.D @ row)
        x = wanted.A @ x + wanted.B @ row
    answer = control.forced_response(system, inputs=u.T, squeeze=False).outputs
    np.testing.assert_allclose(answer, np.array(outputs).T, rtol=1e-9)


def test_any_discrete_system_with_four_matrices_is_taken() -> None:
    wanted = model()
    system = dlti(wanted.A, wanted.B, wanted.C, wanted.D, dt=0.1)
    np.testing.assert_array_equal(from_statespace(system).A, wanted.A)


@pytest.mark.parametrize("dt", [None, True, 0, 0.0, -1.0, float("nan")])
def test_a_system_without_a_period_is_refused(dt: object) -> None:
    system = SimpleNamespace(**{name: getattr(model(), name) for name in "ABCD"}, dt=dt)
    with pytest.raises(ModelError, match="period"):
        from_statespace(system)


def test_a_system_whose_matrices_do_not_fit_is_refused() -> None:
    whole = {name: getattr(model(), name) for name in "ABCD"}
    for changes in ({"B": np.ones((2, 2))}, {"B": np.ones(3)}, {"A": np.full((3, 3), np.inf)}, {"A": np.eye(3) * 1j}):
        with pytest.raises(ModelError):
            from_statespace(SimpleNamespace(**whole | changes, dt=0.1))
