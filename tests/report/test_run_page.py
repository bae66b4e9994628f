"""The page of one run: what it was, its scores in words, and its course from the files of its folder alone."""

import json
import math
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from treadline.core.ports import Truth
from treadline.io.mcap_log import RunLog
from treadline.io.runs import read_series
from treadline.report import write_report
from treadline.report.headline import headline
from treadline.report.motion import read_motion
from treadline.report.results import Manifest, RunResult
from treadline.report.run_figure import single_run
from treadline.report.score_labels import WORDS, score_groups
from treadline.run.run_scores import Scores, Trace, comfort_of
from treadline.vehicle.comfort import lasting

SEAT = {"settle_s": 1.73, "start_deg": 24.1, "steady_error_deg": 0.001, "steady_rms_deg": 0.01, "max_error_deg": 0.95}
PHASES = [[0.0, "search"], [0.1, "align"], [5.4, "approach"], [9.9, "climb"], [25.0, "arrived"]]


def result_of(**values: Any) -> RunResult:
    return RunResult.model_validate({"verdict": "time_up"} | values)


def titles_of(folder: Path, result: RunResult) -> list[str]:
    """Return what the figure's panels show, from above."""
    figure = single_run(read_series(folder), result, read_motion(folder)[0])
    return [ax.get_title(loc="left") for ax in figure.axes]


def truth_at(t_s: float) -> Truth:
    values = {item.name: 0.0 for item in fields(Truth)}
    rocks = {"pitch_rate_rad_s": math.sin(3.0 * t_s), "passenger_x_m": 0.2 * t_s, "passenger_z_m": 0.01 * math.sin(9.0 * t_s)}
    return Truth(**(values | rocks | {"t_s": t_s}))


@pytest.mark.parametrize(
    ("command", "values", "said"),
    [
        ("treadline climb up-28 --out runs/up", {"verdict": "arrived", "duration_s": 48.75}, "climb up-28: arrived after 48.8 s"),
        ("treadline climb --out up --json up-28", {"duration_s": 80.0}, "climb up-28: driven to the end of its time, 80.0 s"),
        ("treadline excite paper-28 --out x", {"duration_s": 250.25}, "excite paper-28: driven to the end of its time, 250.2 s"),
        ("treadline replay runs/seen --set a=b", {"duration_s": 15.01}, "replay runs/seen: played to its end, 15.0 s"),
        ("treadline seat paper-28", {"seat": SEAT}, "seat paper-28: level within 1° after 1.73 s"),
        ("treadline seat x.toml", {"seat": SEAT | {"settle_s": None}}, "seat x.toml: the seat did not settle"),
        (
            "treadline climb b --out x",
            {"verdict": "refused", "cause": "too steep", "duration_s": 0.0},
            "climb b: refused (too steep)",
        ),
        ("python own.py", {"verdict": "fell"}, "One run: fell"),
        ("treadline 'unclosed", {"verdict": "fell"}, "One run: fell"),
        ("treadline reproduce --quick --out x", {}, "reproduce turn-28: driven to the end of its time"),
    ],
)
def test_the_heading_says_what_was_run_and_how_it_ended(command: str, values: dict[str, Any], said: str) -> None:
    assert headline(result_of(**values), Manifest(settings={}, seed=0, command=command), "turn-28") == said


def test_every_score_of_a_run_has_words_and_is_shown_once() -> None:
    names = {item.name for item in fields(Scores)} - {"phases"}
    assert names <= WORDS.keys()
    groups = score_groups(result_of(**dict.fromkeys(names, 1.0), seed=3, foreign=7))
    keys = [row.key for group in groups for row in group.rows]
    assert sorted(keys) == sorted({*names, "foreign"})
    assert groups[-1].rows[0].value == "7"


def test_counts_are_whole_numbers_and_measures_have_units() -> None:
    result = result_of(frames=151, brakes_differ=0, largest_command_gap_m_s=0.5, vision_rms_error_deg=0.0033, settle_s=None)
    rows = {row.key: row.value for group in score_groups(result) for row in group.rows}
    assert rows == {
        "frames": "151",
        "brakes_differ": "0",
        "largest_command_gap_m_s": "0.500 m/s",
        "vision_rms_error_deg": "0.003°",
        "settle_s": "not settled",
    }


