"""Signals of a short synthetic run, and logs of them."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import world

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.ports import Truth
from treadline.core.signals import Event, HeadingEstimate, SeatCommand, SeatReading, StairMap, TrackCommand
from treadline.io.mcap_log import RunLog
from treadline.io.runs import begin_run, write_result
from treadline.plant.mujoco import open_plant
from treadline.playback import Recording, RecordingBuilder
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair, Scenario, Stair
from treadline.vehicle.staircase import Staircase

TICKS = 40
SCENARIO = Scenario(stair=Stair(rise_jitter_m=0.004), chair=Chair())
CAMERA = PinholeCamera(width_px=5, height_px=3, fx_px=4.5, fy_px=4.25, cx_px=2.0, cy_px=1.0)


def truth(k: int) -> Truth:
    t_s = 0.01 * k
    tilt = {"yaw_rad": 0.2, "pitch_rad": 20.0 * DEG, "roll_rad": 2.0 * DEG, "seat_pitch_rad": 1.0 * DEG}
    place = {"x_m": 0.2 * t_s, "passenger_z_m": 1.0, "chassis_x_m": 1.0 + 0.2 * t_s, "chassis_y_m": 0.1, "chassis_z_m": 0.5}
    moves = {"left_m_s": 0.2, "right_m_s": 0.25, "stability_margin_rad": 0.3, "heading_rad": 0.1 * math.sin(t_s)}
    return world.truth(t_s, **tilt, **place, **moves)


def stair_map(t_s: float) -> StairMap:
    return world.stair(t_s, [(0.8, 0.0, 0.2), (1.1, 0.0, 0.36)], right_wall_m=0.7)


def signals_of_a_run(ticks: int = TICKS) -> list[tuple[Any, float]]:
    """Return each signal with the time at which it was taken, in order."""
    found: list[tuple[Any, float]] = [(Event(t_s=0.0, name="search", cause="start"), 0.0)]
    for k in range(ticks):
        t_s = 0.01 * k
        found += [
            (world.imu(t_s, 0.2, rates_rad_s=(0.0, -0.02, 0.0)), t_s),
            (SeatReading(t_s=t_s, pitch_rad=0.01, stroke_m=0.1), t_s),
            (world.belts(t_s), t_s),
            (world.flipper(t_s, 0.01 * k, 1.0), t_s),
        ]
        if k >= 5:
            source: Any = "vision" if k % 2 else "gyro"
            found.append(
                (HeadingEstimate(t_s=t_s, heading_rad=0.02 * k, heading_rate_rad_s=0.0, sigma_rad=0.01, source=source), t_s)
            )
        if k % 10 == 0:
            found.append((TrackCommand(t_s=t_s, left_m_s=0.001 * k, right_m_s=0.2), t_s))
            found.append((stair_map(t_s), t_s + 0.06))
            depth_m = np.ones((3, 5), np.float32)
            found.append((RgbdFrame(t_s=t_s, rgb=np.full((3, 5, 3), k, np.uint8), depth_m=depth_m, camera=CAMERA), t_s + 0.06))
        found.append((truth(k), t_s))
    found.append((Event(t_s=0.2, name="climb", cause="nosings found"), 0.2))
    found.append((Event(t_s=0.3, name="hold", cause="operator"), 0.3))
    return found


@pytest.fixture
def written(tmp_path: Path) -> Callable[..., Path]:
    """Return what writes signals as the log of a run folder."""

    def write(signals: list[tuple[Any, float]], *, image_every: int = 1) -> Path:
        folder = tmp_path / "run"
        begin_run(folder, SCENARIO.model_dump(mode="json"), 3, guard={"pitch_rate_rad_s": 0.4, "belt_limit_m_s": 1.0})
        with RunLog(folder / "log.mcap", image_every=image_every) as log:
            for signal, taken_s in signals:
                log(signal, taken_s)
        write_result(folder, {"verdict": "held", "cause": "operator"})
        return folder

    return write


@pytest.fixture(scope="session")
def driven() -> tuple[Recording, Staircase]:
    """Return two seconds of a chair that drives half a pitch up the flight, and the plant's stair."""
    scenario = SCENARIO.model_validate({**SCENARIO.model_dump(), "start": {"place": "flight", "step": 4}})
    plant, builder = open_plant(scenario, 3), RecordingBuilder(read_chair("wheelchair"), scenario, seed=3)
    plant.start()
    for k in range(20):
        plant.write(TrackCommand(t_s=0.1 * k, left_m_s=0.1, right_m_s=0.12), SeatCommand(t_s=0.1 * k, rate_m_s=0.01))
        plant.advance(0.1 * (k + 1))
        for sample in plant.truth():
            builder(sample, sample.t_s)
    plant.close()
    return builder.build(), plant.staircase
