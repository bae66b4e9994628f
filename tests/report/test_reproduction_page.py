"""The page of a reproduction: offline, escaped, the same bytes; a folder that is not whole is refused in one line."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from treadline.core.errors import SettingsError
from treadline.core.printing import p_text
from treadline.report import write_report
from treadline.report._html import ratio

from .conftest import reproduced, write_log, write_reproduction

Tables = dict[str, Any]
MakeFolder = Callable[..., Path]
HOSTILE = '<script>alert("x")</script><img src=http://example.org/x onerror=alert(1)>{{ 7*7 }}'


def page_of(folder: Path) -> str:
    return write_report(folder).read_text(encoding="utf-8")


def refused(folder: Path) -> str:
    """Return the message of the refusal, which is one line and leaves no page."""
    with pytest.raises(SettingsError) as caught:
        write_report(folder)
    assert not (folder / "report.html").exists()
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a whole reproduction with its page."""
    folder = write_reproduction(tmp_path_factory.mktemp("whole") / "reproduce", reproduced())
    write_report(folder)
    return folder


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    return (folder / "report.html").read_text(encoding="utf-8")


def test_the_page_asks_for_nothing_and_runs_nothing(page: str) -> None:
    assert not re.search(r"https?:|<script|\son\w+=", page.lower())
    assert "default-src 'none'" in page
    assert all(target.startswith("#") for target in re.findall(r'(?:href|src)="([^"]*)"', page))


def test_every_figure_is_on_the_page_and_a_file_of_its_own(folder: Path, page: str) -> None:
    panels = {"fig08": 4, "singular-values": 1, "fig09": 2, "fig10": 4, "margins": 2, "table2": 2, "fig11": 2}
    assert page.count("<svg") == sum(panels.values())
    assert {path.stem for path in (folder / "figures").glob("*.svg")} == set(panels)


def test_every_reference_inside_a_figure_finds_its_one_definition(page: str) -> None:
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    used = {a or b for a, b in re.findall(r'url\(#([^)]+)\)|href="#([^"]+)"', page)}
    assert used
    assert used <= set(ids)


def test_the_same_folder_gives_the_same_bytes(results: Tables, reproduce_folder: MakeFolder, page: str) -> None:
    assert page_of(reproduce_folder(results)) == page


def test_a_p_value_is_never_printed_as_zero_and_a_ratio_to_a_rounding_error_is_a_bound() -> None:
    shown = {None: "–", 1.2e-21: "p < 0.001", 0.0: "p < 0.001", 0.292: "p = 0.29", 1.0: "p = 1"}
    assert {value: p_text(value) for value in shown} == shown
    assert [ratio(value) for value in (112.78, 7.2e15)] == ["112.8", "> 100000"]


def test_a_run_with_a_log_is_shown_and_plays_on_its_page(results: Tables, reproduce_folder: MakeFolder, run_folder: Path) -> None:
    """Test: one of the linked runs kept a log with poses. Expected: its side view as a link, and a page with its scene."""
    folder = reproduce_folder(results)
    run = folder / "runs" / "seat-28"
    for name in ("manifest.json", "result.json"):
        (run / name).write_bytes((run_folder / name).read_bytes())
    write_log(run)
    page = page_of(folder)
    assert '<a href="runs/seat-28/report.html"><svg class="side-shapes"' in page
    assert "▶ seat at 28°</a>: held, 1 s" in page
    assert '"scene":{"parts":' in (run / "report.html").read_text(encoding="utf-8")
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids))


def test_hostile_text_is_shown_and_does_nothing(results: Tables, reproduce_folder: MakeFolder) -> None:
    results["command"] = results["git_commit"] = HOSTILE
    results["versions"] = {HOSTILE: HOSTILE}
    results["fig05"]["reason"] = results["fig05"]["conditions"] = HOSTILE
    results["fig08"]["conditions"] = results["fig11"]["conditions"] = HOSTILE
    results["fig08"]["slopes"][0]["warnings"] = [HOSTILE]
    results["table1"][0] = dict.fromkeys(("parameter", "paper", "ours"), HOSTILE)
    results["literal"]["runs"][0]["verdict"] = results["literal"]["runs"][0]["cause"] = HOSTILE
    results["fig09"][0]["verdict"] = HOSTILE
    for row in results["table2"]:
        row["conditions"] = row["paper_label"] = HOSTILE
        row["verdicts"] = [HOSTILE]
    page = page_of(reproduce_folder(results))
    assert "<script" not in page
    assert "<img" not in page
    assert "{{ 7*7 }}" in page
    assert page.count("&lt;script&gt;") >= 15


