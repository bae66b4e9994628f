"""A small reproduce folder, made by hand: no simulator, every figure known."""

import base64
import io
import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from web_page import CHROMIUM, DRIVER, Page, drivers
from world import stair, truth

from treadline.core.angles import DEG
from treadline.core.ports import Truth
from treadline.core.rotations import rotation_y
from treadline.core.signals import Event, HeadingEstimate, TrackCommand
from treadline.io.mcap_log import RunLog
from treadline.playback import Limits, Recording, RecordingBuilder
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair, Scenario, Stair
from treadline.vehicle.staircase import as_designed


class Transcript:
    """Sessions of a text file, each under a line ``--- TITLE``: what is played in each, and what it answers."""

    def __init__(self, path: Path) -> None:
        self.path = path
        parts = re.split(r"(?m)^--- ", path.read_text(encoding="utf-8"))[1:]
        self.sessions = {title: rest.strip("\n").split("\n") for title, _, rest in (part.partition("\n") for part in parts)}

    def check(self, title: str, played: list[str]) -> None:
        """Compare a session with what was played; ``TREADLINE_ACCEPT=1`` writes it into the file instead."""
        before = self.sessions.get(title, [])
        if os.environ.get("TREADLINE_ACCEPT"):
            old, new = ("\n".join([f"--- {title}", *lines]).rstrip() + "\n" for lines in (before, played))
            text = self.path.read_text(encoding="utf-8")
            self.path.write_text(text.replace(old, new) if title in self.sessions else f"{text}\n{new}", encoding="utf-8")
        else:
            assert played == before


Tables = dict[str, Any]
MakeFolder = Callable[..., Path]


