"""``treadline export``: files that say what they are, and one line for what cannot be exported."""

from pathlib import Path

import pytest

from treadline.scenario.shipped_files import CONTROLLERS

CONTROLLER = CONTROLLERS / "wheelchair.json"


@pytest.mark.parametrize(
    ("target", "files"),
    [
        ("c", ["heading_controller.c", "heading_controller.h", "heading_log.h", "heading_numbers.h", "heading_selftest.c"]),
        ("json", ["heading_controller.json"]),
    ],
)
def test_export_writes_the_files_of_its_target(run, tmp_path: Path, target: str, files: list[str]) -> None:
    out = tmp_path / "exported"
    outcome = run("export", CONTROLLER, "--to", target, "--out", out, "--json")
    assert outcome.code == 0, outcome.err
    assert (outcome.values["path"], outcome.values["files"]) == (str(out), files)
    assert sorted(path.name for path in out.iterdir()) == files


def test_layouts_are_written_without_a_source(run, tmp_path: Path) -> None:
    outcome = run("export", "--to", "layouts", "--out", tmp_path / "layouts", "--json")
    assert outcome.code == 0, outcome.err
    assert outcome.values["files"] == ["foxglove.json", "plotjuggler.xml", "rviz2.rviz"]
    assert sorted(path.name for path in (tmp_path / "layouts").iterdir()) == outcome.values["files"]
