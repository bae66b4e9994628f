"""``identify`` as a user calls it: what it answers, what it writes, and what it refuses."""

import json
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from treadline.core.models import LinearModel

from .conftest import assert_refused

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


def test_a_model_for_matlab_is_the_same_model(run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "log.csv")
    for name in ("m.json", "m.mat"):
        assert run("identify", log, *CHANNELS, "--method", "pbsid", "--no-page", "--out", tmp_path / name).code == 0
    one, other = LinearModel.load(tmp_path / "m.json"), loadmat(tmp_path / "m.mat")
    np.testing.assert_array_equal(one.A, other["A"])
    np.testing.assert_array_equal(one.input_offset[:, None], other["u0"])
    assert not list(tmp_path.glob("*.html"))


def test_a_stream_and_an_update_give_what_the_whole_gives(run, tmp_path: Path) -> None:
    log, gram = write_log(tmp_path / "log.csv", rows=2000), tmp_path / "gram.npz"
    common = ("identify", log, *CHANNELS, "--method", "pbsid", "--order", "2", "--lags", "6", "--no-page", "--json")
    whole = run(*common, "--out", tmp_path / "whole.json", "--gram", gram).values
    assert whole["gram"] == str(gram)
    # The same sums in other chunks and units, or twice: equal to rounding.
    for option, windows in (("--stream", 1), (f"--update={gram}", 2)):
        other = run(*common, option, "--out", tmp_path / "other.json", "--force").values
        np.testing.assert_allclose(other["poles"], whole["poles"], atol=1e-8)
        assert other["samples"] == windows * whole["samples"]
    fading = run(*common, f"--update={gram}", "--forgetting", "0.99", "--out", tmp_path / "other.json", "--force").values
    assert fading["poles"] != whole["poles"]


def test_dead_time_is_found_and_taken_out_of_the_states(run, tmp_path: Path) -> None:
    log = write_log(tmp_path / "log.csv", late=3)
    common = ("identify", log, *CHANNELS, "--no-page", "--out", tmp_path / "m.json", "--force", "--json")
    assert run(*common).values["delays"] == [3, 3]
    assert json.loads((tmp_path / "m.json").read_text())["input_delay"] == [3, 3]
    for given, taken in (("2,1", [2, 1]), ("0", [0, 0])):
        assert run(*common, "--method", "pbsid", "--order", "2", "--delays", given).values["delays"] == taken


def test_a_clock_in_milliseconds_is_refused_unless_the_period_is_given(run, tmp_path: Path) -> None:
    head, *rows = write_log(tmp_path / "s.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    cells[100][1] = ""
    log = tmp_path / "ms.csv"
    log.write_text("\n".join([head, *(",".join([f"{1000.0 * float(t_s)}", *others]) for t_s, *others in cells)]))
    line = ["identify", log, *CHANNELS, "--method", "okid-era", "--order", "2", "--allow-gaps", "--no-page", "--json", "--out"]
    assert_refused(run(*line, tmp_path / "a.json"), "'t_s' steps by 250 s; if it counts milliseconds, give --period 0.25 or name")
    for period_s in ("250", "0.25"):
        assert run(*line, tmp_path / f"{period_s}.json", "--period", period_s).values
