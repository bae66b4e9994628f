"""Replay of a recording through perception, fusion, controller and guard: scores and a run folder out.

The mission is the one that drives the chair; its plant is the recording. Ground truth in the log is read here and nowhere else.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.camera_images import RgbdFrame
from treadline.core.errors import LogFormatError, SettingsError
from treadline.core.files import read_json
from treadline.core.kernel_cache import compiling
from treadline.core.settings import settings_of
from treadline.core.signals import TICK_S, Event
from treadline.experiments._replay_scores import ReplayScores
from treadline.experiments._replay_settings import ReplaySettings, camera_items, key_table, resolved
from treadline.io.mcap_log import RunLog
from treadline.io.runs import LOG, MANIFEST, RUN_CONTROLLER, begin_run, log_metadata, write_result, write_series
from treadline.io.sensor_log import SensorLog
from treadline.mission import Detection, Detector
from treadline.mission.loop import Mission, Signal
from treadline.mission.mission_blocks import detector_of
from treadline.mission.mission_config import MissionConfig
from treadline.mission.replay_plant import ReplayPlant
from treadline.perception import StairDetector
from treadline.run.resolve import SHIPPED, mission_config, resolved_blocks
from treadline.run.scene_log import SceneLog, WatchedDetector
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair, Scenario

__all__ = ["camera_items", "key_table", "replayed_run", "source_of"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Log to replay, with the settings of the run that wrote it."""

    log: Path
    base: MissionConfig
    sealed: bool = False
    """Whether the log belongs to a run folder and has checksums throughout."""
    seed: int = 0
    scenario: dict[str, Any] | None = None
    changed: tuple[str, ...] = ()
    """Keys that were changed, if the recorded run was itself a replay."""
    controller: str | None = None
    """Controller file of the recorded run; None if its folder holds none."""
    plugins: dict[str, str] = field(default_factory=dict)
    """Plug-ins of the recorded run by kind. They are listed, never loaded, because a log may come from an untrusted source."""


def replayed_run(
    out: Path,
    log: Path,
    *,
    changes: Sequence[str] = (),
    topics: dict[str, str] | None = None,
    controller: str | None = None,
    detector: str | None = None,
    estimator: str | None = None,
    log_images: bool = False,
    on_progress: Callable[[float, float], None] | None = None,
) -> dict[str, Any]:
    """Replay a log and write its run folder; return the result as JSON values, under the contract's keys.

    The verdict is ``held``, or ``time_up`` at the end of the recording. The fusion ``sees`` images, or recorded headings where the
    log has no images and perception was skipped.

    Args:
        changes: Settings to change, as ``key=value``.
        topics: Topics by role, where the types in the log are ambiguous.
        controller: Controller in place of the recorded run's: file, ``module:Class``, entry point name.
        detector: Stair detector plug-in.
        estimator: Heading estimator plug-in.
        on_progress: Receives the mission time and the length of the recording [s] at each tick.

    Raises:
        TreadlineError: Before anything is written, if the log is damaged or a setting cannot be.
    """
    source = source_of(log)
    if out.resolve() == source.log.parent.resolve() or out.resolve() == log.resolve():
        raise SettingsError(f"--out {out}: is the log's own folder; a replay would write over what it reads: give another")
    for kind, given in (("controller", controller), ("detector", detector), ("estimator", estimator)):
        if kind in source.plugins and given is None:
            raise SettingsError(
                f"{log}: the run used the {kind} plug-in '{source.plugins[kind]}', which a replay does not load by itself; give "
                f"--{kind} {source.plugins[kind]}, or --{kind} {SHIPPED} for the shipped one"
            )
    design, plugins = resolved_blocks(controller, detector, estimator)
    is_shipped = design is None and plugins.controller is None
    settings = resolved(
        replace(source.base, plugins=plugins),
        (*source.changed, *changes),
        source.controller if controller is None else None if is_shipped else controller,
    )
    recording = SensorLog(
        source.log,
        named=topics,
        sealed=source.sealed,
        depth_unit_m=settings.depth_unit_m,
        calibrate=settings.calibrate,
    )
    if settings.mission.vision == "paper" and recording.topics.depth is not None and recording.topics.color is None:
        raise LogFormatError(f"{source.log}: the paper's vision needs colour images, and there are none: --set vision=robust")
    manifest = {
        "log": source.log.parent.name if source.sealed else source.log.name,
        "topics": asdict(recording.topics),
        "set": [*source.changed, *changes],
        "replay": settings.as_tables(),
        "scenario": source.scenario,
    }
    sources = plugins.sources()
    written = begin_run(out, manifest, source.seed, settings.mission.controller, **({"plugins": sources} if sources else {}))
    scores = ReplayScores()
    seeing = detector_of(settings.mission) if plugins.detector is not None else StairDetector(settings.detector)
    try:
        with (
            RunLog(out / LOG, image_every=int(log_images), metadata=log_metadata(written, source.scenario, out)) as run_log,
            SceneLog(run_log, settings.mission.chair, Chair(payload_kg=settings.mission.payload_kg)) as sink,
        ):

            def saw(frame: RgbdFrame, seen: Detection) -> None:
                scores.saw(seen)
                sink.saw(frame, seen)

            watched = WatchedDetector(seeing, saw)
            started = time.process_time() - compiling().spent_s
            cause, rejected = _play(recording, settings, watched, scores, sink, on_progress)
            cpu_s = time.process_time() - compiling().spent_s - started
    finally:
        if scores.ticks:
            write_series(out, scores.series())
    values = {
        "verdict": "time_up" if cause is None else "held",
        "sees": "recorded headings" if recording.topics.depth is None else "images",
        "cause": cause,
        "duration_s": scores.ticks * TICK_S,
        "frames": scores.frames,
        "accepted": scores.seen,
        "rejected": rejected,
        "refusals": dict(scores.refusals.most_common()),
        **scores.figures(),
        "ms_per_frame": 1e3 * float(np.median(np.array(watched.spent_s))) if watched.spent_s else None,
        "real_time_factor": scores.ticks * TICK_S / max(cpu_s, 1e-9),
        "dropped": dict(recording.dropped),
        "topics": asdict(recording.topics),
        "events": [asdict(event) for event in scores.events],
    }
    write_result(out, values)
    return values


