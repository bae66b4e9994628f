"""A real browser and the page of ``treadline view``. ``make test-browser`` runs these tests; elsewhere they are skipped."""

import json
import os
import queue
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from web_page import CHROMIUM, DRIVER, Page, drivers

COMPILING_S = 300.0
"""Longest wait for the start of a simulation [s]: on an empty cache its kernels are compiled first."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    reason = None
    if os.environ.get("TREADLINE_TEST_BROWSER") != "1":
        reason = "run make test-browser"
    elif CHROMIUM is None or DRIVER is None:
        reason = "Chromium or its driver is not installed; make test-browser installs them where root may"
    for item in items:
        if reason is not None and item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.skip(reason=reason))


UNCOVERED = """b => {
  b.scrollIntoView({ block: "nearest" });
  const { x, y, width, height } = b.getBoundingClientRect();
  return b.contains(document.elementFromPoint(x + width / 2, y + height / 2));
}"""
"""Whether a click on the middle of an element reaches it."""


class ViewerPage(Page):
    """Page of ``treadline view``."""

    def until_it_runs(self) -> None:
        """Wait for the simulation of a live run."""
        self.until(lambda: self.t_s > 0.5, "a running simulation", COMPILING_S)

    @property
    def t_s(self) -> float:
        """Time under the cursor, as the page shows it."""
        return float(self.sees(r"([\d.]+) s of [\d.]+ s").group(1))

    def element(self, script: str, what: str) -> Any:
        """Wait for the element that a script finds."""
        return self.until(lambda: self.run(f"return {script}"), what)

    def click(self, label: str) -> None:
        """Click the button with a label, once nothing that opens or closes covers it."""
        buttons = "[...document.querySelectorAll('button, [role=tab]')]"
        found = f"{buttons}.filter(b => b.innerText.trim() === {json.dumps(label)}).find({UNCOVERED})"
        self.element(found, f"the button {label!r}").click()

    def field(self, label: str) -> Any:
        """Return the list or the check box with a label."""
        labels = "[...document.querySelectorAll('label')]"
        found = f"{labels}.filter(l => l.innerText.trim() === {json.dumps(label)}).map(l => document.getElementById(l.htmlFor))[0]"
        return self.element(found, f"the field {label!r}")

    def choose(self, label: str, option: str) -> None:
        """Choose an option of the list with a label."""
        self.field(label).click()
        options = "[...document.querySelectorAll('[role=option]')]"
        self.element(f"{options}.find(o => o.innerText.trim() === {json.dumps(option)})", f"the option {option!r}").click()

    def tick(self, label: str) -> None:
        """Change the check box with a label."""
        self.run("arguments[0].click()", self.field(label))

    def kill(self) -> None:
        """Kill the browser without a word; the page cannot say goodbye."""
        driver = self.driver.service.process.pid
        for children in Path(f"/proc/{driver}/task").glob("*/children"):
            for browser in children.read_text().split():
                os.kill(int(browser), signal.SIGKILL)


@pytest.fixture(scope="session")
def make_page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[], ViewerPage]]:
    with drivers(tmp_path_factory, "--disable-quic", "--window-size=1440,900") as make:
        yield lambda: ViewerPage(make())


@pytest.fixture(scope="session")
def page(make_page: Callable[[], ViewerPage]) -> ViewerPage:
    return make_page()


@contextmanager
def served(*arguments: str, verb: str = "view") -> Iterator[str]:
    """Run ``treadline view``, or another command that serves, and yield the address that it prints."""
    command = [sys.executable, "-m", "treadline", verb, *arguments, "--port", "0", "--no-browser"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        lines: queue.Queue[str] = queue.Queue()
        reader = threading.Thread(target=lambda: [lines.put(line) for line in process.stderr or ()], daemon=True)
        reader.start()
        try:
            while not (found := re.search(rf"{verb}: (http://\S+)", lines.get(timeout=60.0))):
                pass
            yield found.group(1)
        finally:
            process.terminate()
            process.wait(20.0)
            reader.join(5.0)


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recorded seconds on the flight."""
    from treadline.run.recorded_run import recorded_run
    from treadline.run.resolve import resolve
    from treadline.scenario.scenario import DriveSettings, Scenario, Sensors, Start

    folder = tmp_path_factory.mktemp("run") / "short"
    scenario = Scenario(
        start=Start(place="flight", step=4, heading_deg=6.0),
        drive=DriveSettings(duration_s=2.0, check=False),
        sensors=Sensors(camera="statistical"),
    )
    recorded_run(folder, resolve(scenario, None, 1))
    return folder


@pytest.fixture(scope="session")
def recorded(run_folder: Path) -> Iterator[str]:
    with served(str(run_folder)) as url:
        yield url


@pytest.fixture(scope="session")
def replay(page: ViewerPage, recorded: str) -> ViewerPage:
    """Page of the recorded run, loaded once."""
    page.requests()
    page.driver.get(recorded)
    page.sees(r"of 2\.0 s · time_up")
    return page


@pytest.fixture
def demo() -> Iterator[str]:
    """Address of the demonstration."""
    with served(verb="demo") as url:
        yield url


LONG = "[start]\nplace = 'flight'\nstep = 4\nheading_deg = 6.0\n[drive]\nduration_s = 300.0\ncheck = false\n[stair]\nsteps = 80\n"


@pytest.fixture
def live(tmp_path: Path) -> Iterator[str]:
    """Live run that may be commanded, with the camera's images."""
    scenario = tmp_path / "live.toml"
    scenario.write_text(LONG)
    with served(str(scenario), "--control") as url:
        yield url


@pytest.fixture
def by_hand(tmp_path: Path) -> Iterator[str]:
    """Live run that may be commanded, without images: the processor is left to the page, which reports the handset."""
    scenario = tmp_path / "by_hand.toml"
    scenario.write_text(f"{LONG}[sensors]\ncamera = 'statistical'\n")
    with served(str(scenario), "--control") as url:
        yield url
