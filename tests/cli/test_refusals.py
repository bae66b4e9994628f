"""What the command line refuses, with its whole answer: each session of the transcripts ``refused_*.txt`` is played in a folder.

A line ``$ …`` is a command and the next line its answer; ``== NAME`` begins a file that holds the lines up to the next of either;
``~~ OLD => NEW`` writes ``own.toml``, the wheelchair's file with one piece replaced. ``TREADLINE_ACCEPT=1`` writes new answers.
"""

import json
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from chairs import changed_chair
from world import imu

from treadline.experiments.as_printed import paper_model
from treadline.io.mcap_log import RunLog
from treadline.scenario.shipped_files import CHAIRS, CONTROLLERS

from ..report.conftest import Transcript  # noqa: TID252 - pytest names the folders; outside of it they are no package
from .test_identify import write_log
from .test_see import write_frames

TRANSCRIPTS = [Transcript(path) for path in sorted(Path(__file__).parent.glob("refused_*.txt"))]
SESSIONS = [(transcript, title) for transcript in TRANSCRIPTS for title in transcript.sessions]


@pytest.fixture(scope="module")
def furnished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with what the transcript's commands are given: models, controllers, logs, a pair of images."""
    folder = tmp_path_factory.mktemp("furnished")
    paper_model(0.2).save(folder / "model.json")
    controller = json.loads((CONTROLLERS / "wheelchair.json").read_text(encoding="utf-8"))
    for name, change in (("033", 0.033), ("fast", "fast"), ("1-s", 1.0)):
        (folder / f"of-{name}.json").write_text(json.dumps(controller | {"period_s": change}))
    (folder / "digits.json").write_text('{"A": ' + "1" * 5000 + "}")
    (folder / "of-rescue.json").write_text(json.dumps(controller | {"vehicle": "rescue"}))
    (folder / "of-unstable.json").write_text(json.dumps(controller | {"K": [[-k for k in row] for row in controller["K"]]}))
    (folder / "controller.json").write_text(json.dumps(controller))
    write_log(folder / "log.csv")
    write_log(folder / "short.csv", rows=100)
    write_log(folder / "tiny.csv", rows=20)
    np.savez(folder / "other.npz", a=1.0)
    (folder / "latin.toml").write_bytes(b'[chair]\nmodel = "caf\xe9"\n')
    (folder / "frames").mkdir()
    write_frames(folder / "frames")
    for name, value, size, kind in (
        ("large", 1500, (480, 640), np.uint16),
        ("8-bit", 90, (240, 320), np.uint8),
        ("coloured", 90, (240, 320, 3), np.uint16),
        ("zero", 0, (240, 320), np.uint16),
        ("saturated", 65535, (240, 320), np.uint16),
        ("small_rgb", 90, (100, 100, 3), np.uint8),
    ):
        cv2.imwrite(str(folder / f"{name}.png"), np.full(size, value, kind))
    with RunLog(folder / "drive" / "log.mcap") as log:
        for k in range(50):
            log(imu(0.01 * k))
    (folder / "cut.mcap").write_bytes((folder / "drive" / "log.mcap").read_bytes()[:1000])
    return folder


def contents(folder: Path) -> dict[Path, bytes]:
    """Return the files of a folder, without the bytecode of what was imported."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file() and path.parent.name != "__pycache__"}


@pytest.mark.parametrize(("transcript", "title"), SESSIONS, ids=[title for _, title in SESSIONS])
def test_what_is_refused_is_one_line_and_leaves_nothing(
    run, furnished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, transcript: Transcript, title: str
) -> None:
    shutil.copytree(furnished, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    played = []
    for line in transcript.sessions[title]:
        if line.startswith("treadline: "):
            continue
        played.append(line)
        if line.startswith("$ "):
            before = contents(tmp_path)
            outcome = run(*shlex.split(line)[2:])
            assert (outcome.code, outcome.out) == (2, ""), line
            played += outcome.err.splitlines()
            assert contents(tmp_path) == before, line
        elif line.startswith("== "):
            path = Path(line.removeprefix("== "))
            path.parent.mkdir(exist_ok=True)
            path.write_text("", encoding="utf-8")
        elif line.startswith("~~ "):
            old, _, new = line.removeprefix("~~ ").replace("\\n", "\n").partition(" =>")
            changed_chair(tmp_path, old, new.removeprefix(" "))
        else:
            path.write_text(path.read_text(encoding="utf-8") + line + "\n", encoding="utf-8")
    transcript.check(title, played)


# What a transcript does not show


def test_tune_is_for_a_chair_of_ones_own_and_any_period_that_a_mission_keeps(run, tmp_path: Path) -> None:
    own, model, out = tmp_path / "own.toml", tmp_path / "model.json", tmp_path / "controller.json"
    own.write_text((CHAIRS / "wheelchair.toml").read_text().replace('name = "wheelchair"', 'name = "ours"'))
    replace(paper_model(0.2), dt_s=0.033).save(model)
    assert run("tune", model, "--vehicle", own, "--period", "0.03", "--out", out).code == 0
    assert json.loads(out.read_text())["vehicle"] == "ours"


def test_debug_shows_the_traceback(run, tmp_path: Path) -> None:
    outcome = run("check", tmp_path / "none.toml", "--debug")
    assert outcome.code == 2
    assert "Traceback" in outcome.err
