"""Run folders of simulated runs: manifest, result, time series and, optionally, a log."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.experiments.excite import Excited, excitation_of, excite, long_enough
from treadline.experiments.scores import Trace
from treadline.experiments.traverse import Sink, Traverse, Watch, run_episode
from treadline.io.mcap_log import RunLog
from treadline.io.records import RECORD, write_record
from treadline.io.runs import LOG, begin_run, write_result, write_series
from treadline.mechanics.chair import read_chair
from treadline.scenario import Scenario
from treadline.setup import Opener, PlantName, Setup

SERIES = {
    "heading_deg": "heading_rad",
    "yaw_deg": "yaw_rad",
    "pitch_deg": "pitch_rad",
    "seat_pitch_deg": "seat_pitch_rad",
    "stability_margin_deg": "stability_margin_rad",
}
PLAIN_SERIES = ("left_m_s", "right_m_s", "x_m", "y_m", "friction_use")


def recorded_run(
    folder: Path,
    setup: Setup,
    *,
    log: bool = True,
    image_every: int = 0,
    watch: Watch | None = None,
) -> Traverse:
    """Run a resolved setup and write its run folder.

    Args:
        folder: Run folder: manifest.json, result.json, series.csv, and log.mcap if ``log``.
        image_every: Keep every n-th frame in the log; 0 keeps none.
        watch: Receives each tick as it ends.

    Raises:
        TreadlineError: Before anything is written, if the setup cannot be run.
    """
    blocks = None if setup.is_full_traversal and setup.rejections else setup.build_blocks()
    more: dict[str, dict[str, Any]] = {**setup.manifest()}
    if blocks is not None:
        more["guard"] = asdict(blocks.guard.config)  # plots draw the limits that applied
    begin_run(folder, setup.scenario.model_dump(mode="json"), setup.seed, setup.mission.controller, **more)
    run: Traverse = _logged(
        folder,
        lambda sink: run_episode(setup, blocks=blocks, sink=sink, watch=watch),
        log=log,
        image_every=image_every,
    )
    _write(folder, run)
    return run


def recorded_excitation(
    folder: Path,
    scenario: Scenario,
    *,
    samples: int,
    period_s: float,
    seed: int,
    log: bool = True,
    image_every: int = 0,
    watch: Watch | None = None,
    open_plant: Opener | PlantName = "mujoco",
) -> Excited:
    """Excite a scenario and write its run folder, ``record.csv`` included.

    Args:
        samples: Number of input-output samples.
        period_s: Time between samples [s].

    Raises:
        TreadlineError: Before anything is written, if the chair cannot be read.
    """
    read_chair(scenario.chair.model)
    settings = long_enough(scenario, (samples + 1) * period_s).model_dump(mode="json")
    begin_run(folder, settings, seed, excitation=asdict(excitation_of(scenario)))
    excited: Excited = _logged(
        folder,
        lambda sink: excite(scenario, samples=samples, period_s=period_s, seed=seed, sink=sink, watch=watch, open_plant=open_plant),
        log=log,
        image_every=image_every,
    )
    write_record(folder / RECORD, excited.record, excited.first_t_s)
    _write(folder, excited.run)
    return excited


def _logged(folder: Path, drive: Callable[[Sink | None], Any], *, log: bool, image_every: int) -> Any:
    with ExitStack() as stack:
        sink = stack.enter_context(RunLog(folder / LOG, image_every=image_every)) if log else None
        return drive(sink)


def _write(folder: Path, run: Traverse) -> None:
    write_series(folder, series(run.trace, run.estimate_rad))
    write_result(folder, run.summary())


def series(trace: Trace, estimate_rad: Float[np.ndarray, " T"]) -> dict[str, Float[np.ndarray, " T"]]:
    """Return the columns of ``series.csv`` by name: angles in degrees, everything else in SI units."""
    columns = {"t_s": trace["t_s"], "estimate_deg": estimate_rad[: len(trace["t_s"])] / DEG}
    columns |= {name: trace[source] / DEG for name, source in SERIES.items()}
    columns |= {name: trace[name] for name in PLAIN_SERIES}
    return columns