def write_series(folder: Path, start_deg: float) -> None:
    """Write 30 s of a heading that decays from a start."""
    t = np.arange(0.0, 30.0, 0.1)
    heading = start_deg * np.exp(-t)
    columns = {
        "t_s": t,
        "estimate_deg": heading + 0.01,
        "heading_deg": heading,
        "yaw_deg": 1.1 * heading,
        "pitch_deg": np.full_like(t, 28.0),
        "seat_pitch_deg": 28.0 * np.exp(-2.0 * t),
        "stability_margin_deg": 9.0 + 0.1 * np.cos(t),
        "left_m_s": 0.2 + 0.01 * heading,
        "right_m_s": 0.2 - 0.01 * heading,
        "x_m": 0.2 * t,
        "y_m": 0.001 * t,
        "friction_use": np.full_like(t, 0.86),
    }
    folder.mkdir(parents=True, exist_ok=True)
    rows = np.column_stack(list(columns.values()))
    lines = [",".join(columns), *(",".join(f"{value:.6g}" for value in row) for row in rows)]
    (folder / "series.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.fixture
def results() -> Tables:
    """Return the values of a whole reproduction."""
    return reproduced()


def reproduced() -> Tables:
    """Return the values of a small reproduction: every figure is a round number."""
    values: Tables = json.loads(Path(__file__).with_name("reproduction.json").read_text(encoding="utf-8"))
    return values


@pytest.fixture
def reproduce_folder(tmp_path: Path) -> MakeFolder:
    return lambda results, name="reproduce": write_reproduction(tmp_path / name, results)


def write_reproduction(folder: Path, results: Tables) -> Path:
    """Write results and the series of every run they name."""
    runs = [*results.get("fig09", []), *results.get("fig10", []), *([results["fig11"]] if results.get("fig11") else [])]
    for row in runs:
        if (run := str(row.get("run"))).replace("-", "").isalnum() and not (folder / "runs" / run).exists():
            write_series(folder / "runs" / run, float(row.get("start_heading_deg", 5.0)))
    folder.mkdir(exist_ok=True)
    (folder / "results.json").write_text(json.dumps(results), encoding="utf-8")
    return folder


HOLD = {"t_s": 1.5, "name": "hold", "cause": "no command for 0.5 s"}


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    """Return the folder of one run."""
    return write_run(tmp_path / "run")


def write_run(
    folder: Path,
    *,
    events: Sequence[Mapping[str, Any]] = (HOLD,),
    settings: Mapping[str, Any] | None = None,
    command: str = "treadline climb paper-28",
    **result: Any,
) -> Path:
    """Write the folder of a run with a log of one second; ``result`` changes its scores."""
    write_series(folder, 10.0)
    with RunLog(folder / "log.mcap") as log:
        for signal in (*truths_of_a_climb(1.0), *(Event(**event) for event in events)):
            log(signal)
    scored = {"verdict": "held", "cause": "no command", "rms_heading_deg": 1.234, "events": [*events], "settle_s": None}
    manifest = {"settings": settings or {"stair": {"slope_deg": 28.0, "steps": 10}}, "seed": 3, "command": command}
    (folder / "result.json").write_text(json.dumps(scored | result), encoding="utf-8")
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    return folder


SLOPE_RAD = 28.0 * DEG
HOSTILE = "</script><script>alert(1)</script>"


def truths_of_a_climb(seconds: float) -> list[Truth]:
    """Return ground truth of a chair that climbs a flight of 28° at 0.2 m/s with an oscillating heading."""
    found = []
    for k in range(round(100 * seconds)):
        t_s = 0.01 * k
        x_m, z_m = 0.5 + 0.2 * t_s * math.cos(SLOPE_RAD), 0.28 + 0.2 * t_s * math.sin(SLOPE_RAD)
        place = {"x_m": 0.2 * t_s, "passenger_x_m": x_m, "passenger_z_m": z_m + 0.8, "chassis_x_m": x_m, "chassis_z_m": z_m}
        moves = {"left_m_s": 0.2, "right_m_s": 0.21, "pitch_rate_rad_s": 0.02 * math.sin(5.0 * t_s), "friction_use": 0.8}
        margin_rad = (12.0 + 4.0 * math.cos(2.0 * t_s)) * DEG
        turn = {"heading_rad": 3.0 * DEG * math.cos(t_s), "pitch_rad": SLOPE_RAD, "stability_margin_rad": margin_rad}
        found.append(truth(t_s, **place, **moves, **turn))
    return found


def climbing(*, seconds: float = 6.0, cause: str = HOSTILE) -> Recording:
    """Return a chair that climbs the flight at 0.2 m/s with an oscillating heading, and perceives all nosings but the sixth."""
    scenario = Scenario(stair=Stair(slope_deg=28.0, steps=10), chair=Chair())
    chair = read_chair("wheelchair")
    builder = RecordingBuilder(chair, scenario, source="climbing", limits=Limits(pitch_rate_rad_s=25.0 * DEG, belt_limit_m_s=1.0))
    nosings_W = as_designed(scenario.stair).nosings_W
    builder(Event(t_s=0.0, name="climb", cause=cause), 0.0)
    builder(Event(t_s=0.5 * seconds, name="crest", cause="end of the flight in view"), 0.5 * seconds)
    for k, true in enumerate(truths_of_a_climb(seconds)):
        t_s, heading = true.t_s, true.heading_rad
        place = np.array([true.chassis_x_m, true.chassis_y_m, true.chassis_z_m])
        builder(true, t_s)
        builder(
            HeadingEstimate(t_s=t_s, heading_rad=heading + 0.2 * DEG, heading_rate_rad_s=0.0, sigma_rad=0.15 * DEG, source="vision")
        )
        builder(TrackCommand(t_s=t_s, left_m_s=0.2, right_m_s=0.2))
        if k % 10 == 0:
            ahead = [i for i in range(4, 8) if i != 5]
            nosings_B = (nosings_W[ahead] - place) @ rotation_y(-SLOPE_RAD)
            builder(stair(t_s, nosings_B, rise_m=0.16, run_m=0.3, slope_rad=SLOPE_RAD), t_s + 0.06)
    return builder.build(verdict="arrived")


@pytest.fixture(scope="module")
def recording() -> Recording:
    return climbing()


class PlayerPage(Page):
    """Page in a file."""

    def open(self, page: Path, *, width_px: int = 1280, dark: bool = False) -> None:
        self.resize(width_px, 800)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})
        self.driver.get(page.resolve().as_uri())
        self.run("return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def pixels(self, selector: str) -> np.ndarray:
        """Return the image of a canvas."""
        url = self.run(f"return document.querySelector('{selector}').toDataURL('image/png')")
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2]))).convert("RGB")).astype(int)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlayerPage]:
    if CHROMIUM is None or DRIVER is None:
        pytest.skip("needs Debian's chromium and chromium-driver")
    pytest.importorskip("selenium.webdriver", reason="selenium drives the browser")
    with drivers(tmp_path_factory) as make:
        yield PlayerPage(make())