def test_a_part_that_was_not_run_is_absent(results: Tables, reproduce_folder: MakeFolder) -> None:
    few = "Fewer items, each at its full length"
    assert re.findall(rf"<svg|id=\"(?:fig|table)|{few}", page_of(reproduce_folder({"quick": True}))) == [few]
    folder = reproduce_folder(results | {"fig09": []}, "without")
    (folder / "runs" / "turn-28-plus30-seed0").rename(folder / "away")
    page = page_of(folder)
    assert ("Fig. 9" in page, 'id="fig10"' in page, "Missing, and not drawn: turn at 28°, from +30°, seed 0" in page) == (0, 1, 1)


def test_the_answer_comes_first_and_items_follow_in_the_papers_order(page: str) -> None:
    answer = page.index("Reproduced: ")
    sections = [
        page.index(f'id="{name}"')
        for name in ("fig05", "fig08", "literal", "table1", "fig09", "fig10", "table2", "fig11", "beyond")
    ]
    assert [answer, *sections] == sorted([answer, *sections])


def test_both_readings_of_table_2_stand_beside_the_print(results: Tables, reproduce_folder: MakeFolder) -> None:
    results["table2"][0] |= {"paper_deg": 2.83, "rms_heading_deg": 2.09, "steady_rms_heading_deg": 0.03}
    row = re.search(r"<tr><td>25°.*?</tr>", page_of(reproduce_folder(results)).partition('id="table2"')[2])
    assert row is not None
    assert re.findall(r"([\d.]+)°</td>", row[0].partition("+30")[2])[:1] == ["2.83"]
    assert "2.09°" in row[0]
    assert "0.03°" in row[0]


def test_slopes_and_ends_are_said(results: Tables, reproduce_folder: MakeFolder) -> None:
    for rows in (results["table2"], results["fig09"], results["fig10"], results["fig08"]["slopes"]):
        for row in rows:
            row["slope_deg"] = 22.5  # the paper does not have it
    results["table2"][0] |= {"paper_deg": None, "averaged": 4, "ended_early": ["seed 2 fell after 1.7 s"], "rms_heading_deg": None}
    page = page_of(reproduce_folder(results))
    assert "22.5°" in page
    assert "mean of 4 of 5 runs, ended early: seed 2 fell after 1.7 s" in page


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


def test_the_stages_of_figure_5_are_embedded(results: Tables, reproduce_folder: MakeFolder) -> None:
    folder = reproduce_folder(results)
    (folder / "figures").mkdir()
    (folder / "figures" / "fig05-2.png").write_bytes(b"\x89PNG\r\n\x1a\nrest")
    page = page_of(folder)
    assert page.count('<img src="data:image/png;base64,') == 1
    assert "(b) Canny edges" in page


def test_a_stage_that_is_no_picture_is_refused(results: Tables, reproduce_folder: MakeFolder, run_folder: Path) -> None:
    folder = reproduce_folder(results)
    (folder / "figures").mkdir()
    (folder / "figures" / "fig05-1.png").symlink_to(run_folder / "manifest.json")
    assert "fig05-1.png: not a PNG picture" in refused(folder)


def test_a_folder_without_results_is_refused(tmp_path: Path) -> None:
    assert "give a folder that reproduce, climb or excite finished" in refused(tmp_path)


def test_a_run_that_no_figure_names_has_a_page_that_plays_it_and_a_damaged_one_has_none(
    results: Tables, reproduce_folder: MakeFolder, run_folder: Path
) -> None:
    """Test: two further runs with a log, one of them cut. Expected result: a page and a link for the whole one alone."""
    folder = reproduce_folder(results)
    for name in ("turn-30-minus30-seed4", "turn-cut"):
        run = folder / "runs" / name
        run.mkdir()
        for file in ("manifest.json", "result.json"):
            (run / file).write_bytes((run_folder / file).read_bytes())
        write_log(run)
    cut = folder / "runs" / "turn-cut" / "log.mcap"
    cut.write_bytes(cut.read_bytes()[:-100])
    page = page_of(folder)
    assert '<a href="runs/turn-30-minus30-seed4/report.html">turn at 30°, from −30°, seed 4</a>' in page
    assert '"scene":{"parts":' in (folder / "runs" / "turn-30-minus30-seed4" / "report.html").read_text(encoding="utf-8")
    assert "turn-cut" not in page