def test_a_run_of_the_seat_alone_shows_the_seats_figures_first() -> None:
    first, *others = score_groups(result_of(seat=SEAT, settle_s=None, rms_heading_deg=30.1, min_stability_margin_deg=22.7))
    assert [(row.key, row.value) for row in first.rows][:1] == [("seat.settle_s", "1.73 s")]
    assert [row.key for group in others if group.aside for row in group.rows] == ["rms_heading_deg", "settle_s"]


def test_a_traversal_has_its_phases_as_bands(run_folder: Path) -> None:
    with_phases, without = (single_run(read_series(run_folder), result_of(phases=phases), None) for phases in (PHASES, []))
    strip = with_phases.axes[0]
    assert [text.get_text() for text in strip.texts] == ["search", "align", "approach", "climb", "arrived"]
    places = [text.get_position()[0] for text in strip.texts]
    assert places == sorted(places)
    assert min(np.diff(places)) > 0.3  # of 30 s on 7 in: none over another, also where a phase lasted 0.1 s
    assert "phase" not in [ax.get_title(loc="left") for ax in without.axes]


def test_a_replay_has_its_phases_from_its_events(run_folder: Path) -> None:
    events = [{"t_s": t_s, "name": name, "cause": ""} for t_s, name in [(0.0, "search"), (0.0, "seat_shifted"), (9.9, "climb")]]
    strip = single_run(read_series(run_folder), result_of(events=events), None).axes[0]
    assert [text.get_text() for text in strip.texts] == ["search", "climb"]


def test_a_steady_part_that_a_start_dwarfs_is_drawn_closer(run_folder: Path) -> None:
    figure = single_run(read_series(run_folder), result_of(), None)
    (closer,) = [ax for ax in figure.axes if ax.get_title(loc="left") == "heading, steady interval, enlarged [°]"]
    low, high = closer.get_ylim()
    assert -0.1 < low < 0.0 < high < 0.1  # the series starts at 10°


def test_without_a_log_its_curves_are_left_out_and_the_page_says_so(run_folder: Path) -> None:
    assert not any("pitch rate" in title for title in titles_of(run_folder, result_of()))
    assert "Pitch rate and passenger are not drawn: no log was kept." in write_report(run_folder).read_text(encoding="utf-8")


def test_the_curves_of_a_log_are_what_the_scores_are_the_peaks_of(run_folder: Path) -> None:
    truth = [truth_at(0.01 * k) for k in range(500)]
    with RunLog(run_folder / "log.mcap") as log:
        for sample in truth:
            log(sample)
    motion, unread = read_motion(run_folder)
    assert (unread, motion is None) == (None, False)
    assert motion is not None
    trace = Trace.of(truth)
    rate = np.abs(lasting(trace["pitch_rate_rad_s"])).max()
    assert np.radians(np.abs(motion.pitch_rate_deg_s).max()) == pytest.approx(rate)
    # Stamps are kept to the nanosecond, and differences of places are divided by them twice.
    assert motion.passenger_m_s2.max() == pytest.approx(comfort_of(trace).total_m_s2, rel=1e-5)
    assert sum("mean over 50 ms" in title for title in titles_of(run_folder, result_of())) == 2


def test_a_broken_log_costs_its_curves_alone(run_folder: Path) -> None:
    (run_folder / "log.mcap").write_bytes(b"no log")
    page = write_report(run_folder).read_text(encoding="utf-8")
    assert "log.mcap cannot be read" in page
    assert str(run_folder) not in page


def test_a_run_of_the_seat_has_no_panels_of_what_stands(run_folder: Path) -> None:
    titles = titles_of(run_folder, result_of(seat=SEAT))
    assert titles[0] == "seat pitch [°]"
    assert not any("heading" in title or "belt" in title for title in titles)


def test_what_a_log_without_truth_does_not_know_has_no_panel(run_folder: Path) -> None:
    series = read_series(run_folder)
    for name in ("heading_deg", "pitch_deg", "y_m", "stability_margin_deg"):
        series[name] = np.full_like(series["t_s"], np.nan)
    titles = [ax.get_title(loc="left") for ax in single_run(series, result_of(), None).axes]
    assert titles[0] == "heading [°]"  # the estimate is there
    assert not any(word in title for title in titles for word in ("pitch of", "lateral", "margin"))


def test_a_phase_that_is_none_is_refused(run_folder: Path) -> None:
    path = run_folder / "result.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"phases": [["early", "align"]]}))
    with pytest.raises(Exception, match=r"phases\.0"):
        write_report(run_folder)
