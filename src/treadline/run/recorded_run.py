"""Run folders of simulated runs: manifest, result, time series and log."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.signals import TICK_S
from treadline.io.mcap_log import RunLog
from treadline.io.runs import LOG, begin_run, log_metadata, write_result, write_series
from treadline.mission.loop import Tick
from treadline.playback import staircase_of
from treadline.run.episode import Traverse, Watch, run_episode
from treadline.run.resolve import Setup
from treadline.run.run_scores import Trace
from treadline.run.scene_log import SceneLog, WatchedDetector

SERIES = {
    "heading_deg": "heading_rad",
    "yaw_deg": "yaw_rad",
    "pitch_deg": "pitch_rad",
    "seat_pitch_deg": "seat_pitch_rad",
    "stability_margin_deg": "stability_margin_rad",
}
PLAIN_SERIES = ("left_m_s", "right_m_s", "x_m", "y_m", "friction_use")


def recorded_run(
    folder: Path, setup: Setup, more: Mapping[str, Any] | None = None, *, image_every: int = 0, watch: Watch | None = None
) -> Traverse:
    """Run a resolved setup and write its run folder.

    Args:
        folder: Run folder: manifest.json, result.json, series.csv and log.mcap.
        more: Further entries of the manifest.
        image_every: Keep every n-th frame in the log; 0 keeps none.
        watch: Receives each tick as it ends.

    Raises:
        TreadlineError: Before anything is written, if the setup cannot be run.
    """
    blocks = None if setup.refusal else setup.build_blocks()
    plugins = setup.mission.plugins.sources()
    said = {**({"plugins": plugins} if plugins else {}), **(more or {})}
    if blocks is not None:
        said["guard"] = asdict(blocks.guard.config)  # plots draw the limits that applied
    scenario = setup.scenario
    manifest = begin_run(folder, scenario.model_dump(mode="json"), setup.seed, setup.mission.controller, **said)
    staircase = staircase_of(scenario, setup.seed)
    metadata = log_metadata(manifest, manifest["settings"], folder)
    with (
        RunLog(folder / LOG, image_every=image_every, metadata=metadata) as log,
        SceneLog(log, setup.chair, scenario.chair, belts=scenario.belts, staircase=staircase) as scene,
    ):

        def ended(tick: Tick) -> None:
            scene.plan(tick.plan)
            if watch is not None:
                watch(tick)

        if blocks is not None and image_every:
            blocks = replace(blocks, detector=WatchedDetector(blocks.detector, scene.saw))
        run = run_episode(setup, blocks=blocks, sink=scene, watch=ended)
    write_series(folder, series(run.trace, run.estimate_rad))
    if setup.report.walk is not None and setup.seat_shift is None:
        write_series(folder, setup.report.walk.columns, "check")
    write_result(folder, run.summary())
    return run


def series(trace: Trace, estimate_rad: Float[np.ndarray, " T"]) -> dict[str, Float[np.ndarray, " T"]]:
    """Return the columns of ``series.csv`` by name: angles in degrees, everything else in SI units.

    Without ground truth these are time and estimate alone.
    """
    if not len(trace["t_s"]):
        return {"t_s": np.arange(len(estimate_rad)) * TICK_S, "estimate_deg": estimate_rad / DEG}
    columns = {"t_s": trace["t_s"], "estimate_deg": estimate_rad[: len(trace["t_s"])] / DEG}
    columns |= {name: trace[source] / DEG for name, source in SERIES.items()}
    columns |= {name: trace[name] for name in PLAIN_SERIES}
    return columns
