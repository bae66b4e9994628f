"""README and evidence state the same headline figures, computed from one ``results.json``."""

import json
from pathlib import Path
from typing import Any

import pytest

from treadline.report.headline_figures import BEGIN, END, headline_rows, published, readme_table, with_table
from treadline.report.results import Results

ROOT = Path(__file__).parents[2]


def test_the_readme_has_the_figures_of_the_published_results() -> None:
    values = json.loads((ROOT / "docs" / "evidence" / "results.json").read_text(encoding="utf-8"))
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert with_table(readme, values) == readme, "make publish writes both"
    assert 1 <= len(values["figures"]) <= 10
    assert all(row["conditions"] for row in values["figures"])


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 120


def test_the_files_that_the_readme_names_exist() -> None:
    words = (ROOT / "README.md").read_text(encoding="utf-8").replace("(", "`").replace(")", "`").split("`")
    named = [word for word in words if word.startswith("docs/")]
    assert len(named) > 10
    assert [word for word in named if not (ROOT / word).exists()] == []


def test_a_changed_figure_changes_the_table(results: dict[str, Any]) -> None:
    before = readme_table(published(Results.model_validate(results)))
    results["table2"][0]["rms_heading_deg"] = 3.21
    after = readme_table(published(Results.model_validate(results)))
    assert before != after
    assert "3.21° / 2.20°" in after


def test_rows_state_the_worst_run(results: dict[str, Any]) -> None:
    results["table2"][4]["roll_back_m"] = 0.08
    results["table2"][0]["settle_s"] = None
    rows = {row.figure: row for row in headline_rows(Results.model_validate(results))}
    assert rows["roll-back in these turns at 25° / 28° / 30°"].ours == "0.010 / 0.080 / 0.010 m"
    assert rows["settling to ±2° at 25° / 28° / 30°"].ours == "never / 3.0 / 3.0 s"


def test_a_part_that_was_not_measured_has_no_row() -> None:
    assert headline_rows(Results.model_validate({"quick": False})) == []


def test_a_readme_without_its_markers_is_refused() -> None:
    with pytest.raises(ValueError, match="once each, in this order"):
        with_table(f"{END} text {BEGIN}", {"figures": []})
