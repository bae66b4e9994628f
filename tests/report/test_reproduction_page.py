"""The page of a reproduction: the same bytes each time; a folder that is not whole is refused in one line."""

import json
from pathlib import Path
from typing import Any

import pytest

from treadline.core.errors import SettingsError
from treadline.core.printing import p_text
from treadline.report import write_report
from treadline.report.html_pages import ratio

from .conftest import MakeFolder, Tables, write_run
from .pages import with_pages


def refused(folder: Path) -> str:
    """Return the message of the refusal, which is one line and leaves no page."""
    with pytest.raises(SettingsError) as caught:
        write_report(folder)
    assert not (folder / "report.html").exists()
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_the_same_folder_gives_the_same_bytes_and_each_figure_is_a_file(results: Tables, reproduce_folder: MakeFolder) -> None:
    folder = reproduce_folder({name: results[name] for name in ("quick", "table2", "fig11")})
    drawn = []
    for _ in range(2):
        page = write_report(folder)
        drawn.append({path.stem: path.read_bytes() for path in (page, *(folder / "figures").glob("*.svg"))})
    assert drawn[0] == drawn[1]
    assert drawn[0].keys() == {"report", "table2", "fig11"}


def test_each_whole_run_has_a_page_that_plays_it_and_a_damaged_one_has_none(tmp_path: Path) -> None:
    with_pages(tmp_path)
    pages = {path.parent.name: path.read_text(encoding="utf-8") for path in tmp_path.glob("reproduce/runs/*/report.html")}
    assert pages.keys() == {"seat-28", "turn-30-minus30-seed4"}
    assert all('"scene":{"parts":' in page for page in pages.values())


def test_a_p_value_is_never_printed_as_zero_and_a_ratio_to_a_rounding_error_is_a_bound() -> None:
    shown = {None: "–", 1.2e-21: "p < 0.001", 0.0: "p < 0.001", 0.292: "p = 0.29", 1.0: "p = 1"}
    assert {value: p_text(value) for value in shown} == shown
    assert [ratio(value) for value in (112.78, 7.2e15)] == ["112.8", "> 100000"]


@pytest.mark.parametrize("name", ["../other", "/etc", ".hidden", "a\\b", "", "x" * 200, "turn\n"])
def test_a_run_that_is_not_a_bare_name_is_refused(results: Tables, reproduce_folder: MakeFolder, name: str) -> None:
    results["fig09"][0]["run"] = name
    assert "fig09.0.run" in refused(reproduce_folder(results))


def test_a_link_out_of_the_folder_is_refused(results: Tables, reproduce_folder: MakeFolder, run_folder: Path) -> None:
    folder = reproduce_folder(results)
    (folder / "runs" / "outside").symlink_to(run_folder, target_is_directory=True)
    results["fig11"]["run"] = "outside"
    (folder / "results.json").write_text(json.dumps(results), encoding="utf-8")
    assert "leads out of" in refused(folder)


@pytest.mark.parametrize(
    ("path", "value", "field"),
    [
        (("fig09", 0, "rms_heading_deg"), float("nan"), "not JSON that can be read: the number NaN"),
        (("table2", 1), {"slope_deg": 28}, "table2.1.start_heading_deg: Field required"),
    ],
)
def test_a_mistyped_field_is_named(
    results: Tables, reproduce_folder: MakeFolder, path: tuple[str | int, ...], value: object, field: str
) -> None:
    folder = reproduce_folder(results)
    inner: Any = results
    for step in path[:-1]:
        inner = inner[step]
    inner[path[-1]] = value
    (folder / "results.json").write_text(json.dumps(results), encoding="utf-8")
    assert f"results.json: {field}" in refused(folder)


def test_a_stage_that_is_no_picture_is_refused(results: Tables, reproduce_folder: MakeFolder, run_folder: Path) -> None:
    folder = reproduce_folder(results)
    (folder / "figures").mkdir()
    (folder / "figures" / "fig05-1.png").symlink_to(run_folder / "manifest.json")
    assert "fig05-1.png: not a PNG picture" in refused(folder)


def test_a_folder_without_results_and_an_interrupted_run_are_refused(tmp_path: Path) -> None:
    assert "give a folder that reproduce, climb or excite finished" in refused(tmp_path)
    run = write_run(tmp_path / "run")
    (run / "result.json").unlink()
    assert "this run was interrupted, or goes on" in refused(run)
    (run / "journal.jsonl").touch()
    assert "a sweep's folder; treadline sweep --resume finishes it" in refused(run)
