"""Builder of a recording from the signals of a run: a ``Sink`` of a live run, or a reader of a log."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG, attitude_of
from treadline.core.errors import LogFormatError
from treadline.core.images import RgbdFrame
from treadline.core.ports import Truth
from treadline.core.signals import (
    TICK_S,
    Event,
    FlipperReading,
    HeadingEstimate,
    ImuSample,
    SeatReading,
    StairMap,
    TrackCommand,
    TrackReading,
)
from treadline.io.messages import TRUTH_NAMES
from treadline.playback.recording import Limits, PerceivedStair, Recording, in_world, phases_of
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Scenario

TRUTH_COLUMNS = ("t_s", *TRUTH_NAMES)

COLUMNS: dict[type, tuple[str, ...]] = {
    Truth: TRUTH_COLUMNS,
    HeadingEstimate: ("t_s", "heading_rad", "sigma_rad"),
    TrackCommand: ("t_s", "left_m_s", "right_m_s"),
    TrackReading: ("t_s", "left_m_s", "right_m_s"),
    SeatReading: ("t_s", "pitch_rad", "stroke_m"),
    FlipperReading: ("t_s", "angle_rad"),
}
"""Numbers that the builder keeps of each signal."""


class RecordingBuilder:
    """Collector of signals; ``build`` returns them as a ``Recording``.

    An instance is a sink of ``experiments.traverse.run_episode``: call it with each signal and the time at which it was taken.

    Args:
        chair: Chair of the run.
        scenario: Scenario of the run, if known.
        seed: Random seed of the run: the jitter of the stair follows from it.
        source: Path or name of the run.
        limits: Limits that plots draw.
    """

    def __init__(
        self,
        chair: ChairDescription,
        scenario: Scenario | None = None,
        *,
        seed: int = 0,
        source: str = "",
        limits: Limits | None = None,
    ) -> None:
        self._chair, self._scenario, self._seed, self._source = chair, scenario, seed, source
        self._limits = Limits() if limits is None else limits
        self._rows: dict[type, list[tuple[float, ...]]] = {kind: [] for kind in (*COLUMNS, ImuSample)}
        self._blocks: dict[type, list[Float[np.ndarray, "n c"]]] = {kind: [] for kind in (*COLUMNS, ImuSample)}
        self._events: list[Event] = []
        self._maps: list[tuple[StairMap, float]] = []
        self._frames: list[float] = []

    def __call__(self, signal: Any, taken_s: float | None = None) -> None:
        """Take one signal; kinds that a recording does not hold are ignored."""
        kind = type(signal)
        if kind in COLUMNS:
            self._rows[kind].append(tuple(getattr(signal, name) for name in COLUMNS[kind]))
        elif isinstance(signal, ImuSample):
            self._rows[ImuSample].append((signal.t_s, *signal.orientation.tolist(), float(signal.angular_velocity_rad_s[1])))
        elif isinstance(signal, Event):
            self._events.append(signal)
        elif isinstance(signal, StairMap):
            self._maps.append((signal, signal.t_s if taken_s is None else taken_s))
        elif isinstance(signal, RgbdFrame):
            self._frames.append(signal.t_s)

    def extend(self, kind: type, rows: Float[np.ndarray, "n c"]) -> None:
        """Take many signals of one kind as rows of ``COLUMNS[kind]``; for ``ImuSample``: time, orientation and rate about y."""
        self._blocks[kind].append(rows)

    def add_frames(self, t_s: Sequence[float]) -> None:
        """Take the exposure times of images in the log [s]."""
        self._frames.extend(t_s)

    def build(self, *, verdict: str | None = None, cause: str | None = None, last: int | None = None) -> Recording:
        """Return the recording of all signals so far.

        Args:
            verdict: Verdict of the run.
            cause: Cause of the verdict.
            last: Number of samples at the end to return; None returns all. A live view asks for the latest ones.

        Raises:
            LogFormatError: If no signal gives a time.
        """
        tables = {kind: self._table(kind, last) for kind in self._rows}
        t_s = self._grid(tables)
        n = len(t_s)
        truth = tables[Truth]
        missing: list[str] = []
        p_WB, quat_WB, signals = self._from_truth(truth) if len(truth) else self._without_truth(t_s, tables)
        if not len(truth):
            missing.append("The log holds no ground truth: signals are shown without the chair's place in the world.")
        elif not np.isfinite(p_WB).all():
            missing.append("The log was written before logs kept the chair's pose: the scene is not drawn; make the run again.")
        if self._scenario is None:
            missing.append("The log comes without a manifest.json: the stair is unknown, and so is the chair (drawn: the default).")
        belts = signals.pop("belt_m_s")
        step_s = np.diff(t_s, prepend=t_s[:1])[:, None]
        resting = 0.0 if self._chair.tracks is None else self._chair.tracks.approach_angle_deg * DEG
        flipper = _held(t_s, tables[FlipperReading], 1)
        estimate = tables[HeadingEstimate]
        command = tables[TrackCommand]
        return Recording(
            source=self._source,
            t_s=t_s,
            p_WB=p_WB,
            quat_WB=quat_WB,
            flipper_rad=np.where(np.isfinite(flipper), flipper, resting),
            belt_m_s=belts,
            belt_travel_m=np.cumsum(np.nan_to_num(belts) * step_s, axis=0),
            command_m_s=np.column_stack([_held(t_s, command, 1), _held(t_s, command, 2)]).reshape(n, 2),
            estimate_rad=_held(t_s, estimate, 1),
            sigma_rad=_held(t_s, estimate, 2),
            events=tuple(self._events),
            phases=phases_of(self._events, float(t_s[-1])),
            maps=self._perceived(t_s, p_WB, quat_WB),
            frames_t_s=np.array(self._frames, dtype=float),
            chair=self._chair,
            scenario=self._scenario,
            seed=self._seed,
            verdict=verdict,
            cause=cause,
            limits=self._limits,
            missing=tuple(missing),
            **signals,
        )

    def _table(self, kind: type, last: int | None) -> Float[np.ndarray, "n c"]:
        width = 6 if kind is ImuSample else len(COLUMNS[kind])
        rows = self._rows[kind] if last is None else self._rows[kind][-last:]
        parts = [*self._blocks[kind], np.array(rows, dtype=float).reshape(-1, width)]
        table = np.concatenate(parts) if len(parts) > 1 else parts[0]
        return table if last is None else table[-last:]

    def _grid(self, tables: dict[type, Float[np.ndarray, "n c"]]) -> Float[np.ndarray, " T"]:
        """Return the times of the ground truth, else of the most frequent sensor."""
        if len(tables[Truth]):
            return tables[Truth][:, 0]
        others = [table[:, 0] for table in tables.values() if len(table)]
        if not others:
            raise LogFormatError(
                f"{self._source or 'the log'}: no signals to play: a log needs ground truth, belts, IMU or a heading estimate; "
                "treadline climb and treadline record write such logs"
            )
        longest = max(others, key=len)
        return np.unique(longest)

    def _from_truth(
        self, rows: Float[np.ndarray, "T c"]
    ) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"], dict[str, Float[np.ndarray, "T ..."]]]:
        column = {name: rows[:, k] for k, name in enumerate(TRUTH_COLUMNS)}
        pitch, roll, seat_pitch = column["pitch_rad"], column["roll_rad"], column["seat_pitch_rad"]
        p_WB = np.column_stack([column[f"chassis_{axis}_m"] for axis in "xyz"])
        signals = {
            "seat_rad": seat_angle_of(pitch, roll, seat_pitch),
            "belt_m_s": np.column_stack([column["left_m_s"], column["right_m_s"]]),
            "heading_rad": column["heading_rad"],
            "pitch_rad": pitch,
            "pitch_rate_rad_s": column["pitch_rate_rad_s"],
            "seat_pitch_rad": seat_pitch,
            "margin_rad": column["stability_margin_rad"],
            "friction_use": column["friction_use"],
            "passenger_W": np.column_stack([column[f"passenger_{axis}_m"] for axis in "xyz"]),
            "place_S": np.column_stack([column["x_m"], column["y_m"]]),
        }
        return p_WB, attitude_of(column["yaw_rad"], pitch, roll), signals

    def _without_truth(
        self, t_s: Float[np.ndarray, " T"], tables: dict[type, Float[np.ndarray, "n c"]]
    ) -> tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"], dict[str, Float[np.ndarray, "T ..."]]]:
        """Return what sensors alone give: belt speeds, pitch and its rate, and the seat's pitch."""
        n = len(t_s)
        unknown = np.full(n, math.nan)
        belts, seat, imu = tables[TrackReading], tables[SeatReading], tables[ImuSample]
        pitch = np.column_stack([imu[:, 0], np.arcsin(np.clip(2.0 * (imu[:, 2] * imu[:, 4] - imu[:, 1] * imu[:, 3]), -1.0, 1.0))])
        pitch_rad, seat_pitch = _held(t_s, pitch, 1), _held(t_s, seat, 1)
        signals = {
            "seat_rad": np.nan_to_num(pitch_rad - seat_pitch),
            "belt_m_s": np.column_stack([_held(t_s, belts, 1), _held(t_s, belts, 2)]),
            "heading_rad": unknown,
            "pitch_rad": pitch_rad,
            "pitch_rate_rad_s": -_held(t_s, imu, 5),
            "seat_pitch_rad": seat_pitch,
            "margin_rad": unknown,
            "friction_use": unknown,
            "passenger_W": np.full((n, 3), math.nan),
            "place_S": np.full((n, 2), math.nan),
        }
        return np.full((n, 3), math.nan), np.full((n, 4), math.nan), signals

    def _perceived(
        self, t_s: Float[np.ndarray, " T"], p_WB: Float[np.ndarray, "T 3"], quat_WB: Float[np.ndarray, "T 4"]
    ) -> tuple[PerceivedStair, ...]:
        found = []
        for seen, taken_s in self._maps:
            if seen.t_s < t_s[0] - TICK_S:
                continue  # a live view asked for the last samples only
            k = int(np.clip(np.searchsorted(t_s, seen.t_s + 0.5 * TICK_S, side="right") - 1, 0, len(t_s) - 1))
            nosings_W = in_world(seen.nosings_B, p_WB[k], quat_WB[k])
            found.append(
                PerceivedStair(t_s=seen.t_s, taken_s=taken_s, nosings_B=seen.nosings_B, nosings_W=nosings_W, ends=seen.ends)
            )
        return tuple(found)


