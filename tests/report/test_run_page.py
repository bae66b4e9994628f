"""The page of one run: what it was, its scores in words, and its course from the files of its folder alone."""

import json
import math
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import world

from treadline.core.errors import SettingsError
from treadline.core.ports import Truth
from treadline.io.mcap_log import RunLog
from treadline.io.runs import read_series
from treadline.playback import read_recording
from treadline.report import write_report
from treadline.report._results import Manifest, RunResult
from treadline.report._run_page import headline
from treadline.report.labels import LABELS, score_groups
from treadline.report.run_figure import single_run
from treadline.run.run_scores import Scores, Trace
from treadline.vehicle.comfort import comfort, lasting

from .conftest import HOSTILE

SEAT = {"settle_s": 1.73, "start_deg": 24.1, "steady_error_deg": 0.001, "steady_rms_deg": 0.01, "max_error_deg": 0.95}
PHASES = [(0.0, "search"), (0.1, "align"), (5.4, "approach"), (9.9, "climb"), (25.0, "arrived")]


def page_of(folder: Path) -> str:
    return write_report(folder).read_text(encoding="utf-8")


def result_of(**values: Any) -> RunResult:
    return RunResult.model_validate({"verdict": "time_up"} | values)


def titles_of(folder: Path, **options: Any) -> list[str]:
    """Return what the figure's panels show, from above."""
    return [ax.get_title(loc="left") for ax in single_run(read_series(folder), [], **options).axes]


def truth_at(t_s: float) -> Truth:
    rocks = {"pitch_rate_rad_s": math.sin(3.0 * t_s), "passenger_x_m": 0.2 * t_s, "passenger_z_m": 0.01 * math.sin(9.0 * t_s)}
    return world.truth(t_s, **rocks)


def changed(path: Path, **values: Any) -> None:
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | values), encoding="utf-8")


def test_one_run_has_a_page_with_its_figures_events_and_settings(run_folder: Path) -> None:
    page = page_of(run_folder)
    assert "<h1>climb paper-28: held (no command)</h1>" in page
    assert '<td>RMS over the whole run <code class="key">rms_heading_deg</code></td><td class="n">1.23°</td>' in page
    assert '<td>settling time to ±2° <code class="key">settle_s</code></td><td class="n">not settled</td>' in page
    assert "no command for 0.5 s" in page
    assert "slope_deg" in page
    assert page.count('<div class="wide column"><svg') == 1
    assert "http:" not in page
    assert page.count("<script") == 2  # the player's data and its script, under its hash
    assert "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-" in page


def test_hostile_text_in_one_run_is_escaped(run_folder: Path) -> None:
    event = {"t_s": 0.0, "name": HOSTILE, "cause": HOSTILE}
    changed(run_folder / "result.json", verdict=HOSTILE, events=[event], **{HOSTILE: 1.0})
    changed(run_folder / "manifest.json", command=HOSTILE, other=HOSTILE)
    page = page_of(run_folder)
    assert page.count("<script") == 2
    assert HOSTILE not in page


def test_a_result_of_another_seed_than_the_manifest_is_refused(run_folder: Path) -> None:
    changed(run_folder / "result.json", seed=4)
    with pytest.raises(SettingsError, match=r"result\.json is of seed 4, manifest\.json of 3"):
        write_report(run_folder)


