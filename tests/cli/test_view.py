"""``treadline view``: bad input is one line with a remedy, and the viewer ends by itself on request."""

import contextlib
import json
import re
import socket
import sys
import webbrowser
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
    values = json.loads(outcome.out)
    assert values["verdict"] == "time_up"
    assert values["t_s"] == pytest.approx(0.5)
    assert values["url"] in outcome.err
    assert "may only view" in outcome.err


def test_an_address_for_others_says_what_it_exposes(run: Any, folder: Path) -> None:
    outcome = view(run, folder, "--host", "0.0.0.0")  # noqa: S104 - what is tested
    assert outcome.code == 0, outcome.err
    assert "every machine that reaches it" in outcome.err
    assert "unencrypted" in outcome.err


def test_a_port_in_use_is_refused(run: Any, folder: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        outcome = run("view", folder, "--port", taken.getsockname()[1], "--no-browser", "--seconds", "0.2")
    assert_refused(outcome, "--port", "give another --port")


def test_a_recording_cannot_be_controlled(run: Any, folder: Path) -> None:
    assert_refused(view(run, folder, "--control"), "--control", "is a recording")
    assert_refused(view(run, folder, "--set", "stair.steps=12"), "--set", "is a recording")


@pytest.mark.parametrize("opened", [False, webbrowser.Error("could not locate runnable browser")])
def test_without_a_browser_the_page_is_served_all_the_same(
    run: Any, folder: Path, monkeypatch: pytest.MonkeyPatch, opened: Any
) -> None:
    """Test: a machine without a browser. Expected: the page is served, with the address and how to reach it by an SSH tunnel."""

    def no_browser(_: str) -> bool:
        if opened:
            raise opened
        return False

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("webbrowser.open", no_browser)
    outcome = run("view", folder, "--port", "0", "--seconds", "0.2")
    assert outcome.code == 0, outcome.err
    port = re.search(r"view: http://127\.0\.0\.1:(\d+)/", outcome.err).group(1)
    assert "no browser found on this machine; open the address in a browser" in outcome.err
    assert f"ssh -L {port}:127.0.0.1:{port} " in outcome.err


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a screen is always there")
@pytest.mark.parametrize("over_ssh", [False, True])
def test_no_browser_of_text_takes_the_terminal(run: Any, folder: Path, monkeypatch: pytest.MonkeyPatch, over_ssh: bool) -> None:
    """Test: no display, and a session over SSH. Expected: no browser is started, and the page is served."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER", "SSH_CONNECTION"):
        monkeypatch.delenv(name, raising=False)
    if over_ssh:
        monkeypatch.setenv("SSH_CONNECTION", "192.0.2.1 50000 192.0.2.2 22")
        monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("webbrowser.open", lambda _: pytest.fail("a browser was started"))
    outcome = run("view", folder, "--port", "0", "--seconds", "0.2")
    assert outcome.code == 0, outcome.err
    assert "no browser found" in outcome.err


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
    assert_refused(run("view", folder, "--export", tmp_path), "is a folder")
    assert page.read_text() == "mine"


def test_an_export_says_what_it_writes_and_where(run: Any, folder: Path, tmp_path: Path) -> None:
    outcome = run("view", folder, "--export", tmp_path / "run.html")
    assert outcome.code == 0
    assert f"view: writes the page that plays {folder} to {tmp_path / 'run.html'}" in outcome.err


def test_a_simulation_that_cannot_start_ends_the_viewer(run: Any, tmp_path: Path) -> None:
    """Test: a controller that is missing; only the worker finds out. Expected: its line, exit code 2."""
    outcome = run("view", "flight-20", "--controller", tmp_path / "none.json", "--port", "0", "--no-browser", "--seconds", "60")
    assert_refused(last_line(outcome), "none.json")
