"""Opening of a target: a scenario that is run live, or a recorded run. ``name or path -> Session, Stage``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.errors import LogFormatError, SettingsError
from treadline.core.models import ControllerDesign, json_of
from treadline.io.mcap_read import has_arrivals, run_metadata
from treadline.io.runs import FORMER_RUN_CONTROLLER, LOG, RUN_CONTROLLER
from treadline.playback import Recording, manifest_of, run_folder_of
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.scenario.scenario import Belts, Scenario, read_scenario
from treadline.vehicle.staircase import build_staircase
from treadline.view.orders import ImageOrder, Order, Worker
from treadline.view.scene_3d import Stage
from treadline.view.session import Feed, Session

LOGS = (".mcap", ".bag", ".db3")
"""File names of logs end like this; every other file is a scenario."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Opened:
    """Target that has been opened."""

    session: Session
    stage: Stage
    title: str
    can_fork: bool
    """Whether the run can be repeated: its scenario and seed are known."""
    missing: tuple[str, ...] = ()
    """Sentences about what a log does not hold."""
    recording: Recording | None = None
    """Recording of a run that is not live."""


def is_recorded(target: str) -> bool:
    """Return whether a target is a recorded run: a folder, or a file with the name of a log."""
    path = Path(target)
    return path.is_dir() or path.suffix in LOGS


def open_live(target: str, *, seed: int, controller: Any, detector: str | None, estimator: str | None, attended: bool) -> Opened:
    """Return a session of a scenario, whose simulation starts at once.

    Raises:
        SettingsError: If the scenario does not exist or is invalid.
    """
    scenario = read_scenario(target)
    order = Order(scenario=scenario, seed=seed, controller=controller, detector=detector, estimator=estimator, attended=attended)
    session = Session(feed=Feed(order=order), attended=attended)
    session.feed.start()
    return Opened(
        session=session,
        stage=stage_of(scenario, seed, read_chair(scenario.chair.model)),
        title=f"{target}, seed {seed}",
        can_fork=True,
    )


def open_recorded(target: str) -> Opened:
    """Return a session of a recorded run.

    Raises:
        LogFormatError: If the log is missing, damaged, empty, or without poses.
        SettingsError: If the run is of another version.
    """
    from treadline.playback import read_recording
    from treadline.view.recorded import tape_of

    recording = read_recording(target)
    if not recording.has_poses:
        raise LogFormatError(
            f"{target}: no poses of the chair in this log, so there is no scene to show ({recording.missing[0].rstrip('.')}); "
            "treadline climb writes logs with poses, and treadline report draws the signals of any run folder"
        )
    scenario = recording.scenario or Scenario()
    order = Order(scenario=scenario, seed=recording.seed, controller=_controller_of(Path(target)))
    feed = Feed(order=order, tape=tape_of(recording))
    log = Path(target) / LOG if (Path(target) / LOG).is_file() else Path(target)
    if len(recording.frames_t_s) or not has_arrivals(log):
        feed.images = Worker(
            ImageOrder(
                log=str(log),
                camera=recording.chair.camera_at(scenario.sensors.image_height_px, rear=scenario.drive.direction == "down"),
                vision="paper" if scenario.control.vision == "paper" else "robust",
                swept_half_m=recording.chair.swept_half_m,
                latency_s=scenario.realism.camera_latency_s,
            )
        )
    can_fork = recording.scenario is not None and not _has_plugins(Path(target))
    session = Session(feed=feed, playing=False, following=False, can_repeat=can_fork)
    return Opened(
        session=session,
        stage=stage_of(scenario, recording.seed, recording.chair),
        title=str(target),
        can_fork=can_fork,
        missing=recording.missing,
        recording=recording,
    )


def stage_of(scenario: Scenario, seed: int, chair: ChairDescription) -> Stage:
    """Return stair and chair of a run."""
    # The plants draw the jitter of the stair from the first stream of the run's seed.
    jitter = np.random.default_rng(seed).spawn(1)[0]
    return Stage(
        staircase=build_staircase(scenario.stair, jitter, scenario.step),
        chair=chair,
        loading=scenario.chair,
        belts=scenario.belts if isinstance(scenario.belts, Belts) else Belts(),
        rear_camera=scenario.drive.direction == "down",
        image_height_px=scenario.sensors.image_height_px,
    )


def _controller_of(target: Path) -> ControllerDesign | None:
    """Return the controller that a run folder or the metadata of a log keeps."""
    folder = run_folder_of(target)
    if folder is not None:
        found = next((folder / name for name in (RUN_CONTROLLER, FORMER_RUN_CONTROLLER) if (folder / name).is_file()), None)
        return None if found is None else ControllerDesign.load(found)
    kept = run_metadata(target).get("controller") if target.is_file() and has_arrivals(target) else None
    return None if kept is None else ControllerDesign.of_tables(json_of(kept, str(target)), target)


def _has_plugins(target: Path) -> bool:
    """Return whether a run used plug-ins, which are never loaded on behalf of a log."""
    return bool((manifest_of(target) or {}).get("plugins"))


def check_export(path: Path, *, force: bool) -> None:
    """Check the target of an export.

    Raises:
        SettingsError: If the file exists and may not be replaced, or is a folder.
    """
    if path.is_dir():
        raise SettingsError(f"--export {path}: is a folder; give a file such as {path / 'run.html'}")
    if path.exists() and not force:
        raise SettingsError(f"--export {path}: the file exists; give another, or --force to overwrite it")
