"""A recording through perception, fusion, controller and guard again: scores, and a run folder, out.

The mission is the one that drives; its plant is the recording. What the log says of the truth comes here and nowhere else.
"""

import re
import shlex
import time
from array import array
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG, wrap
from treadline.errors import LogFormatError, SettingsError
from treadline.experiments.recorded import PLAIN_SERIES, SERIES
from treadline.experiments.replay_settings import ReplaySettings, resolved
from treadline.experiments.traverse import Watch, mission_config
from treadline.io.mcap_log import RunLog
from treadline.io.runs import LOG, write_manifest, write_result, write_series
from treadline.io.sensor_log import SensorLog
from treadline.mechanics.chair import read_chair
from treadline.mission.config import MissionConfig
from treadline.mission.loop import Mission, Signal, Tick
from treadline.mission.rates import TICK_S
from treadline.mission.replay import ReplayPlant
from treadline.models import read_json
from treadline.perception import DetectorConfig, StairDetector
from treadline.perception.sight import Sight
from treadline.ports import Truth
from treadline.scenario import Scenario
from treadline.settings import settings_of
from treadline.signals import (
    Event,
    HeadingEstimate,
    HeadingMeasurement,
    RgbdFrame,
    SeatCommand,
    SeatReading,
    TrackCommand,
)

CHAIR = "wheelchair"
"""Of a log that comes without a run's manifest."""
MANIFEST = "manifest.json"
SAME_S = 0.5 * TICK_S
"""Two stamps nearer than that belong to the same tick."""
_NUMBER = re.compile(r"(?<!\()[+-]?\d+(\.\d+)?")


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A log, and what is known of the run that wrote it."""

    log: Path
    base: MissionConfig
    sealed: bool = False
    """Whether it is a run's own log, with checksums everywhere."""
    seed: int = 0
    scenario: dict[str, Any] | None = None
    changed: tuple[str, ...] = ()
    """Keys that the run had changed, where it was itself a replay."""
    controller: str | None = None


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
    out.mkdir(parents=True, exist_ok=True)
    write_manifest(out, _manifest(source, settings, recording, (*source.changed, *changes)), source.seed)
    judge = _Judge()
    detector = _Watched(settings.detector)
    try:
        with RunLog(out / LOG, image_every=int(log_images)) as sink:
            started = time.process_time()
            cause, rejected = _play(recording, settings, detector, judge, sink, watch)
            cpu_s = time.process_time() - started
    finally:
        if judge.ticks:
            write_series(out, judge.series())
    run = Replayed(
        verdict="time_up" if cause is None else "held",
        sees="recorded headings" if recording.topics.depth is None else "images",
        values={
            "cause": cause,
            "duration_s": judge.ticks * TICK_S,
            "frames": judge.frames,
            "accepted": judge.seen,
            "rejected": rejected,
            "refusals": dict(detector.refusals.most_common()),
            **judge.figures(),
            "ms_per_frame": detector.ms(50),
            "ms_per_frame_p95": detector.ms(95),
            "real_time_factor": judge.ticks * TICK_S / max(cpu_s, 1e-9),
            "dropped": dict(recording.dropped),
            "topics": asdict(recording.topics),
            "events": [asdict(event) for event in judge.events],
        },
    )
    write_result(out, run.summary())
    return run


def _play(
    recording: SensorLog, settings: ReplaySettings, detector: "_Watched", judge: "_Judge", sink: RunLog, watch: Watch | None
) -> tuple[str | None, int]:
    """Turn the mission until the recording is over; return why it holds, and how many headings the fusion refused."""

    def log(signal: Signal) -> None:
        judge.note(signal)
        sink(signal)

    def aside(signal: Any) -> None:
        judge.compare_with(signal)
        if isinstance(signal, Event):
            sink(signal)

    blocks = settings.blocks(detector)
    plant = ReplayPlant(recording.signals(aside), settings.R_BI)
    mission = Mission(plant, blocks, log)
    while not plant.over:
        tick = mission.tick()
        truth = judge.judge(tick)
        if truth is not None:
            sink(truth)
        if watch is not None:
            watch(tick)
    plant.close()
    return recording.ended or blocks.guard.holding, int(getattr(blocks.estimator, "rejected_count", 0))