def _play(
    recording: SensorLog,
    settings: ReplaySettings,
    detector: Detector,
    scores: ReplayScores,
    sink: SceneLog,
    on_progress: Callable[[float, float], None] | None,
) -> tuple[str | None, int]:
    """Run the mission to the end of the recording; return the cause of a hold and the number of headings the fusion rejected."""
    now_s = 0.0

    def log(signal: Signal, taken_s: float) -> None:
        scores.note(signal)
        sink(signal, taken_s)

    def aside(signal: Any) -> None:
        scores.compare_with(signal)
        if isinstance(signal, Event):
            sink(signal, now_s)

    blocks = settings.blocks(detector, shows_stair=recording.shows_stair)
    plant = ReplayPlant(recording.arrivals(aside), settings.R_BI)
    mission = Mission(plant, blocks, log)
    while not plant.over:
        tick = mission.tick()
        sink.plan(tick.plan)
        truth = scores.step(tick)
        if truth is not None:
            sink(truth, tick.t_s)
        now_s = tick.t_s + TICK_S
        if on_progress is not None:
            on_progress(tick.t_s, recording.duration_s)
    plant.close()
    return recording.ended or blocks.guard.holding, blocks.estimator.rejected_count


# ---- the log, and the manifest of the run that wrote it ----


def source_of(log: Path) -> Source:
    """Return a log with the settings in the manifest of its run folder.

    Raises:
        SettingsError: If the manifest cannot be used.
        LogFormatError: If a run folder holds no log.
    """
    folder = log.parent if log.name == LOG and log.is_file() else log
    base = MissionConfig(chair=read_chair(Chair().model))  # of a log without a manifest
    if not (folder / MANIFEST).is_file():
        return Source(log=log, base=base)
    if not (folder / LOG).is_file():
        raise LogFormatError(f"{folder}: no {LOG} in this run folder; only runs that kept their log can be replayed")
    where = folder / MANIFEST
    manifest = read_json(where)
    settings, seed = manifest.get("settings"), manifest.get("seed")
    if not isinstance(settings, dict) or type(seed) is not int:
        raise SettingsError(f"{where}: no 'settings' and 'seed'; replay its {LOG} from a folder without {MANIFEST}")
    scenario: dict[str, Any] | None = settings
    changed: tuple[str, ...] = ()
    if "replay" in settings:
        scenario, changed = settings.get("scenario"), tuple(str(item) for item in settings.get("set") or ())
    named = manifest.get("plugins")
    plugins = {str(kind): str(name) for kind, name in named.items()} if isinstance(named, dict) else {}
    kept = folder / RUN_CONTROLLER if (folder / RUN_CONTROLLER).is_file() else None
    if kept is not None:  # the file that the key named may have changed since
        changed = tuple(item for item in changed if item.partition("=")[0].strip() != "controller")
    if scenario is not None:
        base = mission_config(settings_of(scenario, Scenario, where=f"{where}: settings"), None)
    return Source(
        log=folder / LOG,
        base=base,
        sealed=True,
        seed=seed,
        scenario=scenario,
        changed=changed,
        controller=None if kept is None else str(kept),
        plugins=plugins,
    )
