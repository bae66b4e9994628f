"""A recorded run, whole: its folder holds what the run returned, and bad settings leave no folder."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from treadline.core.errors import SettingsError
from treadline.core.ports import Truth
from treadline.identification.excitation_signal import ExcitationConfig
from treadline.io.mcap_read import read_log
from treadline.io.records import read_record
from treadline.io.runs import read_series
from treadline.run.excitation_run import INPUTS, OUTPUTS, Excited, excite
from treadline.scenario.scenario import read_scenario

SCENARIO = read_scenario("paper-28")


@pytest.fixture(scope="module")
def excited(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Excited]:
    folder = tmp_path_factory.mktemp("runs")
    runs = [excite(SCENARIO, folder=folder / name, samples=20, period_s=0.05, seed=1, image_every=5) for name in "ab"]
    return folder, runs[0]


def test_the_record_on_disk_is_the_record_returned(excited: tuple[Path, Excited]) -> None:
    folder, run = excited
    back = read_record(folder / "a", INPUTS, OUTPUTS)
    np.testing.assert_array_equal(back.u, run.record.u)
    np.testing.assert_array_equal(back.y, run.record.y)


def test_the_log_holds_the_truth_that_was_scored(excited: tuple[Path, Excited]) -> None:
    folder, run = excited
    truth = [signal for signal in read_log(folder / "a" / "log.mcap") if isinstance(signal, Truth)]
    np.testing.assert_array_equal([sample.heading_rad for sample in truth], run.run.trace["heading_rad"])


def test_the_series_is_the_trace_in_degrees(excited: tuple[Path, Excited]) -> None:
    folder, run = excited
    series = read_series(folder / "a")
    wanted = np.rad2deg(run.run.trace["heading_rad"][::10])
    # Six significant digits.
    np.testing.assert_allclose(series["heading_deg"], wanted, rtol=5e-6)


def test_the_manifest_says_what_pulls_the_chair_back(excited: tuple[Path, Excited]) -> None:
    folder, _ = excited
    entry = json.loads((folder / "a" / "manifest.json").read_text())["excitation"]
    assert entry == asdict(ExcitationConfig(mean_m_s=SCENARIO.drive.speed_m_s))
    assert entry["pull_m_s_per_rad"] > 0.0


def test_bad_settings_leave_no_folder(tmp_path: Path) -> None:
    throne = SCENARIO.model_copy(update={"chair": SCENARIO.chair.model_copy(update={"model": "throne"})})
    with pytest.raises(SettingsError, match=r"chair\.model"):
        excite(throne, folder=tmp_path / "run", samples=20, period_s=0.05, seed=1)
    assert not list(tmp_path.iterdir())