def _held(t_s: Float[np.ndarray, " T"], table: Float[np.ndarray, "n c"], column: int) -> Float[np.ndarray, " T"]:
    """Return the last value of a column at or before each time; NaN before the first."""
    if not len(table):
        return np.full(len(t_s), math.nan)
    at = np.searchsorted(table[:, 0], t_s + 1e-9, side="right") - 1
    return np.where(at >= 0, table[np.maximum(at, 0), column], math.nan)


def seat_angle_of(
    pitch_rad: Float[np.ndarray, " T"], roll_rad: Float[np.ndarray, " T"], seat_pitch_rad: Float[np.ndarray, " T"]
) -> Float[np.ndarray, " T"]:
    """Return the forward angle of the seat relative to the chassis [rad]; zero without a seat linkage (NaN as seat pitch).

    The seat turns about B's y axis: its elevation is that of a vector in the plane of B's x and z axes, which are elevated by
    ``sin(pitch)`` and ``up_z``; solved for the angle.
    """
    up_z = np.sqrt(np.maximum(1.0 - np.sin(pitch_rad) ** 2 - np.sin(roll_rad) ** 2, 0.0))
    reach = np.hypot(np.sin(pitch_rad), up_z)
    return np.nan_to_num(np.arctan2(np.sin(pitch_rad), up_z) - np.arcsin(np.clip(np.sin(seat_pitch_rad) / reach, -1.0, 1.0)))
