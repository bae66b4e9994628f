"""A long command writes a line within two seconds; ``--help`` is grouped; shell completion can be installed."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from treadline.cli import VERBS, main
from treadline.cli._output import start_line


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--debug", "climb", "paper-28"], "treadline climb: running; Ctrl-C stops it\n"),
        (["view", "runs/a", "--export", "run.html"], "treadline view: writing run.html; Ctrl-C stops it\n"),
        (["view", "runs/a", "--export=run.html"], "treadline view: writing run.html; Ctrl-C stops it\n"),
    ],
)
def test_a_long_command_is_announced_once_with_the_file_that_it_writes(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with start_line(words, after_s=0.05):
        deadline_s = time.monotonic() + 10.0  # a busy machine schedules the timer late
        error = ""
        while not error and time.monotonic() < deadline_s:
            time.sleep(0.01)
            error += capsys.readouterr().err
    assert error == said
    assert capsys.readouterr().err == ""


def test_a_short_command_is_not_announced(capsys: pytest.CaptureFixture[str]) -> None:
    with start_line(["doctor"], after_s=30.0):
        pass
    assert capsys.readouterr().err == ""


def test_help_lists_every_command_under_its_heading(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    places = [text.index(f" {heading} ") for heading in VERBS]
    assert places == sorted(places)
    for place, end, verbs in zip(places, [*places[1:], len(text)], VERBS.values(), strict=True):
        for verb in verbs:
            assert text[place:end].partition(f"│ {verb} ")[2].lstrip()[0] != "│", f"{verb} has no line of help"


@pytest.mark.skipif(sys.platform == "win32", reason="completion is for bash, zsh and fish")
def test_completion_is_installed_for_bash(tmp_path: Path) -> None:
    environment = os.environ | {"HOME": str(tmp_path), "SHELL": "/bin/bash"}
    command = [sys.executable, "-m", "treadline", "--install-completion", "--shell", "bash"]
    subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    scripts = [path for path in tmp_path.rglob("*treadline*") if path.is_file()]
    assert len(scripts) == 1
    assert "climb" in scripts[0].read_text()