def source_of(log: Path) -> Source:
    """Return a log with what its run folder's manifest says of it.

    Raises:
        SettingsError: If the manifest cannot be used.
        LogFormatError: If a run folder holds no log.
    """
    folder = log.parent if log.name == LOG and log.is_file() else log
    if not (folder / MANIFEST).is_file():
        return Source(log=log, base=MissionConfig(chair=read_chair(CHAIR)))
    if not (folder / LOG).is_file():
        raise LogFormatError(f"{folder}: no {LOG} in this run folder; only runs that kept their log can be replayed")
    where = folder / MANIFEST
    manifest = read_json(where)
    settings, seed, command = manifest.get("settings"), manifest.get("seed"), manifest.get("command")
    if not isinstance(settings, dict) or type(seed) is not int:
        raise SettingsError(f"{where}: no 'settings' and 'seed'; replay its {LOG} from a folder without {MANIFEST}")
    scenario: dict[str, Any] | None = settings
    changed: tuple[str, ...] = ()
    base = MissionConfig(chair=read_chair(CHAIR))
    if "replay" in settings:
        scenario, changed = settings.get("scenario"), tuple(str(item) for item in settings.get("set") or ())
    if scenario is not None:
        base = mission_config(settings_of(scenario, Scenario, where=f"{where}: settings"), None)
    return Source(
        log=folder / LOG,
        base=base,
        sealed=True,
        seed=seed,
        scenario=scenario,
        changed=changed,
        controller=_controller(where, str(command)) if "replay" not in settings else None,
    )


def _controller(where: Path, command: str) -> str | None:
    """Return the controller that a run's command line named; another one would not repeat what it did."""
    words = shlex.split(command) if command.count('"') % 2 == command.count("'") % 2 == 0 else command.split()
    for i, word in enumerate(words):
        option, sign, value = word.partition("=")
        if option != "--controller":
            continue
        name = value if sign else [*words, ""][i + 1]
        places = [Path(name), where.parent / name, where.parent.parent / name]
        return str(next((place for place in places if place.is_file()), places[0]))
    return None


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


@dataclass(slots=True)
class _Spread:
    """Differences as they come: their root mean square and the largest."""

    count: int = 0
    squares: float = 0.0
    largest: float = 0.0

    def add(self, difference: float) -> None:
        self.count += 1
        self.squares += difference * difference
        self.largest = max(self.largest, abs(difference))

    @property
    def rms(self) -> float | None:
        return (self.squares / self.count) ** 0.5 if self.count else None

    def rms_deg(self) -> float | None:
        return None if self.rms is None else self.rms / DEG

    def largest_deg(self) -> float | None:
        return self.largest / DEG if self.count else None


_COLUMNS = (
    "t_s",
    "estimate_deg",
    "sigma_deg",
    "seen_deg",
    "recorded_deg",
    "left_m_s",
    "right_m_s",
    "recorded_left_m_s",
    "recorded_right_m_s",
    "seat_pitch_deg",
    *(name for name in (*SERIES, *PLAIN_SERIES) if name not in {"seat_pitch_deg", "left_m_s", "right_m_s"}),
)
"""Of series.csv. Those that only the truth knows are empty where the log has none."""


