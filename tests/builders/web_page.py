"""Pages in headless Chromium: those of ``treadline view``, and those in a file."""

import json
import re
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from climb_picture import HEADLESS

CHROMIUM, DRIVER = shutil.which("chromium") or shutil.which("chromium-browser"), shutil.which("chromedriver")
PATIENCE_S = 40.0
"""Longest wait for anything on a page [s]: two loaded cores draw the scene in software."""


class Page:
    """Page in the browser."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def run(self, script: str, *arguments: Any) -> Any:
        """Return the value of a script; a promise is awaited."""
        return self.driver.execute_script(script, *arguments)

    def text(self) -> str:
        return str(self.run("return document.body ? document.body.innerText : ''"))

    def until(self, wanted: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> Any:
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            found = wanted()
            if found is not None and found is not False:
                return found
            time.sleep(0.1)
        raise AssertionError(f"waited {patience_s:.0f} s for {what}; the page says:\n{self.text()}")

    def sees(self, pattern: str, patience_s: float = PATIENCE_S) -> "re.Match[str]":
        return self.until(lambda: re.search(pattern, self.text()), pattern, patience_s)

    def resize(self, width_px: int, height_px: int) -> None:
        """Show the page as a window of this size, below 500 px as a phone."""
        size = {"width": width_px, "height": height_px, "deviceScaleFactor": 1, "mobile": width_px < 500}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)

    def errors(self) -> list[str]:
        return [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"]

    def requests(self) -> set[str]:
        """Addresses that the page has asked for since the last call, its WebSockets included."""
        asked = set()
        for entry in self.driver.get_log("performance"):
            message = json.loads(entry["message"])["message"]
            if message["method"] == "Network.requestWillBeSent":
                asked.add(message["params"]["request"]["url"])
            elif message["method"] == "Network.webSocketCreated":
                asked.add(message["params"]["url"])
        return asked


@contextmanager
def drivers(folders: pytest.TempPathFactory, *options: str) -> Iterator[Callable[[], Any]]:
    """Yield a function that opens a browser with a profile of its own, and returns its driver."""
    from selenium import webdriver

    opened = []

    def make() -> Any:
        chosen = webdriver.ChromeOptions()
        chosen.binary_location = CHROMIUM
        for option in (*HEADLESS, *options, f"--user-data-dir={folders.mktemp('profile')}"):
            chosen.add_argument(option)
        chosen.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        opened.append(webdriver.Chrome(options=chosen, service=webdriver.ChromeService(DRIVER)))
        return opened[-1]

    yield make
    for driver in opened:
        driver.quit()
