"""``treadline view``: bad input is one line with a remedy, and the viewer ends by itself on request."""

import contextlib
import re
import socket
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from treadline.run.recorded_run import recorded_run
from treadline.run.resolve import resolve
from treadline.scenario.scenario import DriveSettings, Scenario, Sensors, Start

from .conftest import Outcome, assert_refused


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run folder of half a second on the flight."""
    folder = tmp_path_factory.mktemp("view") / "run"
    scenario = Scenario(
        start=Start(place="flight"), drive=DriveSettings(duration_s=0.5, check=False), sensors=Sensors(camera="statistical")
    )
    recorded_run(folder, resolve(scenario, None, 0))
    return folder


def last_line(outcome: Outcome) -> Outcome:
    """Return the outcome with what the viewer writes before its end left out."""
    return replace(outcome, err=outcome.err.splitlines()[-1] + "\n")


def view(run: Any, *arguments: object) -> Any:
    return run("view", *arguments, "--port", "0", "--no-browser", "--seconds", "0.2")


def test_a_recorded_run_is_served_for_the_given_time(run: Any, folder: Path) -> None:
    outcome = view(run, folder, "--json")
    assert outcome.code == 0, outcome.err
    assert (outcome.values["verdict"], outcome.values["t_s"]) == ("time_up", pytest.approx(0.5))
    assert outcome.values["url"] in outcome.err
    assert "may only view" in outcome.err


def test_an_address_for_others_says_what_it_exposes(run: Any, folder: Path) -> None:
    outcome = view(run, folder, "--host", "0.0.0.0")  # noqa: S104 - what is tested
    assert (outcome.code, "every machine that reaches it" in outcome.err, "unencrypted" in outcome.err) == (0, True, True)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a screen is always there")
@pytest.mark.parametrize("over_ssh", [False, True])
def test_no_browser_of_text_takes_the_terminal(run: Any, folder: Path, monkeypatch: pytest.MonkeyPatch, over_ssh: bool) -> None:
    """Test: no display, and a session over SSH. Expected: no browser is started, and the page is served for a tunnel."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER", "SSH_CONNECTION"):
        monkeypatch.delenv(name, raising=False)
    if over_ssh:
        monkeypatch.setenv("SSH_CONNECTION", "192.0.2.1 50000 192.0.2.2 22")
        monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("webbrowser.open", lambda _: pytest.fail("a browser was started"))
    outcome = run("view", folder, "--port", "0", "--seconds", "0.2")
    assert outcome.code == 0, outcome.err
    port = re.search(r"view: http://127\.0\.0\.1:(\d+)/", outcome.err).group(1)
    assert f"ssh -L {port}:127.0.0.1:{port} " in outcome.err


def test_a_second_viewer_takes_the_next_default_port_and_says_so(run: Any, folder: Path) -> None:
    with socket.socket() as taken:
        with contextlib.suppress(OSError):  # a port that another program holds is as good
            taken.bind(("127.0.0.1", 8350))
            taken.listen()
        outcome = run("view", folder, "--no-browser", "--seconds", "0.2")
    assert outcome.code == 0, outcome.err
    said = re.search(r"view: port 8350 is in use; takes (\d+)", outcome.err)
    assert f"view: http://127.0.0.1:{said.group(1)}/" in outcome.err


def test_an_export_keeps_what_is_there_and_takes_recorded_runs_only(run: Any, folder: Path, tmp_path: Path) -> None:
    page = tmp_path / "run.html"
    page.write_text("mine")
    assert_refused(run("view", folder, "--export", page), "run.html", "--force")
    assert_refused(run("view", "up-28", "--export", tmp_path / "new.html"), "is no recorded run")
    assert page.read_text() == "mine"
    assert run("view", folder, "--export", page, "--force").code == 0
    assert "<script" in page.read_text(encoding="utf-8")


def test_a_simulation_that_cannot_start_ends_the_viewer(run: Any, tmp_path: Path) -> None:
    """Test: a controller that is missing; only the worker finds out. Expected: its line, exit code 2."""
    outcome = run("view", "flight-20", "--controller", tmp_path / "none.json", "--port", "0", "--no-browser", "--seconds", "60")
    assert_refused(last_line(outcome), "none.json")
