"""The table of figures: verdicts that follow from the numbers, sensitivities, and the headline figures of README and evidence."""

import json
from pathlib import Path
from typing import Any

import pytest
from publish import BEGIN, END, published, published_of, with_table

from treadline.core.errors import SettingsError
from treadline.report._results import Moves, Results
from treadline.report.comparison import FigureRow, answer, comparisons, moves_text

Tables = dict[str, Any]
ROOT = Path(__file__).parents[2]
MOVES = {"unit": "m", "conditions": "from +30°, one seed", "step": 0.001, "stiffness": 0.0042, "friction": 0.013}


def rows_of(tables: Tables) -> dict[str, FigureRow]:
    results = Results.model_validate(tables)
    return {row.figure: row for section in ("paper", "beyond", "machine") for row in comparisons(results, section)}


def row_of(tables: Tables, start: str) -> FigureRow:
    (row,) = [row for what, row in rows_of(tables).items() if what.startswith(start)]
    return row


def test_a_folder_that_reaches_everything_misses_nothing(results: Tables) -> None:
    assert {row.verdict for row in rows_of(results).values()} <= {"reached", "reproduced", "not reproduced", "–"}


def test_a_missed_target_says_by_how_much(results: Tables) -> None:
    for cell in results["table2"]:
        if cell["start_heading_deg"] > 0:
            cell["rms_heading_deg"] = 3.27
    assert row_of(results, "RMS heading from +30°, average").verdict == "missed by 0.97°"
    assert row_of(results, "RMS heading from -30°, average").verdict == "reached"


def test_a_target_to_stay_above_is_missed_from_below(results: Tables) -> None:
    results["speed"]["physics_real_time_factor"] = 38.0
    row = row_of(results, "physics alone")
    assert (row.target, row.verdict) == ("≥ 50 × (ours)", "missed by 12 ×")


def test_the_bound_itself_is_reached(results: Tables) -> None:
    for cell in results["table2"]:
        cell["rms_heading_deg"] = 2.3
    assert row_of(results, "RMS heading from +30°, average").verdict == "reached"


def test_one_run_that_never_settles_leaves_its_row_without_a_figure(results: Tables) -> None:
    results["table2"][1]["settle_s"] = None
    assert row_of(results, "settling to ±2° at 28°").ours == "none"


def test_the_worst_of_both_starts_is_judged(results: Tables) -> None:
    results["table2"][4]["roll_back_m"] = 0.08
    assert row_of(results, "roll-back at 28°").verdict == "missed by 0.03 m"
    assert row_of(results, "roll-back at 25°").verdict == "reached"


def test_a_target_is_judged_only_where_one_was_set(results: Tables) -> None:
    settling = row_of(results, "settling to ±2° at 28°")
    assert (settling.target, settling.verdict) == ("–", "–")


def test_a_criterion_of_the_papers_items_names_its_source(results: Tables) -> None:
    rows = comparisons(Results.model_validate(results))
    assert [row.target for row in rows if row.verdict != "–" and not row.target.endswith(")")] == []
    assert row_of(results, "Fig. 10").target == "≤ 20 s (paper, as far as its axis can be read)"


def test_the_answer_says_what_was_reproduced_what_was_not_and_why(results: Tables) -> None:
    results["fig09"][0] |= {"loop": "closed", "rms_heading_deg": 0.04}
    results["fig11"]["settle_s"] = None
    reproduced, failed, why = answer(comparisons(Results.model_validate(results)))
    assert "the gain of Eq. (14)" in reproduced
    assert "(Fig. 9)" in reproduced
    assert "the level seat (Fig. 11)" in failed
    assert "the seat does not settle" in why
    assert "arccosine" in why


@pytest.mark.parametrize(("worst_gap", "verdict"), [(0.5, "reproduced"), (0.6, "not reproduced")])
def test_table_2_is_reproduced_if_its_worst_cell_is_near_the_print(results: Tables, worst_gap: float, verdict: str) -> None:
    for cell in results["table2"]:
        cell["paper_deg"] = 2.0
        cell["rms_heading_deg"] = 2.25
    results["table2"][3]["rms_heading_deg"] = 2.0 + worst_gap
    assert row_of(results, "Table II: RMS heading from +30° / -30°, whole run").verdict == verdict