@dataclass(slots=True)
class _Judge:
    """Compares tick by tick with what was recorded. It holds no more than the second by which the log is ahead."""

    ticks: int = 0
    frames: int = 0
    seen: int = 0
    events: list[Event] = field(default_factory=list)
    _waiting: dict[type, deque[Any]] = field(default_factory=dict)
    _now: list[HeadingMeasurement] = field(default_factory=list)
    _last: dict[type, Any] = field(default_factory=dict)
    _seat_pitch_rad: float = float("nan")
    _columns: dict[str, "array[float]"] = field(default_factory=lambda: {name: array("d") for name in _COLUMNS})
    _to_recorded: _Spread = field(default_factory=_Spread)
    _to_truth: _Spread = field(default_factory=_Spread)
    _recorded_to_truth: _Spread = field(default_factory=_Spread)
    _vision_to_truth: _Spread = field(default_factory=_Spread)
    _normalised: _Spread = field(default_factory=_Spread)
    _tracks: _Spread = field(default_factory=_Spread)
    _seat: _Spread = field(default_factory=_Spread)
    _brakes: int = 0

    def note(self, signal: Signal) -> None:
        """Take what the mission read or decided."""
        match signal:
            case RgbdFrame():
                self.frames += 1
            case HeadingMeasurement():
                self.seen += 1
                self._now.append(signal)
            case SeatReading():
                self._seat_pitch_rad = signal.pitch_rad
            case Event():
                self.events.append(signal)
            case _:
                pass

    def compare_with(self, signal: Any) -> None:
        """Take what was recorded beside the readings."""
        if isinstance(signal, Event):
            self.events.append(signal)
        else:
            self._waiting.setdefault(type(signal), deque()).append(signal)

    def judge(self, tick: Tick) -> Truth | None:
        """Compare one tick; return its truth, if the log knows it."""
        for kind, waiting in self._waiting.items():
            while waiting and waiting[0].t_s <= tick.t_s + SAME_S:
                self._last[kind] = waiting.popleft()
        truth, recorded = self._at(Truth, tick.t_s), self._at(HeadingEstimate, tick.t_s)
        estimate = tick.estimate
        if estimate is not None and recorded is not None:
            self._to_recorded.add(wrap(estimate.heading_rad - recorded.heading_rad))
        if truth is not None:
            if estimate is not None:
                error = wrap(estimate.heading_rad - truth.heading_rad)
                self._to_truth.add(error)
                self._normalised.add(error / max(estimate.sigma_rad, 1e-9))
            if recorded is not None:
                self._recorded_to_truth.add(wrap(recorded.heading_rad - truth.heading_rad))
            for seen in self._now:
                if abs(seen.t_s - tick.t_s) < SAME_S:
                    self._vision_to_truth.add(wrap(seen.heading_rad - truth.heading_rad))
        self._compare_commands(tick)
        self._row(tick, truth)
        self._now.clear()
        self.ticks += 1
        return truth

    def figures(self) -> dict[str, Any]:
        """Return the figures; None where the log has nothing to compare with."""
        nees = self._normalised.rms
        return {
            "rms_difference_deg": self._to_recorded.rms_deg(),
            "largest_difference_deg": self._to_recorded.largest_deg(),
            "rms_error_deg": self._to_truth.rms_deg(),
            "largest_error_deg": self._to_truth.largest_deg(),
            "recorded_rms_error_deg": self._recorded_to_truth.rms_deg(),
            "vision_rms_error_deg": self._vision_to_truth.rms_deg(),
            "vision_largest_error_deg": self._vision_to_truth.largest_deg(),
            "normalised_error_squared": None if nees is None else nees * nees,
            "largest_command_gap_m_s": self._tracks.largest if self._tracks.count else None,
            "largest_seat_gap_m_s": self._seat.largest if self._seat.count else None,
            "commands_compared": self._tracks.count // 2,
            "brakes_differ": self._brakes,
        }

    def series(self) -> dict[str, Float[np.ndarray, " T"]]:
        """Return the columns of ``series.csv``."""
        return {name: np.array(column) for name, column in self._columns.items()}

    def _at(self, kind: type, t_s: float) -> Any | None:
        signal = self._last.get(kind)
        return signal if signal is not None and abs(signal.t_s - t_s) < SAME_S else None

    def _compare_commands(self, tick: Tick) -> None:
        tracks, seat = self._at(TrackCommand, tick.t_s), self._at(SeatCommand, tick.t_s)
        if tracks is not None:
            self._tracks.add(tick.tracks.left_m_s - tracks.left_m_s)
            self._tracks.add(tick.tracks.right_m_s - tracks.right_m_s)
            self._brakes += tracks.brake != tick.tracks.brake
        if seat is not None:
            self._seat.add(tick.seat.rate_m_s - seat.rate_m_s)

    def _row(self, tick: Tick, truth: Truth | None) -> None:
        recorded, command, estimate = self._at(HeadingEstimate, tick.t_s), self._last.get(TrackCommand), tick.estimate
        values: dict[str, float] = {
            "t_s": tick.t_s,
            "left_m_s": tick.tracks.left_m_s,
            "right_m_s": tick.tracks.right_m_s,
            "seat_pitch_deg": self._seat_pitch_rad / DEG,
        }
        if estimate is not None:
            values |= {"estimate_deg": estimate.heading_rad / DEG, "sigma_deg": estimate.sigma_rad / DEG}
        if self._now:
            values["seen_deg"] = self._now[-1].heading_rad / DEG
        if recorded is not None:
            values["recorded_deg"] = recorded.heading_rad / DEG
        if command is not None:
            values |= {"recorded_left_m_s": command.left_m_s, "recorded_right_m_s": command.right_m_s}
        if truth is not None:
            known = {name: getattr(truth, source) / DEG for name, source in SERIES.items()}
            known |= {name: getattr(truth, name) for name in PLAIN_SERIES}
            values = known | values
        for name, column in self._columns.items():
            column.append(values.get(name, float("nan")))
