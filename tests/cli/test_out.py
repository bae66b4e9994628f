"""One rule for --out: what is there is kept, unless --force is given."""

from pathlib import Path

import pytest

from treadline.cli._arguments import claim
from treadline.core.errors import SettingsError
from treadline.scenario.shipped_files import CONTROLLERS

FOLDERS = {
    "climb": ("up-28",),
    "excite": ("up-28",),
    "seat": ("paper-28",),
    "sweep": ("envelope", "--runs", "1"),
    "replay": ("no-such-log",),
    "reproduce": ("--quick",),
    "frames": ("--count", "1"),
    "export": (CONTROLLERS / "wheelchair.json", "--to", "c"),
    "see": ("folder",),
    "nodes": ("up-28",),
    "record": ("no-such-log",),
}
FILES = {
    "model": ("up-28", "--to", "urdf"),
    "identify": ("no-such-log.csv",),
    "tune": ("no-such-model.json",),
    "mount": ("no-such-log",),
}


@pytest.mark.parametrize("verb", FOLDERS)
def test_a_folder_that_holds_something_is_refused(run, verb: str, tmp_path: Path) -> None:
    out = tmp_path / "results"
    out.mkdir()
    (out / "result.json").write_text("mine")
    done = run(verb, *FOLDERS[verb], "--out", out)
    assert done.code == 2
    assert (
        done.err
        == f"treadline: --out {out}: the folder exists and is not empty; give another, or --force to overwrite its results\n"
    )
    assert [path.name for path in out.iterdir()] == ["result.json"]
    assert (out / "result.json").read_text() == "mine"


@pytest.mark.parametrize("verb", FILES)
def test_a_file_that_holds_something_is_refused(run, verb: str, tmp_path: Path) -> None:
    out = tmp_path / "result"
    out.write_text("mine")
    done = run(verb, *FILES[verb], "--out", out)
    assert (done.code, done.err) == (2, f"treadline: --out {out}: the file exists; give another, or --force to overwrite it\n")
    assert out.read_text() == "mine"


def test_force_writes_over_a_result_and_an_empty_folder_needs_no_force(run, tmp_path: Path) -> None:
    out = tmp_path / "chair.urdf"
    for options in ((), ("--force",)):
        assert run("model", "up-28", "--to", "urdf", "--out", out, *options).code == 0
    folder = tmp_path / "c"
    folder.mkdir()
    for options in ((), ("--force",)):
        assert run("export", CONTROLLERS / "wheelchair.json", "--to", "c", "--out", folder, *options).code == 0


def test_a_run_that_is_forced_leaves_nothing_of_the_earlier_one(run, tmp_path: Path) -> None:
    scenario, out = tmp_path / "short.toml", tmp_path / "run"
    scenario.write_text('[drive]\nduration_s = 0.2\n[sensors]\ncamera = "statistical"\n')
    assert run("climb", scenario, "--out", out).code == 0
    (out / "report.html").write_text("of the earlier run")
    assert run("climb", scenario, "--out", out).code == 2
    assert run("climb", scenario, "--out", out, "--force").code == 0
    assert not (out / "report.html").exists()


def test_a_sweep_is_resumed_or_replaced_but_not_both(run, tmp_path: Path) -> None:
    done = run("sweep", "envelope", "--runs", 1, "--out", tmp_path / "new", "--resume", "--force")
    assert (done.code, "not both" in done.err) == (2, True)


def test_a_film_that_exists_is_named_with_its_option(run, tmp_path: Path) -> None:
    film = tmp_path / "film.webp"
    film.write_bytes(b"of an earlier run")
    done = run("climb", "paper-28", "--plant", "gazebo", "--out", tmp_path / "run", "--picture", film)
    assert (done.code, done.err) == (2, f"treadline: --picture {film}: the file exists; give another, or --force to overwrite it\n")


def test_a_path_of_the_other_kind_is_refused_even_with_force(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(SettingsError, match="is a file; give a folder"):
        claim(file, force=True)
    with pytest.raises(SettingsError, match="is a folder; give a file"):
        claim(tmp_path, force=True, kind="file")
