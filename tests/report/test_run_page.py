"""The page of one run: what it was, its scores in words, and its course from the files of its folder alone."""

import json
import math
import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import world
from hypothesis import given
from hypothesis import strategies as st

from treadline.core.errors import SettingsError
from treadline.core.ports import Truth
from treadline.io.mcap_log import RunLog
from treadline.io.runs import WALKED, read_series, write_series
from treadline.playback import Recording, read_recording
from treadline.report import write_report
from treadline.report._results import Manifest, RunResult
from treadline.report._run_page import headline
from treadline.report.labels import LABELS, score_groups
from treadline.report.run_figure import single_run
from treadline.report.walk_figure import walk_figure
from treadline.run.run_scores import Scores, Trace
from treadline.vehicle.comfort import comfort, lasting
from treadline.vehicle.ground_profile import ground_profile
from treadline.vehicle.rest_poses import rest_chair

from .conftest import Transcript, write_run


def truth_at(t_s: float) -> Truth:
    rocks = {"pitch_rate_rad_s": math.sin(3.0 * t_s), "passenger_x_m": 0.2 * t_s, "passenger_z_m": 0.01 * math.sin(9.0 * t_s)}
    return world.truth(t_s, **rocks)


def test_a_result_of_another_seed_than_the_manifest_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"result\.json is of seed 4, manifest\.json of 3"):
        write_report(write_run(tmp_path, seed=4))


HEADLINES = Transcript(Path(__file__).with_name("headlines.txt"))


@pytest.mark.parametrize("command", HEADLINES.sessions)
def test_the_heading_says_what_was_run_and_how_it_ended(command: str) -> None:
    """Test: a command and some results. Expected: the heading of the file."""
    given = HEADLINES.sessions[command][0]
    result = RunResult.model_validate(json.loads(given))
    HEADLINES.check(command, [given, headline(result, Manifest(settings={}, seed=0, command=command), "turn-28")])


def test_every_score_of_a_run_has_a_label_and_is_shown_once() -> None:
    names = {item.name for item in fields(Scores)} - {"phases"}
    assert names <= LABELS.keys()
    groups = score_groups(dict.fromkeys(names, 1.0) | {"foreign": 7}, None)
    keys = [key for group in groups for key, _, _ in group.rows]
    assert sorted(keys) == sorted({*names, "foreign"})
    assert groups[-1].rows == [("foreign", "foreign", "7")]


@given(
    st.floats(0.0, 999.0), st.sampled_from(["rms_heading_deg", "max_belt_force_n", "energy_wh", "seconds_below_7_deg", "foreign"])
)
def test_a_score_on_the_page_is_that_of_the_result_to_its_last_digit(value: float, key: str) -> None:
    (((_, _, text),),) = (group.rows for group in score_groups({key: value}, None))
    number = re.match(r"\d+(?:\.(\d+))?", text)
    assert float(number[0]) == pytest.approx(value, abs=0.5001 * 10.0 ** -len(number[1] or ""))


def test_the_curves_of_a_log_are_what_the_scores_are_the_peaks_of(run_folder: Path) -> None:
    truth = [truth_at(0.01 * k) for k in range(500)]
    with RunLog(run_folder / "log.mcap") as log:
        for sample in truth:
            log(sample)
    figure = single_run(read_series(run_folder), [], read_recording(run_folder))
    rate, passenger = (ax.lines[0].get_ydata() for ax in figure.axes if "mean over 50 ms" in ax.get_title(loc="left"))
    trace = Trace.of(truth)
    assert np.radians(np.abs(rate).max()) == pytest.approx(np.abs(lasting(trace["pitch_rate_rad_s"])).max())
    passenger_W = np.array([trace[f"passenger_{axis}_m"] for axis in "xyz"])
    # Stamps are kept to the nanosecond, and differences of places are divided by them twice.
    assert passenger.max() == pytest.approx(comfort(passenger_W, trace["yaw_rad"]).total_m_s2, rel=1e-5)


WALK = {name: np.linspace(-1.0, 3.0, 30) + number for number, name in enumerate(sorted(WALKED))}


def test_the_figure_of_a_way_has_the_values_planned_dashed_and_those_driven_solid(recording: Recording) -> None:
    figure = walk_figure(ground_profile(recording.staircase), rest_chair(recording.chair, 0.0), WALK, recording.columns)
    for dash, columns in (("--", WALK), ("-", recording.columns)):
        drawn = [line.get_xydata() for axes in figure.axes[1:] for line in axes.lines if line.get_linestyle() == dash]
        for name in ("pitch_deg", "flipper_deg", "rate_deg_s", "torque_n_m"):
            wanted = np.column_stack([columns["x_m"], columns[name]])
            assert any(np.array_equal(values, wanted, equal_nan=True) for values in drawn), (dash, name)


def test_the_page_of_a_run_draws_the_way_where_check_walked_it(tmp_path: Path) -> None:
    folder, drawing = write_run(tmp_path), tmp_path / "figures" / "check.svg"
    write_report(folder)
    assert not drawing.exists()
    write_series(folder, WALK, "check")
    write_report(folder)
    assert drawing.exists()
    (folder / "check.csv").write_text("x_m,z_m\n1,2\n", encoding="utf-8")
    with pytest.raises(SettingsError, match=r"check\.csv: not the columns of a walk"):
        write_report(folder)
