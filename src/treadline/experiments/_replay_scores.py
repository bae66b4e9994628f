"""Scores of a replay: differences to the recorded signals, and to ground truth where a simulator wrote the log.

The mission receives none of these signals. Recorded signals are buffered for one second at most.
"""

import math
import re
from array import array
from collections import Counter, defaultdict, deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG, wrap
from treadline.core.arrays import rms
from treadline.core.camera_images import RgbdFrame
from treadline.core.ports import Truth
from treadline.core.signals import (
    ROUNDING_S,
    TICK_S,
    Event,
    HeadingEstimate,
    HeadingMeasurement,
    Recent,
    SeatCommand,
    SeatReading,
    TrackCommand,
)
from treadline.mission import Detection
from treadline.mission.loop import Signal, Tick
from treadline.run.recorded_run import PLAIN_SERIES, SERIES
from treadline.run.run_scores import settling_time
from treadline.vehicle.comfort import STEADY_FROM_S

SAME_S = 0.5 * TICK_S
"""Largest difference of two stamps of the same tick [s]."""


COLUMNS = (
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
"""Columns of ``series.csv``. Columns of ground truth are empty for a log without ground truth."""


@dataclass(slots=True)
class ReplayScores:
    """Comparison of a replay with the recorded signals, tick by tick."""

    ticks: int = 0
    frames: int = 0
    seen: int = 0
    events: list[Event] = field(default_factory=list)
    refusals: Counter[str] = field(default_factory=Counter)
    """Number of frames by the kind of reason for which the detector rejected them."""
    _waiting: dict[type, deque[Any]] = field(default_factory=dict)
    _now: list[HeadingMeasurement] = field(default_factory=list)
    _last: dict[type, Any] = field(default_factory=dict)
    _truths: Recent[Truth] = field(default_factory=Recent)
    _seat_pitch_rad: float = float("nan")
    _columns: dict[str, "array[float]"] = field(default_factory=lambda: {name: array("d") for name in COLUMNS})
    _differences: defaultdict[str, "array[float]"] = field(default_factory=lambda: defaultdict(lambda: array("d")))
    _brakes: int = 0

    def note(self, signal: Signal) -> None:
        """Record a signal that the mission received or published."""
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

    def saw(self, seen: Detection) -> None:
        """Count the reason of a rejected frame without its numbers; a number in brackets is an equation's."""
        sight = getattr(seen, "sight", "of another detector")
        reason = getattr(sight, "reason", None if seen.measurement is not None or sight is None else "no heading")
        if reason is not None:
            self.refusals[re.sub(r"(?<!\()[+-]?\d+(\.\d+)?", "#", reason)] += 1

    def compare_with(self, signal: Any) -> None:
        """Buffer a recorded signal other than a sensor reading, for the comparison at its tick."""
        if isinstance(signal, Event):
            self.events.append(signal)
        else:
            self._waiting.setdefault(type(signal), deque()).append(signal)

    def step(self, tick: Tick) -> Truth | None:
        """Compare one tick; return its ground truth, or None if the log holds none."""
        for kind, waiting in self._waiting.items():
            while waiting and waiting[0].t_s <= tick.t_s + SAME_S:
                self._last[kind] = waiting.popleft()
        truth, recorded = self._at(Truth, tick.t_s), self._at(HeadingEstimate, tick.t_s)
        estimate = tick.estimate
        if estimate is not None and recorded is not None:
            self._differences["recorded"].append(wrap(estimate.heading_rad - recorded.heading_rad))
        if truth is not None:
            if estimate is not None:
                self._differences["estimate"].append(wrap(estimate.heading_rad - truth.heading_rad))
            if recorded is not None:
                self._differences["recorded to truth"].append(wrap(recorded.heading_rad - truth.heading_rad))
            self._truths.add(truth.t_s, truth)
            for seen in self._now:
                exposed = self._truths.at(seen.t_s)
                if exposed is not None and abs(seen.t_s - exposed.t_s) < SAME_S:
                    self._differences["vision"].append(wrap(seen.heading_rad - exposed.heading_rad))
        self._compare_commands(tick)
        self._row(tick, truth)
        self._now.clear()
        self.ticks += 1
        return truth

    def figures(self) -> dict[str, Any]:
        """Return the scores; None where the log holds no reference."""
        of = self._differences
        return self._as_estimated() | {
            "rms_difference_deg": _rms_deg(of["recorded"]),
            "rms_error_deg": _rms_deg(of["estimate"]),
            "recorded_rms_error_deg": _rms_deg(of["recorded to truth"]),
            "vision_rms_error_deg": _rms_deg(of["vision"]),
            "largest_command_gap_m_s": max(map(abs, of["tracks"]), default=None),
            "largest_seat_gap_m_s": max(map(abs, of["seat"]), default=None),
            "commands_compared": len(of["tracks"]) // 2,
            "brakes_differ": self._brakes,
        }

    def _as_estimated(self) -> dict[str, float | None]:
        """Return the scores that need no ground truth, from the replay's heading estimate and the seat readings."""
        t, heading, seat = (np.array(self._columns[name]) for name in ("t_s", "estimate_deg", "seat_pitch_deg"))
        known, level = np.isfinite(heading), seat[np.isfinite(seat)]
        steady = heading[known & (t > STEADY_FROM_S)]
        seen = heading[known]
        return {
            "rms_heading_deg": rms(seen) if seen.size else None,
            "steady_rms_heading_deg": rms(steady) if steady.size else None,
            "settle_s": settling_time(t[known], seen * DEG) if seen.size else None,
            "final_heading_deg": float(seen[-1]) if seen.size else None,
            "max_abs_heading_deg": float(np.abs(seen).max()) if seen.size else None,
            "seat_rms_deg": rms(level) if level.size else None,
            "seat_max_deg": float(np.abs(level).max()) if level.size else None,
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
            self._differences["tracks"].append(tick.tracks.left_m_s - tracks.left_m_s)
            self._differences["tracks"].append(tick.tracks.right_m_s - tracks.right_m_s)
            self._brakes += tracks.brake != tick.tracks.brake
        if seat is not None:
            self._differences["seat"].append(tick.seat.rate_m_s - seat.rate_m_s)

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
        for seen in self._now:
            # A frame that arrives late measures the heading at its exposure.
            row = math.ceil((seen.t_s - ROUNDING_S) / TICK_S)
            if 0 <= row <= self.ticks:
                self._columns["seen_deg"][row] = seen.heading_rad / DEG


def _rms_deg(differences_rad: "array[float]") -> float | None:
    """Return the root mean square [°]; None without differences."""
    return (sum(value * value for value in differences_rad) / len(differences_rad)) ** 0.5 / DEG if differences_rad else None
