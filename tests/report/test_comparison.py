"""The table of figures: verdicts that follow from the numbers, sensitivities, and the headline figures of README and evidence."""

import json
from operator import attrgetter
from pathlib import Path
from typing import Any

import pytest
from publish import BEGIN, END, published, published_of, with_table

from treadline.core.errors import SettingsError
from treadline.report._results import Results
from treadline.report.comparison import answer, comparisons

from .conftest import Transcript

Tables = dict[str, Any]
ROOT = Path(__file__).parents[2]
TRANSCRIPT = Transcript(Path(__file__).with_name("comparison.txt"))


def said_of(tables: Tables) -> dict[str, str]:
    """Return the rows of all sections by figure, and the sentences of the answer by their first word."""
    results = Results.model_validate(tables)
    rows = [row for section in ("paper", "beyond", "machine") for row in comparisons(results, section)]
    fields = attrgetter("paper", "ours", "target", "verdict", "conditions", "sensitivity")
    said = {row.figure: " | ".join(filter(None, fields(row))) for row in rows}
    return said | dict(sentence.split(": ", 1) for sentence in answer(tables))


def change(tables: Any, path: list[str], value: Any) -> None:
    """Replace a value by its path; an item of a list that becomes null is left out."""
    for key in range(len(tables)) if path[0] == "*" else [int(path[0]) if isinstance(tables, list) else path[0]]:
        if path[1:]:
            change(tables[key], path[1:], value)
        elif isinstance(tables, list) and value is None:
            del tables[key]
        else:
            tables[key] = value


@pytest.mark.parametrize("title", TRANSCRIPT.sessions)
def test_rows_and_answer_follow_from_the_results(results: Tables, title: str) -> None:
    """Test: some results changed. Expected: rows and sentences that say something else (+), and those that are gone (-)."""
    changes = [line for line in TRANSCRIPT.sessions[title] if line.startswith("= ")]
    before = said_of(results) if changes else {}
    for line in changes:
        _, path, value = line.split(" ", 2)
        change(results, path.split("."), json.loads(value))
    after = said_of(results)
    anew = [f"+ {what}: {said}" for what, said in after.items() if before.get(what) != said]
    TRANSCRIPT.check(title, [*changes, *anew, *(f"- {what}" for what in before if what not in after)])


def test_a_criterion_of_the_papers_items_names_its_source(results: Tables) -> None:
    rows = comparisons(Results.model_validate(results))
    assert [row.target for row in rows if row.verdict != "–" and not row.target.endswith(")")] == []


def test_nothing_measured_leaves_an_empty_summary() -> None:
    assert said_of({"quick": False}) == headlines({"quick": False}) == {}


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
