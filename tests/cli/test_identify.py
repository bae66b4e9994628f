"""``identify`` as a user calls it: what it answers, what it writes, and what it refuses."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from treadline.core.models import LinearModel

CHANNELS = ["--inputs", "left_m_s,right_m_s", "--outputs", "heading_rad,yaw_rate_rad_s"]
POLES = (0.5, 0.9)


def write_log(
    path: Path, *, seed: int = 0, rows: int = 600, noise: float = 0.01, late: int = 0, poles: tuple[float, float] = POLES
) -> Path:
    """Write a chair-like plant with two known poles: a lag and a slower one it drives."""
    rng = np.random.default_rng(seed)
    u = 0.1 * rng.standard_normal((rows, 2))
    acting = np.vstack([np.zeros((late, 2)), u[: rows - late]])
    turn = heading = 0.0
    lines = ["t_s,left_m_s,right_m_s,heading_rad,yaw_rate_rad_s"]
    for k in range(rows):
        e = noise * 0.05 * rng.standard_normal(2)
        lines.append(f"{0.25 * k!r},{u[k, 0]:.17g},{u[k, 1]:.17g},{heading + e[0]:.17g},{turn + e[1]:.17g}")
        heading, turn = poles[1] * heading + 0.25 * turn, poles[0] * turn + float(acting[k] @ [-0.6, 0.7])
    path.write_text("\n".join(lines) + "\n")
    return path


def real_poles(values: dict[str, object]) -> np.ndarray:
    return np.sort([real for real, _ in values["poles"]])


def three_outputs(path: Path, *, rows: int = 800) -> Path:
    """Write two inputs and three outputs of a slow third-order plant, 3 % noise on each output."""
    rng = np.random.default_rng(11)
    A = np.array([[0.92, 0.15, 0.0], [-0.15, 0.92, 0.05], [0.0, 0.0, 0.7]])
    B, C = rng.standard_normal((3, 2)), rng.standard_normal((3, 3))
    u, x, y = rng.standard_normal((rows, 2)), np.zeros(3), np.empty((rows, 3))
    for k in range(rows):
        y[k], x = C @ x, A @ x + B @ u[k]
    y += 0.03 * y.std(axis=0) * rng.standard_normal(y.shape)
    table = np.column_stack([0.02 * np.arange(rows), u, y])
    path.write_text("t_s,u1,u2,y1,y2,y3\n" + "\n".join(",".join(f"{value:.17g}" for value in row) for row in table) + "\n")
    return path


THREE = ["--inputs", "u1,u2", "--outputs", "y1,y2,y3", "--order", "3", "--no-page", "--json"]


def test_blank_inputs_do_not_spoil_what_is_said_of_the_model(run, tmp_path: Path) -> None:
    log, rng = three_outputs(tmp_path / "log.csv"), np.random.default_rng(12)
    clean = run("identify", log, *THREE, "--out", tmp_path / "clean.json").values
    lines = log.read_text().splitlines()
    for row in rng.choice(800, 30, replace=False).tolist():
        cells = lines[1 + row].split(",")
        cells[1 + row % 2] = ""
        lines[1 + row] = ",".join(cells)
    log.write_text("\n".join(lines) + "\n")
    outcome = run("identify", log, *THREE, "--allow-gaps", "--out", tmp_path / "gapped.json")
    assert outcome.code == 0, outcome.err
    for name, fit in outcome.values["fit_percent"].items():
        assert fit == pytest.approx(clean["fit_percent"][name], abs=1.0)
        assert fit > 96.0
    assert not [warning for warning in outcome.values["warnings"] if "white" in warning]


def test_the_default_finds_the_plant_and_writes_model_and_page(run, tmp_path: Path) -> None:
    log, out = write_log(tmp_path / "log.csv"), tmp_path / "out" / "model.json"
    outcome = run("identify", log, *CHANNELS, "--validate", "0.5", "--out", out, "--json")
    assert outcome.code == 0, outcome.err
    values = outcome.values
    assert (values["order"], values["method"]) == (2, "best")
    # 300 samples with 1 % noise know a pole to about a hundredth.
    np.testing.assert_allclose(real_poles(values), POLES, atol=0.02)
    assert min(values["fit_percent"].values()) > 97.0
    assert len(values["pole_ci95"]) == len(values["poles"]) == 2
    assert {"lags", "singular_values", "one_step_vaf_percent", "whiteness_p", "warnings", "seconds"} <= values.keys()
    assert Path(values["model"]) == out
    assert "<svg" in Path(values["page"]).read_text(encoding="utf-8")
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(LinearModel.load(out).A).real), real_poles(values), atol=1e-12)


def test_a_summary_shows_people_the_fit_and_where_things_are(run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "log.csv")
    outcome = run("identify", log, *CHANNELS, "--out", tmp_path / "m.json", "--page", tmp_path / "p.html")
    assert outcome.code == 0
    assert "fit on the data that were fitted: heading_rad" in outcome.out
    assert "free run from the state of the first 15 s, scored on the 540 samples after them" in outcome.out
    assert str(tmp_path / "p.html") in outcome.out
    (said,) = re.findall(r"\d+ samples; \d+ windows fitted, 0 omitted for gaps", outcome.out)
    assert said in (tmp_path / "p.html").read_text()


def test_a_model_for_matlab_is_the_same_model(run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "log.csv")
    for name in ("m.json", "m.mat"):
        assert run("identify", log, *CHANNELS, "--no-page", "--out", tmp_path / name).code == 0
    one, other = LinearModel.load(tmp_path / "m.json"), loadmat(tmp_path / "m.mat")
    np.testing.assert_array_equal(one.A, other["A"])
    np.testing.assert_array_equal(one.input_offset[:, None], other["u0"])
    assert not list(tmp_path.glob("*.html"))


def test_a_stream_gives_what_the_whole_gives(run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "log.csv", rows=2000)
    common = ("identify", log, *CHANNELS, "--method", "pbsid", "--order", "2", "--lags", "6", "--no-page", "--json")
    whole = run(*common, "--out", tmp_path / "whole.json").values
    streamed = run(*common, "--stream", "--out", tmp_path / "stream.json").values
    # The same sums in other chunks and units: equal to rounding.
    np.testing.assert_allclose(streamed["poles"], whole["poles"], atol=1e-8)
    assert streamed["samples"] == whole["samples"]


def test_an_update_follows_a_plant_that_wears(run, tmp_path: Path) -> None:
    new, worn = write_log(tmp_path / "new.csv"), write_log(tmp_path / "worn.csv", seed=1, poles=(0.7, 0.9))
    sums, common = tmp_path / "sums.npz", ("--order", "2", "--no-page", "--out", tmp_path / "m.json", "--force", "--json")
    first = run("identify", new, *CHANNELS, *common, "--method", "pbsid", "--gram", sums)
    assert first.values["gram"] == str(sums)
    found = {
        factor: real_poles(run("identify", worn, *CHANNELS, *common, "--update", sums, "--forgetting", factor).values)[0]
        for factor in ("1.0", "0.99")
    }
    # Forgetting 1 % a sample, nothing is left of the plant as it was; without, half of the data are of it.
    assert abs(found["0.99"] - 0.7) < 0.02
    assert abs(found["1.0"] - 0.7) > 0.05


def test_dead_time_is_found_and_taken_out_of_the_states(run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "log.csv", late=3)
    common = ("identify", log, *CHANNELS, "--no-page", "--out", tmp_path / "m.json", "--force", "--json")
    assert run(*common).values["delays"] == [3, 3]
    assert json.loads((tmp_path / "m.json").read_text())["input_delay"] == [3, 3]
    assert run(*common, "--delays", "2,1", "--order", "2").values["delays"] == [2, 1]
    assert run(*common, "--delays", "0", "--order", "2").values["delays"] == [0, 0]


def test_a_clock_in_milliseconds_is_asked_about_unless_the_period_is_given(run, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    u = rng.normal(size=(200, 1))
    y = np.convolve(u[:, 0], [0.0, 1.0, 0.5])[:200] + 1e-3 * rng.normal(size=200)
    table = np.column_stack([250.0 * np.arange(200), u, y])
    np.savetxt(tmp_path / "ms.csv", table, delimiter=",", header="t_s,u,y", comments="")
    line = ["identify", tmp_path / "ms.csv", "--inputs", "u", "--outputs", "y", "--method", "okid-era", "--no-page", "--json"]
    (asked,) = [text for text in run(*line, "--out", tmp_path / "a.json").values["warnings"] if "milliseconds" in text]
    assert asked.startswith("the time column steps by 250 s; if it counts milliseconds, divide it by 1000")
    given = run(*line, "--period", "250", "--out", tmp_path / "b.json").values["warnings"]
    assert not any("milliseconds" in text for text in given)
