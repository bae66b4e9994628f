"""A run folder: what was asked (manifest.json), what came out (result.json), how it went (series.csv, log.mcap, record.csv).

The controller that drove lies beside them (flown-controller.json).
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.io.plain import plain
from treadline.io.provenance import provenance
from treadline.io.records import RECORD
from treadline.models import ControllerDesign, write_whole

LOG = "log.mcap"
MANIFEST = "manifest.json"
FLOWN = "flown-controller.json"
"""The controller that drove. Not ``controller.json``: ``treadline tune`` makes that, of a run too, and no run removes it."""
WRITTEN = ("result.json", "series.csv", LOG, f"{LOG}.part", RECORD, FLOWN, "report.html", "figures/run.svg")
"""All that a run and its report write beside the manifest."""
SERIES_EVERY = 10
"""Every tenth sample of 100 Hz: enough to draw."""


def begin_run(
    folder: Path, settings: Mapping[str, Any], seed: int, controller: ControllerDesign | None = None, **more: Mapping[str, Any]
) -> None:
    """Make a run's folder and say first what is run: a run that is interrupted can then be told apart, and repeated.

    Args:
        controller: What drives, if one does; its own file may be tuned anew meanwhile.
        more: What else the manifest says, by its key.
    """
    clear_run(folder)
    folder.mkdir(parents=True, exist_ok=True)
    write_manifest(folder, settings, seed, **more)
    if controller is not None:
        controller.save(folder / FLOWN)


def clear_run(folder: Path) -> None:
    """Remove what an earlier run wrote, so that nobody takes its result for the next one's.

    A folder without a manifest is no run's, and keeps all it holds.
    """
    if (folder / MANIFEST).is_file():
        remove(folder, (*WRITTEN, MANIFEST))


def remove(folder: Path, names: Sequence[str]) -> None:
    """Remove those files of a folder that are there."""
    for name in names:
        (folder / name).unlink(missing_ok=True)


def write_manifest(folder: Path, settings: Mapping[str, Any], seed: int, **more: Mapping[str, Any]) -> None:
    """Write what is needed to repeat a run, and ``more`` by its key."""
    _write_json(folder / MANIFEST, {"settings": settings, "seed": seed, **more, **provenance()})


def write_result(folder: Path, result: Mapping[str, Any]) -> None:
    """Write what a run came to."""
    _write_json(folder / "result.json", result)


def write_series(folder: Path, columns: Mapping[str, Float[np.ndarray, " T"]]) -> None:
    """Write columns at 10 Hz as CSV; NaN as an empty cell."""
    names = list(columns)
    rows = np.column_stack([columns[name][::SERIES_EVERY] for name in names])
    lines = [",".join(names)]
    lines += [",".join("" if value != value else f"{value:.6g}" for value in row) for row in rows.tolist()]  # noqa: PLR0124 - NaN
    write_whole(folder / "series.csv", "\n".join(lines) + "\n")


def read_series(folder: Path) -> dict[str, Float[np.ndarray, " T"]]:
    """Return the columns that ``write_series`` wrote."""
    with (folder / "series.csv").open(encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        rows = np.genfromtxt(file, delimiter=",", filling_values=np.nan, ndmin=2)
    return {name: rows[:, i] for i, name in enumerate(names)}


def _write_json(path: Path, values: Mapping[str, Any]) -> None:
    write_whole(path, json.dumps(plain(values), indent=1, allow_nan=False) + "\n")
