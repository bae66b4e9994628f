"""Run folders: file names, writers, and the provenance of their results.

manifest.json holds the settings with software versions, git commit and the command line that reproduces the run, result.json the
result, series.csv the time series, log.mcap the signals, record.csv the input-output record and ``run-controller.json`` the
controller.
"""

import json
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from treadline.core.errors import SettingsError
from treadline.core.files import read_json, write_json, write_whole
from treadline.core.models import ControllerDesign
from treadline.core.printing import plain

if TYPE_CHECKING:
    from treadline.scenario.chair import ChairDescription

SUCCEEDED = ("time_up", "arrived", "end_of_flight")
"""Verdicts of runs that did what was asked: exit code 0."""
COMPLETED = (*SUCCEEDED, "arrived_rough")
"""Verdicts of runs that lasted until their time limit or their destination. Any other run ended early, and enters no average: its
scores are those of a shorter time."""
LOG = "log.mcap"
"""File name of the MCAP log."""
RECORD = "record.csv"
"""File name of the input-output record."""
INPUTS, OUTPUTS = ("left_m_s", "right_m_s"), ("heading_rad", "yaw_rate_rad_s")
"""Columns of a record of a drive, and of files for which none are named."""
MANIFEST = "manifest.json"
"""File name of the manifest."""
JOURNAL = "journal.jsonl"
"""File name of the journal of a sweep."""
RUN_CONTROLLER = "run-controller.json"
"""File name of the controller used by the run. The name ``controller.json`` is taken: ``treadline tune`` writes that file, also
into run folders, and no run may remove it."""
WRITTEN = (
    *("result.json", "series.csv", "check.csv", LOG, f"{LOG}.part", RECORD, RUN_CONTROLLER),
    *("report.html", "figures/run.svg", "figures/check.svg"),
)
"""Files written by a run and its report, besides the manifest."""
WALKED = {"x_m", "z_m", "pitch_deg", "flipper_deg", "rate_deg_s", "front_margin_deg", "rear_margin_deg", "torque_n_m"}
"""Columns of ``check.csv`` that pages and live view draw."""
SERIES_EVERY = 10
"""Decimation of series.csv: every tenth sample of 100 Hz, sufficient for plots."""
PACKAGES = ("treadline", "numpy", "scipy", "numba", "mujoco-core", "opencv-python-headless", "matplotlib", "mcap")
"""Packages whose versions are recorded."""


def begin_run(
    folder: Path, settings: Mapping[str, Any], seed: int, controller: ControllerDesign | None = None, **more: Mapping[str, Any]
) -> dict[str, Any]:
    """Create a run folder and write the manifest first, so that an interrupted run can be identified and repeated.

    Returns:
        The manifest.

    Args:
        controller: Controller used by the run; stored as a copy, because its own file can change during the run.
        more: Additional entries of the manifest, by key.
    """
    clear_run(folder)
    folder.mkdir(parents=True, exist_ok=True)
    manifest = write_manifest(folder, settings, seed, **more)
    if controller is not None:
        controller.save(folder / RUN_CONTROLLER)
    return manifest


def chair_of_folder(path: Path) -> "ChairDescription | None":
    """Return the chair of a run, by its folder or by a file in it; None where no run says so.

    Raises:
        SettingsError: If the manifest cannot be read, or names no chair that is there.
    """
    where = (path.parent if path.name in (LOG, RECORD) else path) / MANIFEST
    settings = read_json(where).get("settings") if where.is_file() else None
    if not isinstance(settings, dict):
        return None
    from treadline.scenario.scenario import chair_of_run

    return chair_of_run(settings, f"{where}: settings")


def log_metadata(manifest: Mapping[str, Any], scenario: Mapping[str, Any] | None, folder: Path) -> dict[str, str]:
    """Return the properties of a run for its log's metadata record: seed, commit, version and, if known, the scenario as JSON.

    The manifest, and the controller in the run folder, are kept as JSON as well, so that a log without its folder can be repeated.
    """
    controller = folder / RUN_CONTROLLER
    more = {"controller": controller.read_text(encoding="utf-8")} if controller.is_file() else {}
    known = {} if scenario is None else {"scenario": json.dumps(plain(scenario), allow_nan=False)}
    commit, version = manifest["git_commit"] or "", manifest["versions"].get("treadline", "")
    # The command line names the folder, and the same seed shall give the same bytes in every folder.
    whole = json.dumps(plain({key: value for key, value in manifest.items() if key != "command"}), allow_nan=False)
    return {"seed": str(manifest["seed"]), "commit": commit, "version": version, **known, "manifest": whole, **more}