@pytest.mark.parametrize(
    ("command", "values", "said"),
    [
        ("treadline climb up-28 --out runs/up", {"verdict": "arrived", "duration_s": 48.75}, "climb up-28: arrived after 48.8 s"),
        ("treadline climb --out up --json up-28", {"duration_s": 80.0}, "climb up-28: driven to the end of its time, 80.0 s"),
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


def test_every_score_of_a_run_has_a_label_and_is_shown_once() -> None:
    names = {item.name for item in fields(Scores)} - {"phases"}
    assert names <= LABELS.keys()
    groups = score_groups(dict.fromkeys(names, 1.0) | {"foreign": 7}, None)
    keys = [key for group in groups for key, _, _ in group.rows]
    assert sorted(keys) == sorted({*names, "foreign"})
    assert groups[-1].rows == [("foreign", "foreign", "7")]


def test_counts_are_whole_numbers_and_measures_have_units() -> None:
    figures = {"frames": 151, "brakes_differ": 0, "largest_command_gap_m_s": 0.5, "vision_rms_error_deg": 0.0033, "settle_s": None}
    figures |= {"energy_wh": 1.234, "seconds_below_7_deg": 0.05, "max_belt_force_n": 312.4, "ms_per_frame": 3.21}
    assert {key: value for group in score_groups(figures, None) for key, _, value in group.rows} == {
        "frames": "151",
        "brakes_differ": "0",
        "largest_command_gap_m_s": "0.500 m/s",
        "vision_rms_error_deg": "0.003°",
        "settle_s": "not settled",
        "energy_wh": "1.23 Wh",
        "seconds_below_7_deg": "0.050 s",
        "max_belt_force_n": "312 N",
        "ms_per_frame": "3.2 ms",
    }


def test_a_run_of_the_seat_alone_shows_the_seats_figures_first(run_folder: Path) -> None:
    first, *others = score_groups({"settle_s": None, "rms_heading_deg": 30.1, "min_stability_margin_deg": 22.7}, SEAT)
    assert first.rows[0] == ("seat.settle_s", "settling time to ±1° of horizontal", "1.73 s")
    assert [key for group in others if group.aside for key, _, _ in group.rows] == ["rms_heading_deg", "settle_s"]
    titles = titles_of(run_folder, seat_alone=True)
    assert titles[0] == "seat pitch [°]"
    assert not any("heading" in title or "belt" in title for title in titles)


def test_a_traversal_has_its_phases_as_bands(run_folder: Path) -> None:
    strip = single_run(read_series(run_folder), PHASES).axes[0]
    assert [text.get_text() for text in strip.texts] == ["search", "align", "approach", "climb", "arrived"]
    places = [text.get_position()[0] for text in strip.texts]
    assert places == sorted(places)
    assert min(np.diff(places)) > 0.3  # of 30 s on 7 in: none over another, also where a phase lasted 0.1 s
    assert "phase" not in titles_of(run_folder)


def test_a_steady_part_that_a_start_dwarfs_is_drawn_closer(run_folder: Path) -> None:
    figure = single_run(read_series(run_folder), [])
    (closer,) = [ax for ax in figure.axes if ax.get_title(loc="left") == "heading, steady interval, enlarged [°]"]
    low, high = closer.get_ylim()
    assert -0.1 < low < 0.0 < high < 0.1  # the series starts at 10°


def test_the_curves_of_a_log_are_what_the_scores_are_the_peaks_of(run_folder: Path) -> None:
    assert not any("mean over 50 ms" in title for title in titles_of(run_folder))
    truth = [truth_at(0.01 * k) for k in range(500)]
    with RunLog(run_folder / "log.mcap") as log:
        for sample in truth:
            log(sample)
    figure = single_run(read_series(run_folder), [], read_recording(run_folder))
    rate, passenger = (ax.lines[0].get_ydata() for ax in figure.axes if "mean over 50 ms" in ax.get_title(loc="left"))
    trace = Trace.of(truth)
    assert np.radians(np.abs(rate).max()) == pytest.approx(np.abs(lasting(trace["pitch_rate_rad_s"])).max())
    # Stamps are kept to the nanosecond, and differences of places are divided by them twice.
    places_W = np.stack([trace[f"passenger_{axis}_m"] for axis in "xyz"])
    assert passenger.max() == pytest.approx(comfort(places_W, trace["yaw_rad"]).total_m_s2, rel=1e-5)


def test_what_a_log_without_truth_does_not_know_has_no_panel(run_folder: Path) -> None:
    series = read_series(run_folder)
    for name in ("heading_deg", "pitch_deg", "y_m", "stability_margin_deg"):
        series[name] = np.full_like(series["t_s"], np.nan)
    titles = [ax.get_title(loc="left") for ax in single_run(series, []).axes]
    assert titles[0] == "heading [°]"  # the estimate is there
    assert not any(word in title for title in titles for word in ("pitch of", "lateral", "margin"))
