"""Ctrl-C and a request to end: exit code 130 or 143, one line, and what was finished is readable."""

import ctypes
import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import NamedTemporaryFile

import pytest

from treadline import cli
from treadline.cli import main
from treadline.core.ports import Truth
from treadline.core.processes import Terminated
from treadline.io.mcap_read import read_log

LONG = 'stair.steps = 400\nstart = {place = "flight", step = 6}\ndrive.duration_s = 200\nsensors.camera = "statistical"\n'
PATIENCE_S = 240.0
"""Time to start and to end on a machine that is busy with other work [s]."""


def interrupted(
    arguments: list[str], ready: Callable[[str], bool], *, after_s: float = 0.0, by: tuple[int, ...] = (signal.SIGINT,)
) -> subprocess.CompletedProcess[str]:
    """Start a command, wait until it is ready, as files or its stderr show, and send it signals."""
    with NamedTemporaryFile() as said:
        started = subprocess.Popen(
            [sys.executable, "-m", "treadline", *arguments],
            stdout=subprocess.PIPE,
            stderr=said,
            text=True,
            # A shell that runs the tests in the background has them ignore Ctrl-C; a person's shell does not.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509 - no threads are started here
        )
        limit = time.monotonic() + PATIENCE_S
        while not ready(Path(said.name).read_text()) and time.monotonic() < limit:
            time.sleep(0.05)
        time.sleep(after_s)
        for number in by:
            os.kill(started.pid, number)
            time.sleep(0.01)
        out, _ = started.communicate(timeout=PATIENCE_S)
        return subprocess.CompletedProcess(arguments, started.returncode, out, Path(said.name).read_text())


@pytest.mark.parametrize(
    ("by", "code", "said"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "asked to end")], ids=["INT", "TERM"]
)
def test_an_ended_climb_leaves_a_readable_log_and_its_manifest(tmp_path: Path, by: int, code: int, said: str) -> None:
    scenario, out = tmp_path / "long.toml", tmp_path / "run"
    scenario.write_text(LONG)
    out.mkdir()
    for name in ("manifest.json", "result.json", "series.csv", "report.html", "notes.txt"):
        (out / name).write_text("{}")  # of an earlier run, and a file of somebody else's
    done = interrupted(["climb", str(scenario), "--out", str(out), "--force"], lambda said: "10 s of 200 s" in said, by=(by,))
    assert done.returncode == code, done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert done.stderr.splitlines()[-1].startswith(f"treadline: {said}")
    assert json.loads((out / "manifest.json").read_text())["seed"] == 0
    assert any(isinstance(signal_, Truth) for signal_ in read_log(out / "log.mcap"))
    assert sorted(path.name for path in out.iterdir()) == ["log.mcap", "manifest.json", "notes.txt", "run-controller.json"]


def test_many_interrupts_while_it_is_still_loading_are_one_line() -> None:
    done = interrupted(["check", "paper-28"], lambda _: True, after_s=0.12, by=(signal.SIGINT,) * 3)
    assert done.returncode == 130, done.stderr
    assert (done.stdout, len(done.stderr.splitlines())) == ("", 1)


def test_an_interrupt_that_falls_into_source_text_is_as_any(tmp_path: Path) -> None:
    """Test: Ctrl-C while a library runs text of its own, as a dataclass does. Expected result: exit code 130, as ever."""
    script = """
    import sys, treadline.__main__, treadline.cli
    treadline.cli.main = lambda: exec("raise KeyboardInterrupt")
    sys.exit(treadline.__main__.main())
    """
    (tmp_path / "struck.py").write_text(textwrap.dedent(script))
    done = subprocess.run([sys.executable, "-m", "struck"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "treadline: interrupted\n")


@pytest.mark.parametrize("wrapped", [1, 7])
@pytest.mark.parametrize(("by", "code"), [(KeyboardInterrupt, 130), (Terminated, 143)])
def test_an_interrupt_in_the_moment_compiled_code_is_dispatched_is_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], by: type[KeyboardInterrupt], code: int, wrapped: int
) -> None:
    """Test: compiled code turns it into an error of its own, and once more for each value returned. Expected result: as any."""

    def dispatched(*_: object, **__: object) -> None:
        error: BaseException = by()
        for _each in range(wrapped):
            outer = SystemError("returned a result with an exception set")
            outer.__cause__ = error
            error = outer
        raise error

    monkeypatch.setattr(cli, "app", type("App", (), {"meta": cli.app.meta, "__call__": dispatched})())
    assert main(["doctor"]) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("what was finished by then, if anything, is readable")  # a folder need not have been made yet


def test_an_interrupt_that_a_callback_swallows_comes_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Test: Ctrl-C falls into a callback from compiled code, which cannot raise. Expected result: it is raised a moment later."""
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # workers of a test run may ignore Ctrl-C
    assert main(["--version"]) == 0

    @ctypes.CFUNCTYPE(None)
    def callback() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):  # noqa: PT012 - it comes while something else is done
        callback()
        for _ in range(500):
            time.sleep(0.01)
    signal.signal(signal.SIGINT, before)


def test_an_interrupted_reproduction_ends_its_workers_and_says_one_line(tmp_path: Path) -> None:
    out = tmp_path / "paper"
    done = interrupted(["reproduce", "--quick", "--workers", "2", "--out", str(out)], lambda _: (out / "runs").exists())
    assert done.returncode == 130, done.stderr
    assert "Traceback" not in done.stderr
    assert not (out / "results.json").exists()