def clear_run(folder: Path) -> None:
    """Remove the files of an earlier run, so that old results cannot be mistaken for new ones.

    A folder without a manifest is not a run folder and is left unchanged.
    """
    if (folder / MANIFEST).is_file():
        remove(folder, (*WRITTEN, MANIFEST))


def remove(folder: Path, names: Sequence[str]) -> None:
    """Remove the named files of a folder, as far as they exist."""
    for name in names:
        (folder / name).unlink(missing_ok=True)


def write_manifest(folder: Path, settings: Mapping[str, Any], seed: int, **more: Mapping[str, Any]) -> dict[str, Any]:
    """Write settings, seed and provenance of a run, and additional entries by key; return them."""
    manifest = {"settings": settings, "seed": seed, **more, **provenance()}
    write_json(folder / MANIFEST, manifest)
    return manifest


def write_result(folder: Path, result: Mapping[str, Any]) -> None:
    """Write the result of a run."""
    write_json(folder / "result.json", result)


def write_series(folder: Path, columns: Mapping[str, Float[np.ndarray, " T"]], name: str = "series") -> None:
    """Write columns as CSV, those of a run's ``series`` at 10 Hz; NaN as an empty cell."""
    names = list(columns)
    rows = np.column_stack([columns[column][:: SERIES_EVERY if name == "series" else 1] for column in names])
    lines = [",".join(names)]
    lines += [",".join("" if value != value else f"{value:.6g}" for value in row) for row in rows.tolist()]  # noqa: PLR0124 - NaN
    write_whole(folder / f"{name}.csv", "\n".join(lines) + "\n")


def read_series(folder: Path, name: str = "series") -> dict[str, Float[np.ndarray, " T"]]:
    """Return the columns written by ``write_series``."""
    with (folder / f"{name}.csv").open(encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        rows = np.genfromtxt(file, delimiter=",", filling_values=np.nan, ndmin=2)
    return {name: rows[:, i] for i, name in enumerate(names)}


def provenance() -> dict[str, Any]:
    """Return versions, git commit (``-dirty`` if tracked files are modified; None without git) and command line."""
    return {"versions": versions(), "git_commit": git_commit(), "command": _command()}


def read_walk(folder: Path) -> dict[str, Float[np.ndarray, " n"]] | None:
    """Return the columns of the walk that ``check`` made before a run, as of ``Walk.columns``; None where the run keeps none.

    Raises:
        SettingsError: If the table is damaged.
    """
    path = folder / "check.csv"
    if not path.is_file():
        return None
    try:
        columns = read_series(folder, "check")
    except (ValueError, IndexError):
        columns = {}
    if not (columns.keys() >= WALKED and columns["x_m"].size and np.isfinite(columns["x_m"]).all()):
        raise SettingsError(f"{path}: not the columns of a walk; make the run again")
    return columns


@cache
def versions() -> Mapping[str, str]:
    """Return the versions of Python and of the packages that affect results."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def git_commit() -> str | None:
    """Return the commit of the source tree, ``-dirty`` if tracked files are modified; None outside a git repository."""
    git = shutil.which("git")
    if git is None:
        return None
    try:
        # S603: git is found on the path and all arguments are constants. ``--exclude=*`` ignores tags, so the full hash is given.
        done = subprocess.run(  # noqa: S603
            [git, "--no-optional-locks", "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=False,
            timeout=10.0,  # comparing a source tree on a slow disk takes seconds
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def _command() -> str:
    """Return the command line in shell syntax.

    The command reproduces the run in the same working folder: relative paths are kept. Absolute paths are reduced to their last
    component, because run files must not contain folder names of this machine; to reproduce, put these files into the working
    folder.
    """
    return shlex.join(["treadline", *(_without_folders(word) for word in sys.argv[1:])])


def _without_folders(word: str) -> str:
    option, sign, value = word.partition("=")
    if word.startswith("--") and sign:
        return option + sign + _without_folders(value)
    return Path(word).name if Path(word).is_absolute() else word
