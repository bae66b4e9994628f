"""``identify --on`` as a user calls it: models side by side on one log, with start and horizon stated."""

from dataclasses import replace
from pathlib import Path

import pytest

from treadline.core.models import LinearModel
from treadline.io.records import read_record

from .conftest import assert_refused
from .test_identify import CHANNELS, write_log


@pytest.fixture
def two_models(run, tmp_path: Path) -> list[Path]:
    log = write_log(tmp_path / "fitted.csv", noise=0.2)
    common = ("identify", log, *CHANNELS, "--no-page", "--method", "pbsid")
    models = [tmp_path / "one.json", tmp_path / "two.json"]
    for order, path in enumerate(models, start=1):
        assert run(*common, "--order", order, "--out", path).code == 0
    return models


def test_models_are_scored_on_a_log_that_they_do_not_know(run, tmp_path: Path, two_models: list[Path]) -> None:
    log = write_log(tmp_path / "other.csv", seed=5, noise=0.2)
    outcome = run("identify", *two_models, "--on", log, "--page", tmp_path / "fits.svg", "--json")
    assert outcome.code == 0, outcome.err
    poor, good = outcome.values["models"]
    assert min(good["fit_percent"].values()) > max(poor["fit_percent"].values()) > 0.0  # an order too few
    assert good["fit_prefix_s"] == 15.0  # a tenth of 600 samples of 0.25 s
    assert good["samples"] == 540
    assert good["forecast_percent"] is None
    assert good["crosscorrelation_p"] > 0.01 > poor["crosscorrelation_p"]
    assert "<svg" in (tmp_path / "fits.svg").read_text(encoding="utf-8")
    record = read_record(log, ("left_m_s", "right_m_s"), ("heading_rad", "yaw_rate_rad_s"))
    assert LinearModel.load(two_models[1]).compare(record).fit_percent == good["fit_percent"]


def test_bad_input_is_one_line_with_the_remedy(run, tmp_path: Path, two_models: list[Path]) -> None:
    log = write_log(tmp_path / "other.csv")
    model = LinearModel.load(two_models[0])
    replace(model, input_names=(), output_names=()).save(tmp_path / "unnamed.json")
    assert_refused(run("identify", tmp_path / "unnamed.json", "--on", log), "give --inputs and --outputs")
    replace(model, dt_s=0.5).save(tmp_path / "slow.json")
    assert run("identify", tmp_path / "slow.json", "--on", log, "--resample", "--json").code == 0