@pytest.mark.parametrize("how", ["fell", "missing"])
def test_the_answer_claims_nothing_that_rests_on_runs_that_fell_or_are_missing(results: Tables, how: str) -> None:
    """Test: turns like the paper's, but one of the five runs from -30° at 28° fell; no run from there. Expected: not reproduced."""
    for cell in results["table2"]:
        cell |= {"rms_heading_deg": 2.0, "paper_deg": 2.0}
    (lacking,) = [c for c in results["table2"] if (c["slope_deg"], c["start_heading_deg"]) == (28, -30)]
    if how == "fell":
        lacking |= {"averaged": 4, "ended_early": ["seed 2 fell after 1.7 s"]}
    else:
        results["table2"].remove(lacking)
    _, failed, why = answer(comparisons(Results.model_validate(results)))
    assert "the turns from ±30° (Fig. 10)" in failed
    assert "Table II cell by cell, at 25°, 28°, 30°" in failed
    assert "a run ended early or is missing" in why


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
    assert end in row_of(results, "RMS heading from +30°, average").conditions
    assert row_of(results, "RMS heading from +30°, average").verdict == "missed: a run ended early"
    assert row_of(results, "RMS heading from -30°, average").verdict == "reached"
    said = json.dumps(published(Results.model_validate(results)), ensure_ascii=False)
    assert end in said  # at the row of the table in the README's figures, too


def test_a_table_of_falls_alone_has_no_figure(results: Tables) -> None:
    for cell in results["table2_roll_back_allowed"]:
        cell |= {"rms_heading_deg": None, "rms_yaw_deg": None, "averaged": 0, "ended_early": ["seed 0 fell after 1.7 s"]}
    row = row_of(results, "Table II with roll-back allowed: average of no slope")
    assert (row.ours, row.verdict) == ("none", "missed: a run ended early")


def test_a_quick_run_has_a_limit_of_its_own(results: Tables) -> None:
    assert row_of(results | {"quick": True, "wall_s": 55.0}, "reproduce --quick, wall clock").target == "≤ 100 s (ours)"


def test_another_slope_is_shown_without_a_target(results: Tables) -> None:
    for key in ("table2", "table2_roll_back_allowed"):
        for cell in results[key]:
            cell["slope_deg"] += 0.5
    assert row_of(results, "roll-back at 28.5°").verdict == "–"
    assert row_of(results, "RMS heading from +30°, average").target == "–"


def test_steady_targets_are_for_half_a_degree_of_gravity_error(results: Tables) -> None:
    # On Table I's friction the dead zone leaves the heading where the turn ended: no target.
    assert row_of(results, "steady RMS heading, mean").verdict == "–"
    for cell in results["table2"]:
        cell["friction"] = [0.9, 0.5]
    assert row_of(results, "steady RMS heading, mean").verdict == "reached"
    assert row_of(results | {"gravity_error_deg": 0.0}, "steady RMS heading, mean").verdict == "–"


def test_the_printed_heading_stands_beside_the_one_that_drives(results: Tables) -> None:
    row = row_of(results, "Fig. 5: heading of one frame, true heading 10.00°")
    assert (row.ours, row.verdict) == ("10.00°; by Eq. (2) as printed 107.90°", "not reproduced")
    results["fig05"]["robust_heading_deg"] = None
    assert row_of(results, "Fig. 5").ours.startswith("none; by Eq. (2)")


def test_a_record_from_the_dead_zone_is_said_to_hold_nothing_to_identify(results: Tables) -> None:
    results["fig08"]["slopes"][0]["yaw_rate_vaf_percent"] = 8.0
    row = row_of(results, "yaw rate one step ahead at 25°")
    assert row.ours == "8 %"
    assert row.conditions.startswith("not identifiable")
    assert row.verdict == "–"


def test_a_large_miss_is_written_without_an_exponent(results: Tables) -> None:
    results["wall_s"] = 1792.0
    assert row_of(results, "reproduce, wall clock").verdict == "missed by 1362 s"


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


# ---- headline figures of README and evidence ----


def headlines(tables: Tables) -> dict[str, str]:
    return {row["figure"]: row["ours"] for row in published(Results.model_validate(tables))["figures"]}


def test_the_readme_has_the_figures_of_the_published_results() -> None:
    values = json.loads((ROOT / "docs" / "evidence" / "results.json").read_text(encoding="utf-8"))
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert with_table(readme, values) == readme, "make publish writes both"
    assert 1 <= len(values["figures"]) <= 10
    assert all(row["conditions"] for row in values["figures"])


def test_published_figures_state_each_start_and_the_worst_run(results: Tables) -> None:
    results["table2"][0] |= {"rms_heading_deg": 3.21, "settle_s": None}
    results["table2"][4]["roll_back_m"] = 0.08
    rows = {row["figure"]: row for row in published(Results.model_validate(results))["figures"]}
    table = rows["Table II: RMS heading from +30° / -30°, whole run"]
    assert table["ours"].startswith("25°: 3.21° / 2.20°; 28°: ")
    assert "roll-back up to 0.08 m" in table["conditions"]
    assert rows["Fig. 11: seat from the slope of 28° to level"]["ours"] == "settles to ±1° in 2.0 s, then 0.003° off"


def test_a_readme_without_its_markers_is_refused() -> None:
    with pytest.raises(ValueError, match="once each, in this order"):
        with_table(f"{END} text {BEGIN}", {"figures": []})
