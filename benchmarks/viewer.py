"""Time until the first picture of ``treadline view``, and updates of the scene that a browser draws per second.

Run: ``python benchmarks/viewer.py [--runs N] [--seconds S]`` (about three minutes). It needs Chromium with its driver, and
selenium (``pip install 'treadline[browser]'``). Chromium draws WebGL in software here, so that its share of the processor is
part of each figure; a machine with a graphics card shows more frames. Each figure is the median of the runs.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from tables import table

from treadline.run.recorded_run import recorded_run
from treadline.run.resolve import resolve
from treadline.scenario.scenario import DriveSettings, Scenario, Sensors, Stair, Start

HEADLESS = ("--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader", "--disable-background-networking", "--no-first-run")
"""Flags of a browser on a machine without display and graphics card, as in ``docs/tools/climb_picture.py``."""
LIVE = "up-28"
"""Scenario of the live run: a traversal with rendered images, detector and fusion."""
REPLAY_S = 300.0
REPLAY = Scenario(
    stair=Stair(steps=120),
    start=Start(place="flight", step=4, heading_deg=6.0),
    drive=DriveSettings(speed_m_s=0.1, duration_s=REPLAY_S, check=False),
    sensors=Sensors(camera="statistical"),
)
"""Recorded run: 300 s at 0.1 m/s on one flight, with every signal of a log and without images."""
WINDOW = (1440, 900)
SETTLING_S = 4.0
"""Time from the first picture to the measurement of the updates [s]: the compiled code of the simulation is loaded."""
PATIENCE_S = 120.0
"""Longest wait for the first picture [s]."""
COLOURS_MIN = 40
"""Number of colours, of 4096, from which a picture shows chair and stair: an empty scene has one, a stair alone about ten."""
PROBE = """
(() => {
  const probe = document.createElement("canvas");
  [probe.width, probe.height] = [96, 60];
  const context = probe.getContext("2d", { willReadFrequently: true });
  const found = (window.treadlineProbe = { first_ms: null, drawn: 0 });
  let calls = 0;
  for (const name of ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced"]) {
    const draw = WebGL2RenderingContext.prototype[name];
    WebGL2RenderingContext.prototype[name] = function (...rest) { calls += 1; return draw.apply(this, rest); };
  }
  function colours() {
    const scene = [...document.querySelectorAll("canvas")].sort((a, b) => b.width * b.height - a.width * a.height)[0];
    context.drawImage(scene, 0.28 * scene.width, 0.22 * scene.height, 0.43 * scene.width, 0.6 * scene.height, 0, 0, 96, 60);
    const pixels = context.getImageData(0, 0, 96, 60).data;
    const seen = new Set();
    for (let k = 0; k < pixels.length; k += 4) seen.add((pixels[k] >> 4 << 8) | (pixels[k + 1] >> 4 << 4) | (pixels[k + 2] >> 4));
    return seen.size;
  }
  const request = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = (draw) => request((now) => {
    const before = calls;
    draw(now);
    if (calls === before) return;
    found.drawn += 1;
    if (found.first_ms === null && colours() > COLOURS_MIN) found.first_ms = performance.timeOrigin + performance.now();
  });
})();
""".replace("COLOURS_MIN", str(COLOURS_MIN))
"""Script in the page: the time at which the middle of the scene first has many colours, and the number of animation frames that
drew. The picture is read back in the frame that drew it, until the first that passes."""


@contextmanager
def browser() -> Iterator[Any]:
    """Start Chromium with the probe in every page."""
    chromium, driver_path = shutil.which("chromium"), shutil.which("chromedriver")
    if chromium is None or driver_path is None:
        raise SystemExit("viewer.py: Chromium or its driver is not installed; apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    with tempfile.TemporaryDirectory() as profile:
        for option in (*HEADLESS, f"--window-size={WINDOW[0]},{WINDOW[1]}", f"--user-data-dir={profile}"):
            options.add_argument(option)
        options.set_capability("goog:loggingPrefs", {"performance": "ALL"})
        driver = webdriver.Chrome(options=options, service=Service(driver_path))
        try:
            driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": PROBE})
            yield driver
        finally:
            driver.quit()


def page_time_s(driver: Any) -> float:
    """Return the time under the cursor, as the page shows it."""
    found = re.search(r"([\d.]+) s of [\d.]+ s", str(driver.execute_script("return document.body.innerText")))
    return float(found.group(1)) if found else 0.0


def updates_sent(driver: Any) -> int:
    """Return the number of WebSocket messages that the page has received since the last call."""
    messages = (json.loads(entry["message"])["message"]["method"] for entry in driver.get_log("performance"))
    return sum(method == "Network.webSocketFrameReceived" for method in messages)


def drawn(driver: Any) -> int:
    return int(driver.execute_script("return window.treadlineProbe.drawn"))


def measure(target: str, seconds: float, *, plays: bool) -> list[float]:
    """Return the figures of one run, in the order of ``ROWS``; the browser is started before the command.

    Args:
        target: Scenario or run folder.
        seconds: Time over which updates are counted [s].
        plays: Whether the play button is pressed first.
    """
    command = [sys.executable, "-m", "treadline", "view", target, "--port", "0", "--no-browser"]
    with browser() as driver:
        began = time.time()
        with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
            try:
                url = next(found.group(1) for line in process.stderr or () if (found := re.search(r"view: (http://\S+)", line)))
                address_s = time.time() - began
                driver.get(url)
                while (first_ms := driver.execute_script("return window.treadlineProbe.first_ms")) is None:
                    if time.time() - began > PATIENCE_S:
                        raise SystemExit(f"viewer.py: no picture of {target} after {PATIENCE_S:.0f} s")
                    time.sleep(0.05)
                if plays:
                    driver.execute_script(
                        "[...document.querySelectorAll('button')].find(b => b.innerText.trim() == 'play').click()"
                    )
                time.sleep(SETTLING_S)
                updates_sent(driver)
                before, from_s, since = drawn(driver), page_time_s(driver), time.monotonic()
                time.sleep(seconds)
                after, to_s, passed_s = drawn(driver), page_time_s(driver), time.monotonic() - since
                sent = updates_sent(driver)
            finally:
                process.terminate()
    return [
        address_s,
        1e-3 * first_ms - began,
        (after - before) / passed_s,
        sent / passed_s,
        (to_s - from_s) / passed_s,
    ]


ROWS = ("address [s]", "first picture [s]", "drawn by the browser [1/s]", "messages to the page [1/s]", "shown time / time")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5, help="repetitions of each measurement")
    parser.add_argument("--seconds", type=float, default=10.0, help="time over which updates are counted")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        recorded_run(run, resolve(REPLAY, None, 0))
        targets = {f"live {LIVE}": (LIVE, False), f"replay of {REPLAY_S:.0f} s": (str(run), True)}
        found: dict[str, list[list[float]]] = {name: [] for name in targets}
        for _ in range(arguments.runs):
            for name, (target, plays) in targets.items():
                found[name].append(measure(target, arguments.seconds, plays=plays))
    cores, load = len(os.sched_getaffinity(0)), os.getloadavg()[0]
    title = (
        f"treadline view, page of {WINDOW[0]}×{WINDOW[1]} px, {cores} cores, load {load:.1f} at the end: median of {arguments.runs}"
    )
    for name, runs in found.items():
        columns = list(zip(*runs, strict=True))
        rows = [(row, float(median(column)), min(column), max(column)) for row, column in zip(ROWS, columns, strict=True)]
        table(f"{title}: {name}", ("", "median", "least", "most"), rows)


if __name__ == "__main__":
    main()
