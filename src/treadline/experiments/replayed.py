"""A recording through perception, fusion, controller and guard again: scores, and a run folder, out.

The mission is the one that drives; its plant is the recording. What the log says of the truth comes here and nowhere else.
"""

import re
import time
from array import array
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.compiling import compiling
from treadline.errors import LogFormatError, SettingsError
from treadline.experiments.replay_scores import ReplayScores
from treadline.experiments.replay_settings import ReplaySettings, resolved
from treadline.experiments.replay_source import Source, source_of
from treadline.experiments.traverse import Watch
from treadline.io.mcap_log import RunLog
from treadline.io.runs import LOG, begin_run, write_result, write_series
from treadline.io.sensor_log import SensorLog
from treadline.mission.loop import Mission, Signal
from treadline.mission.replay import ReplayPlant
from treadline.perception import DetectorConfig, StairDetector
from treadline.perception.sight import Sight
from treadline.signals import TICK_S, Event, RgbdFrame

_NUMBER = re.compile(r"(?<!\()[+-]?\d+(\.\d+)?")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Replayed:
    """What a replay came to."""

    verdict: str
    """``held``, or ``time_up``: the recording was over."""
    sees: str
    """``images``, or ``recorded headings`` where the log has no images: perception was skipped."""
    values: dict[str, Any]

    def summary(self) -> dict[str, Any]:
        """Return the replay as JSON values, under the contract's keys."""
        return {"verdict": self.verdict, "sees": self.sees, **self.values}


def replayed_run(
    out: Path,
    log: Path,
    *,
    changes: Sequence[str] = (),
    topics: dict[str, str] | None = None,
    log_images: bool = False,
    watch: Watch | None = None,
    begun: Callable[[float], None] | None = None,
) -> Replayed:
    """Replay a log and write its run folder.

    Args:
        changes: ``key=value`` over what a replay may change.
        topics: Topics by role, where the log's types do not tell.
        begun: Is told the length of the recording before it is played.

    Raises:
        TreadlineError: Before anything is written, if the log is damaged or a setting cannot be.
    """
    source = source_of(log)
    if out.resolve() == source.log.parent.resolve() or out.resolve() == log.resolve():
        raise SettingsError(f"--out {out}: is the log's own folder; a replay would write over what it reads: give another")
    if out.exists() and not out.is_dir():
        raise SettingsError(f"--out {out}: is a file; give a folder")
    settings = resolved(source.base, (*source.changed, *changes), source.controller)
    recording = SensorLog(
        source.log,
        named=topics,
        sealed=source.sealed,
        depth_unit_m=settings.depth_unit_m,
        calibrate=settings.calibrate,
    )
    if settings.mission.vision == "paper" and recording.topics.depth is not None and recording.topics.color is None:
        raise LogFormatError(f"{source.log}: the paper's vision needs colour images, and there are none: --set vision=robust")
    if begun is not None:
        begun(recording.duration_s)
    manifest = _manifest(source, settings, recording, (*source.changed, *changes))
    begin_run(out, manifest, source.seed, settings.mission.controller)
    scores = ReplayScores()
    detector = _Watched(settings.detector)
    try:
        with RunLog(out / LOG, image_every=int(log_images)) as sink:
            started = time.process_time() - compiling().spent_s
            cause, rejected = _play(recording, settings, detector, scores, sink, watch)
            cpu_s = time.process_time() - compiling().spent_s - started
    finally:
        if scores.ticks:
            write_series(out, scores.series())
    run = Replayed(
        verdict="time_up" if cause is None else "held",
        sees="recorded headings" if recording.topics.depth is None else "images",
        values={
            "cause": cause,
            "duration_s": scores.ticks * TICK_S,
            "frames": scores.frames,
            "accepted": scores.seen,
            "rejected": rejected,
            "refusals": dict(detector.refusals.most_common()),
            **scores.figures(),
            "ms_per_frame": detector.ms(50.0),
            "ms_per_frame_p95": detector.ms(95.0),
            "real_time_factor": scores.ticks * TICK_S / max(cpu_s, 1e-9),
            "dropped": dict(recording.dropped),
            "topics": asdict(recording.topics),
            "events": [asdict(event) for event in scores.events],
        },
    )
    write_result(out, run.summary())
    return run


def _play(
    recording: SensorLog, settings: ReplaySettings, detector: "_Watched", scores: ReplayScores, sink: RunLog, watch: Watch | None
) -> tuple[str | None, int]:
    """Turn the mission until the recording is over; return why it holds, and how many headings the fusion refused."""
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
        truth = scores.step(tick)
        if truth is not None:
            sink(truth, tick.t_s)
        now_s = tick.t_s + TICK_S
        if watch is not None:
            watch(tick)
    plant.close()
    return recording.ended or blocks.guard.holding, blocks.estimator.rejected_count


def _manifest(source: Source, settings: ReplaySettings, recording: SensorLog, changes: Sequence[str]) -> dict[str, Any]:
    return {
        "log": source.log.parent.name if source.sealed else source.log.name,
        "topics": asdict(recording.topics),
        "set": list(changes),
        "replay": settings.values.model_dump(mode="json") | {"controller": settings.controller_name},
        "scenario": source.scenario,
    }


class _Watched(StairDetector):
    """The detector, its time and its reasons noted."""

    def __init__(self, config: DetectorConfig) -> None:
        super().__init__(config)
        self.refusals: Counter[str] = Counter()
        self._spent_s = array("d")

    def look(self, frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None = None, *, stages: bool = False) -> Sight:
        """Return what a frame says, as the detector does."""
        started = time.perf_counter()
        sight = super().look(frame, gravity_C, stages=stages)
        self._spent_s.append(time.perf_counter() - started)
        if sight.reason is not None:
            # One reason whatever its numbers; those in brackets belong to the name of an equation.
            self.refusals[_NUMBER.sub("#", sight.reason)] += 1
        return sight

    def ms(self, percent: float) -> float | None:
        """Return a percentile of the time per frame."""
        return 1e3 * float(np.percentile(np.array(self._spent_s), percent)) if self._spent_s else None
