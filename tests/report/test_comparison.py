"""The table of figures: verdicts that follow from the numbers, sensitivities, and the headline figures of README and evidence."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from publish import BEGIN, END, published, published_of, with_table

from treadline.core.errors import SettingsError
from treadline.report._results import Moves, Results
from treadline.report.comparison import FigureRow, comparisons, moves_text

Tables = dict[str, Any]
ROOT = Path(__file__).parents[2]
MOVES = {"unit": "m", "conditions": "from +30°, one seed", "step": 0.001, "stiffness": 0.0042, "friction": 0.013}


def rows_of(tables: Tables) -> dict[str, FigureRow]:
    return {row.figure: row for row in comparisons(Results.model_validate(tables))}


def row_of(tables: Tables, start: str) -> FigureRow:
    (row,) = [row for what, row in rows_of(tables).items() if what.startswith(start)]
    return row


def test_a_folder_that_reaches_everything_misses_nothing(results: Tables) -> None:
    assert {row.verdict for row in rows_of(results).values()} == {"reached", "–"}


def test_a_missed_target_says_by_how_much(results: Tables) -> None:
    for cell in results["table2"]:
        if cell["start_heading_deg"] > 0:
            cell["rms_heading_deg"] = 3.27
    assert row_of(results, "Table II: RMS heading from +30°").verdict == "missed by 0.97°"
    assert row_of(results, "Table II: RMS heading from -30°").verdict == "reached"


def test_a_target_to_stay_above_is_missed_from_below(results: Tables) -> None:
    results["speed"]["physics_real_time_factor"] = 38.0
    row = row_of(results, "physics alone")
    assert (row.target, row.verdict) == ("≥ 50 ×", "missed by 12 ×")


def test_the_bound_itself_is_reached(results: Tables) -> None:
    for cell in results["table2"]:
        cell["rms_heading_deg"] = 2.3
    assert row_of(results, "Table II: RMS heading from +30°").verdict == "reached"


def test_one_run_that_never_settles_leaves_its_row_without_a_figure(results: Tables) -> None:
    results["table2"][1]["settle_s"] = None
    assert row_of(results, "settling to ±2° at 28°").ours == "none"


def test_the_worst_of_both_starts_is_judged(results: Tables) -> None:
    results["table2"][4]["roll_back_m"] = 0.08
    assert row_of(results, "roll-back at 28°").verdict == "missed by 0.03 m"
    assert row_of(results, "roll-back at 25°").verdict == "reached"


def test_a_target_is_judged_only_where_one_was_set(results: Tables) -> None:
    seat, opened = row_of(results, "Fig. 11"), row_of(results, "Fig. 9: open loop")
    assert (seat.ours, seat.paper, seat.target, seat.verdict) == ("0.003°", "about 0°", "–", "–")
    assert (opened.ours, opened.target, opened.verdict) == ("7.25°, 7.25°", "–", "–")
    assert "largest heading 7.5°" in opened.conditions


def test_a_run_that_ended_early_is_named_and_never_averaged(results: Tables) -> None:
    end = "seed 3 fell after 1.7 s: slid 0.50 m down the flight"
    whole = row_of(results, "Table II with roll-back allowed")
    results["table2_roll_back_allowed"][2] |= {"rms_heading_deg": None, "rms_yaw_deg": None, "averaged": 0, "ended_early": [end]}
    results["table2"][0] |= {"averaged": 4, "ended_early": [end]}
    row = row_of(results, "Table II with roll-back allowed")
    assert row.ours == whole.ours  # all cells have the same figure, and the one that is left out changes nothing
    assert row.verdict == "missed: a run ended early"
    cell = results["table2_roll_back_allowed"][2]
    assert f"ended early and not averaged: {cell['slope_deg']:g}°, {cell['start_heading_deg']:+g}°, {end}" in row.conditions
    assert end in row_of(results, "Table II: RMS heading from +30°").conditions
    assert row_of(results, "Table II: RMS heading from +30°").verdict == "missed: a run ended early"
    assert row_of(results, "Table II: RMS heading from -30°").verdict == "reached"
    said = json.dumps(published(Results.model_validate(results)), ensure_ascii=False)
    assert end in said  # at the row of the cell in the README's figures, too


def test_a_table_of_falls_alone_has_no_figure(results: Tables) -> None:
    for cell in results["table2_roll_back_allowed"]:
        cell |= {"rms_heading_deg": None, "rms_yaw_deg": None, "averaged": 0, "ended_early": ["seed 0 fell after 1.7 s"]}
    row = row_of(results, "Table II with roll-back allowed: average of no slope")
    assert (row.ours, row.verdict) == ("none", "missed: a run ended early")


def test_a_quick_run_judges_nothing_that_rests_on_shortened_runs(results: Tables) -> None:
    rows = rows_of(results | {"quick": True, "wall_s": 55.0})
    judged = {what for what, row in rows.items() if row.verdict not in ("–", "quick run: not judged")}
    assert len(judged) == 4
    assert all(re.match(r"Eq\. \(14\)|physics alone|camera, vision|reproduce --quick", what) for what in judged)
    assert rows["reproduce --quick, wall clock"].target == "≤ 100 s"


def test_another_slope_is_shown_without_a_target(results: Tables) -> None:
    for key in ("table2", "table2_roll_back_allowed"):
        for cell in results[key]:
            cell["slope_deg"] += 0.5
    assert row_of(results, "roll-back at 28.5°").verdict == "–"
    assert row_of(results, "Table II: RMS heading from +30°").target == "–"


def test_steady_targets_are_for_half_a_degree_of_gravity_error(results: Tables) -> None:
    # On Table I's friction the dead zone leaves the heading where the turn ended: no target.
    assert row_of(results, "steady RMS heading, mean").verdict == "–"
    for cell in results["table2"]:
        cell["friction"] = [0.9, 0.5]
    assert row_of(results, "steady RMS heading, mean").verdict == "reached"
    assert row_of(results | {"gravity_error_deg": 0.0}, "steady RMS heading, mean").verdict == "–"


def test_the_printed_heading_stands_beside_the_one_that_drives(results: Tables) -> None:
    row = row_of(results, "Fig. 5: estimated heading, true heading 10.00°")
    assert (row.ours, row.paper) == ("10.00°", "107.90° by Eq. (2), computed here")
    results["fig05"]["robust_heading_deg"] = None
    assert row_of(results, "Fig. 5").ours == "none"


def test_a_record_from_the_dead_zone_is_said_to_hold_nothing_to_identify(results: Tables) -> None:
    results["fig08"]["slopes"][0]["yaw_rate_vaf_percent"] = 8.0
    row = row_of(results, "yaw rate one step ahead at 25°")
    assert row.ours == "8 %"
    assert row.conditions.startswith("not identifiable")
    assert row.verdict == "–"


def test_a_large_miss_is_written_without_an_exponent(results: Tables) -> None:
    results["wall_s"] = 1792.0
    assert row_of(results, "reproduce, wall clock").verdict == "missed by 1362 s"


def belt_run(course: str, lug: str, rubber_s: float | None, roll_back_m: float, **changes: object) -> Tables:
    return {
        "course": course,
        "slope_deg": 28,
        "friction": [0.62, 0.5],
        "lug": lug,
        "rubber_s": rubber_s,
        "rms_heading_deg": 9.0,
        "roll_back_m": roll_back_m,
        "passenger_m_s2": 1.0 if lug == "none" else 6.5,
        "pitch_rate_deg_s": 10.0,
        "margin_deg": 15.0,
        "max_contact_force_share": 4.0,
        "duration_s": 4.0,
        "verdict": "time_up",
        "cause": None,
        "seed": 0,
        "run": f"{course}-{lug.replace('/', '-')}-{rubber_s}",
    } | changes


def test_lugs_stand_next_to_smooth_belts_with_the_bracket_of_the_rubber(results: Tables) -> None:
    results["lugs"] = [
        belt_run("turn-28", "none", None, 0.020),
        belt_run("turn-28", "15/80", 0.005, 0.017),
        belt_run("turn-28", "15/80", 0.01, 0.016),
        belt_run("turn-28", "15/80", 0.02, 0.012, verdict="held", cause="pitch rate"),
        belt_run("up-28", "none", None, 0.01),
        belt_run("up-28", "15/80", 0.01, 0.01),
    ]
    back = row_of(results, "roll-back at 28°, lugs 15/80 mm")
    assert (back.ours, back.target, back.verdict) == ("0.016 m", "≤ 0.05 m", "reached")
    assert "smooth belts 0.020 m in the same run; 0.012 m to 0.017 m with rubber of 0.005 to 0.02 s" in back.conditions
    assert "held (pitch rate)" in back.conditions
    ride = row_of(results, "passenger's acceleration, up-28, lugs 15/80 mm")
    assert (ride.ours, ride.verdict) == ("6.5 m/s²", "missed by 5 m/s²")
    assert "with rubber" not in ride.conditions  # one stiffness is no bracket


def test_lugs_without_smooth_belts_to_compare_with_have_no_row(results: Tables) -> None:
    results["lugs"] = [belt_run("turn-28", "15/80", 0.01, 0.016)]
    assert not [what for what in rows_of(results) if "lugs" in what]


@pytest.mark.parametrize("part", ["fig05", "fig08", "fig11", "literal", "speed"])
def test_what_was_not_measured_has_no_row(results: Tables, part: str) -> None:
    assert len(rows_of(results | {part: None})) < len(rows_of(results))


def test_nothing_measured_leaves_an_empty_summary() -> None:
    assert rows_of({"quick": False}) == headlines({"quick": False}) == {}


def test_fewer_than_five_seeds_and_quick_runs_are_not_published(results: Tables, tmp_path: Path) -> None:
    file = tmp_path / "results.json"
    file.write_text(json.dumps(results), encoding="utf-8")
    assert published_of(tmp_path)["figures"]
    results["table2"][3]["seeds"] = 2
    file.write_text(json.dumps(results), encoding="utf-8")
    with pytest.raises(SettingsError, match="Table II has 2 seeds, 5 are published: treadline reproduce --seeds 5"):
        published_of(tmp_path)
    file.write_text(json.dumps(results | {"quick": True}), encoding="utf-8")
    with pytest.raises(SettingsError, match="a quick reproduction is not published"):
        published_of(tmp_path)


# ---- sensitivity ----


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({}, "±0.001 m with step size, ±0.0042 m with stiffness, ±0.013 m with friction ±20 % (from +30°, one seed)"),
        (
            {"friction": None, "lost": ["friction -20 %"], "exceeded": ["friction"], "missed": ["step 1 ms"], "conditions": ""},
            "±0.001 m with step size, ±0.0042 m with stiffness; no figure with friction -20 %; "
            "margin exceeded with friction; target missed with step 1 ms",
        ),
        ({"step": None, "stiffness": None, "friction": None, "lost": ["step 1 ms"]}, "no figure with step 1 ms"),
        (
            {"step": 4.7e-05, "stiffness": 148.2, "friction": 0.0, "conditions": ""},
            "±0.000 m with step size, ±148 m with stiffness, ±0.000 m with friction ±20 %",
        ),
    ],
)
def test_moves_are_written_with_their_units(changes: Tables, says: str) -> None:
    assert moves_text(Moves.model_validate(MOVES | changes)) == says


def test_a_row_has_the_moves_of_its_figure_and_no_other(results: Tables) -> None:
    results["sensitivity"] = {"table2/0.62-0.5/28/roll_back_m": MOVES}
    assert [what for what, row in rows_of(results).items() if row.sensitivity] == ["roll-back at 28°, friction 0.62/0.5"]
    # A quick run's figures rest on shortened runs, which no budget was made for.
    assert not any(row.sensitivity for row in rows_of(results | {"quick": True}).values())


# ---- headline figures of README and evidence ----


def headlines(tables: Tables) -> dict[str, str]:
    return {row["figure"]: row["ours"] for row in published(Results.model_validate(tables))["figures"]}


def test_the_readme_has_the_figures_of_the_published_results() -> None:
    values = json.loads((ROOT / "docs" / "evidence" / "results.json").read_text(encoding="utf-8"))
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert with_table(readme, values) == readme, "make publish writes both"
    assert 1 <= len(values["figures"]) <= 10
    assert all(row["conditions"] for row in values["figures"])


def test_headlines_state_each_start_and_the_worst_run(results: Tables) -> None:
    results["table2"][0] |= {"rms_heading_deg": 3.21, "settle_s": None}
    results["table2"][4]["roll_back_m"] = 0.08
    rows = headlines(results)
    assert rows["Table II: RMS heading at 25°, from +30° / -30°"] == "3.21° / 2.20°"
    assert rows["roll-back in these turns at 25° / 28° / 30°"] == "0.010 / 0.080 / 0.010 m"
    assert rows["settling to ±2° at 25° / 28° / 30°"] == "never / 3.0 / 3.0 s"
    assert rows["Fig. 11: steady seat error"] == "0.003°, settles in 2.0 s"


def test_headlines_of_lugs_stand_next_to_smooth_belts(results: Tables) -> None:
    results["lugs"] = [belt_run("up-28", "none", None, 0.01), belt_run("up-28", "15/80", 0.01, 0.01)]
    label = "whole traversal up-28, passenger's acceleration: smooth belts / lugs 15/80 mm"
    assert headlines(results)[label] == "1 / 6.5 m/s²"


def test_a_readme_without_its_markers_is_refused() -> None:
    with pytest.raises(ValueError, match="once each, in this order"):
        with_table(f"{END} text {BEGIN}", {"figures": []})
