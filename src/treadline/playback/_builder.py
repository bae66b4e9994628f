"""Builder of a recording from the signals of a run: a ``Sink`` of a running one, or a reader of a log.

A run arrives in parts: ``signals -> SignalCollector -> Signals -> RecordingBuilder -> Recording``. The recording does not depend on
how it is divided.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.core.ports import Truth
from treadline.core.rotations import attitude_of, rotation_of
from treadline.core.signals import (
    ROUNDING_S,
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
from treadline.core.slip import slower_belt_m_s
from treadline.io.messages import TRUTH_NAMES
from treadline.playback._recording import (
    GUARD,
    SAMPLED,
    WIDTHS,
    Limits,
    PerceivedStair,
    Recording,
    ahead_of,
    phases_of,
    slip_of,
)
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Scenario

COLUMNS: dict[type, tuple[str, ...]] = {
    Truth: ("t_s", *TRUTH_NAMES),
    HeadingEstimate: ("t_s", "heading_rad", "sigma_rad"),
    TrackCommand: ("t_s", "left_m_s", "right_m_s"),
    TrackReading: ("t_s", "left_m_s", "right_m_s"),
    SeatReading: ("t_s", "pitch_rad"),
    FlipperReading: ("t_s", "angle_rad", "torque_n_m"),
    ImuSample: ("t_s", "w", "x", "y", "z", "pitch_rate_rad_s"),
}
"""Numbers that a recording needs of each signal; of the IMU, orientation and rate about y."""
SENSORS = (TrackReading, SeatReading, ImuSample)
"""Signals that count only without ground truth."""
HELD = {
    "estimate_rad": (HeadingEstimate, (1,)),
    "sigma_rad": (HeadingEstimate, (2,)),
    "command_m_s": (TrackCommand, (1, 2)),
    "flipper_rad": (FlipperReading, (1,)),
    "flipper_n_m": (FlipperReading, (2,)),
}
"""Quantities that keep their value until the next signal, with the columns of that signal."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Signals:
    """Signals of a part of a run, as far as a recording holds them."""

    rows: dict[type, Float[np.ndarray, "n c"]] = field(default_factory=dict)
    """Numbers of each signal, in the order of ``COLUMNS``."""
    events: list[Event] = field(default_factory=list)
    maps: list[tuple[StairMap, float]] = field(default_factory=list)
    """Stair maps, each with the time at which the mission took it [s]."""
    frames_t_s: list[float] = field(default_factory=list)
    """Exposure times of camera images [s]."""

    @property
    def is_empty(self) -> bool:
        """Whether nothing was collected."""
        return not (self.rows or self.events or self.maps or self.frames_t_s)


class SignalCollector:
    """Sink of a run that collects its signals; ``take`` returns those since the last call."""

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._rows: dict[type, list[tuple[float, ...]]] = {kind: [] for kind in COLUMNS}
        self._others = Signals()

    def __call__(self, signal: Any, taken_s: float | None = None) -> None:
        """Take one signal; kinds that a recording does not hold are ignored."""
        match signal:
            case ImuSample():
                rate_rad_s = signal.angular_velocity_rad_s[1]
                self._rows[ImuSample].append((signal.t_s, *signal.orientation, rate_rad_s))
            case Event():
                self._others.events.append(signal)
            case StairMap():
                self._others.maps.append((signal, signal.t_s if taken_s is None else taken_s))
            case RgbdFrame():
                self._others.frames_t_s.append(signal.t_s)
            case _ if type(signal) in COLUMNS:
                self._rows[type(signal)].append(tuple(getattr(signal, name) for name in COLUMNS[type(signal)]))

    def take(self) -> Signals:
        """Return what was collected since the last call."""
        taken = self._others
        taken.rows.update({kind: np.array(rows, dtype=float) for kind, rows in self._rows.items() if rows})
        self._begin()
        return taken


class RecordingBuilder(SignalCollector):
    """Builder of a recording that grows; ``build`` returns all so far and computes only what is new.

    An instance is a sink of ``run.episode.run_episode``: call it with each signal and the time at which it was taken. ``add`` takes
    parts that were collected elsewhere.

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
        super().__init__()
        self._chair, self._scenario, self._seed, self._source = chair, scenario, seed, source
        self.limits = Limits() if limits is None else limits
        """Limits of the run, which may be known later than its first signals."""
        self.exposures_s: Float[np.ndarray, " E"] | None = None
        """Exposure times of all frames that the mission received [s]; None if unknown."""
        self._tables = {kind: GrowingRows(len(names)) for kind, names in COLUMNS.items() if kind is not Truth}
        self._samples = {name: GrowingRows(*([WIDTHS[name]] if name in WIDTHS else [])) for name in SAMPLED}
        self._slower_m = GrowingRows()
        self._has_truth, self._has_poses = False, True
        self._stale_s = math.inf
        self._events: list[Event] = []
        self._waiting_maps: list[tuple[StairMap, float]] = []
        self._maps: list[PerceivedStair] = []
        self._frames_t_s: list[float] = []

    def add(self, part: Signals) -> None:
        """Append a part of the run."""
        for kind, rows in part.rows.items():
            if kind is Truth:
                self._add_truth(rows)
            elif kind not in SENSORS or not self._has_truth:
                self._tables[kind].extend(rows)
                self._stale_s = min(self._stale_s, float(rows[:, 0].min(initial=math.inf)))
        self._events += part.events
        self._waiting_maps += part.maps
        self._frames_t_s += part.frames_t_s

    def build(self, *, verdict: str | None = None, cause: str | None = None) -> Recording:
        """Return the recording of all signals so far.

        Args:
            verdict: Verdict of the run.
            cause: Cause of the verdict.
        """
        self.add(self.take())
        if not self._has_truth:
            self._sample_sensors()
        self._hold()
        samples = {name: column.rows for name, column in self._samples.items()}
        return Recording(
            **samples,
            source=self._source,
            events=tuple(self._events),
            phases=phases_of(self._events, float(samples["t_s"][-1]) if len(samples["t_s"]) else 0.0),
            maps=self._perceive(samples["t_s"], samples["p_WB"], samples["quat_WB"]),
            frames_t_s=np.array(self._frames_t_s, dtype=float),
            exposures_s=self.exposures_s,
            chair=self._chair,
            scenario=self._scenario,
            seed=self._seed,
            verdict=verdict,
            cause=cause,
            limits=self.limits,
            missing=self._missing(),
        )

    def _missing(self) -> tuple[str, ...]:
        missing = []
        if not self._has_truth and len(self._samples["t_s"].rows):
            missing.append("The log holds no ground truth: the chair is drawn where its belts and its inertial sensor put it.")
        if not self._has_poses:
            missing.append("The log was written before logs kept the chair's pose: the scene is not drawn; make the run again.")
        if self._scenario is None:
            missing.append("The log comes without a scenario: the stair is unknown (chair: the robot file's, or the default).")
        return tuple(missing)

    def _add_truth(self, rows: Float[np.ndarray, "n c"]) -> None:
        """Append the samples of ground truth; quantities that are held follow in ``_hold``."""
        if not self._has_truth:
            self._clear()
        self._has_truth = True
        column = {name: rows[:, k] for k, name in enumerate(COLUMNS[Truth])}
        pitch, roll, seat_pitch = column["pitch_rad"], column["roll_rad"], column["seat_pitch_rad"]
        first = len(self._samples["t_s"].rows)
        p_WB = np.column_stack([column[f"chassis_{axis}_m"] for axis in "xyz"])
        self._has_poses = self._has_poses and bool(np.isfinite(p_WB).all())
        self._extend(
            t_s=column["t_s"],
            p_WB=p_WB,
            quat_WB=attitude_of(column["yaw_rad"], pitch, roll),
            seat_rad=seat_angle_of(pitch, roll, seat_pitch),
            belt_m_s=np.column_stack([column["left_m_s"], column["right_m_s"]]),
            belt_force_n=np.column_stack([column["left_force_n"], column["right_force_n"]]),
            heading_rad=column["heading_rad"],
            pitch_rad=pitch,
            pitch_rate_rad_s=column["pitch_rate_rad_s"],
            seat_pitch_rad=seat_pitch,
            margin_rad=column["stability_margin_rad"],
            friction_use=column["friction_use"],
            passenger_W=np.column_stack([column[f"passenger_{axis}_m"] for axis in "xyz"]),
            place_S=np.column_stack([column["x_m"], column["y_m"]]),
        )
        self._drive(first)

    def _sample_sensors(self) -> None:
        """Replace all samples by what sensors alone give, at the times of the most frequent one.

        The place is that of dead reckoning, from the origin, which says nothing of slip.
        """
        t_s = np.unique(max((table.rows[:, 0] for table in self._tables.values()), key=len))
        imu = self._tables[ImuSample].rows
        pitch_rad = np.arcsin(np.clip(ahead_of(imu[:, 1:5])[:, 2], -1.0, 1.0))
        turn = np.column_stack([imu[:, 0], pitch_rad, -imu[:, 5]])
        pitch, seat_pitch = held(t_s, turn, 1), held(t_s, self._tables[SeatReading].rows, 1)
        belts = self._tables[TrackReading].rows
        belt_m_s = np.column_stack([held(t_s, belts, 1), held(t_s, belts, 2)])
        poses = _reckoned(t_s, belt_m_s, imu) if len(imu) else {}
        self._clear()
        self._extend(
            t_s=t_s,
            **poses,
            seat_rad=np.nan_to_num(pitch - seat_pitch),
            belt_m_s=belt_m_s,
            pitch_rad=pitch,
            pitch_rate_rad_s=held(t_s, turn, 2),
            seat_pitch_rad=seat_pitch,
        )
        self._drive(0)

    def _clear(self) -> None:
        for column in self._samples.values():
            column.resize(0)

    def _extend(self, **known: Float[np.ndarray, "n ..."]) -> None:
        """Append samples of the given quantities; every other one is unknown."""
        count = len(self._samples["t_s"].rows) + len(known["t_s"])
        self._stale_s = min(self._stale_s, float(known["t_s"].min(initial=math.inf)))
        for name, column in self._samples.items():
            if name in known:
                column.extend(known[name])
            else:
                column.resize(count)

    def _drive(self, first: int) -> None:
        """Compute belt travel and slip ratio of the samples from ``first`` on."""
        samples = {name: column.rows for name, column in self._samples.items()}
        t_s, before = samples["t_s"], max(first - 1, 0)
        self._slower_m.resize(len(t_s))
        speeds = np.nan_to_num(samples["belt_m_s"][before:])
        slower = [slower_belt_m_s(left, right) for left, right in speeds.tolist()]
        dt_s = np.diff(t_s[before:], prepend=t_s[before : before + 1])
        for travel_m, speed in ((samples["belt_travel_m"], speeds), (self._slower_m.rows[:, None], np.reshape(slower, (-1, 1)))):
            steps = speed * dt_s[:, None]
            steps[:1] = travel_m[before] if first else 0.0
            travel_m[before:] = np.cumsum(steps, axis=0)
        seen = int(np.searchsorted(t_s, t_s[first] - 2.0 * GUARD["lasting_s"])) if first < len(t_s) else first
        p_WB, quat_WB, heading_rad = (samples[name][seen:] for name in ("p_WB", "quat_WB", "heading_rad"))
        slip = slip_of(t_s[seen:], p_WB, quat_WB, self._slower_m.rows[seen:], heading_rad)
        samples["slip"][first:] = slip[first - seen :]

    def _hold(self) -> None:
        """Update the quantities that keep the value of the last signal, from the earliest new stamp on."""
        t_s = self._samples["t_s"].rows
        first = int(np.searchsorted(t_s, self._stale_s - 2.0 * ROUNDING_S))
        for name, (kind, columns) in HELD.items():
            table = self._tables[kind].rows
            values = np.column_stack([held(t_s[first:], table, k) for k in columns])
            self._samples[name].rows[first:] = values if name in WIDTHS else values[:, 0]
        flipper = self._samples["flipper_rad"].rows[first:]
        flipper[np.isnan(flipper)] = self._chair.tracks.approach_angle_deg * DEG
        self._stale_s = math.inf

    def _perceive(
        self, t_s: Float[np.ndarray, " T"], p_WB: Float[np.ndarray, "T 3"], quat_WB: Float[np.ndarray, "T 4"]
    ) -> tuple[PerceivedStair, ...]:
        """Return the stair maps with nosings placed by the pose at their exposure; one before the first sample is left out."""
        waiting, self._waiting_maps = self._waiting_maps, []
        found = list(self._maps)
        for seen, taken_s in waiting:
            is_final = self._has_truth and seen.t_s <= t_s[-1]  # else the pose at the exposure may not be known yet
            if not is_final:
                self._waiting_maps.append((seen, taken_s))
            if not len(t_s) or seen.t_s < t_s[0] - TICK_S:
                continue
            k = int(np.clip(np.searchsorted(t_s, seen.t_s + 0.5 * TICK_S, side="right") - 1, 0, len(t_s) - 1))
            nosings_B = np.array(seen.nosings_B).reshape(-1, 3)
            nosings_W = nosings_B @ rotation_of(quat_WB[k]).T + p_WB[k]
            placed = PerceivedStair(t_s=seen.t_s, taken_s=taken_s, nosings_B=nosings_B, nosings_W=nosings_W, ends=seen.ends)
            found.append(placed)
            if is_final:
                self._maps.append(placed)
        return tuple(found)


def _reckoned(
    t_s: Float[np.ndarray, " T"], belt_m_s: Float[np.ndarray, "T 2"], imu: Float[np.ndarray, "n 6"]
) -> dict[str, Float[np.ndarray, "T ..."]]:
    """Return place and attitude by dead reckoning: the mean belt speed along the x axis that the IMU measures.

    Args:
        t_s: Times of the samples.
        belt_m_s: Belt speeds; unknown ones count as zero.
        imu: Rows of ``COLUMNS``, at least one; the first holds before it too.
    """
    quat_WB = imu[np.maximum(np.searchsorted(imu[:, 0], t_s + ROUNDING_S, side="right") - 1, 0), 1:5]
    steps_m = np.nan_to_num(belt_m_s).mean(axis=1) * np.diff(t_s, prepend=t_s[:1])
    return {"p_WB": np.cumsum(steps_m[:, None] * ahead_of(quat_WB), axis=0), "quat_WB": quat_WB}


class GrowingRows:
    """Rows of numbers that grow; the memory doubles when it is full.

    Args:
        width: Numbers of a row; none for a row of one number.
    """

    def __init__(self, *width: int) -> None:
        self._memory, self._count = np.empty((0, *width)), 0

    @property
    def rows(self) -> Float[np.ndarray, "n ..."]:
        """View of all rows."""
        return self._memory[: self._count]

    def extend(self, rows: Float[np.ndarray, "n ..."]) -> None:
        """Append rows."""
        first = self._count
        self.resize(first + len(rows))
        self._memory[first : self._count] = rows

    def resize(self, count: int) -> None:
        """Set the number of rows; new ones are unknown (NaN)."""
        if count > len(self._memory):
            grown = np.empty((max(count, 2 * len(self._memory)), *self._memory.shape[1:]))
            grown[: self._count] = self.rows
            self._memory = grown
        self._memory[self._count : count] = math.nan
        self._count = count


def held(t_s: Float[np.ndarray, " T"], table: Float[np.ndarray, "n c"], column: int) -> Float[np.ndarray, " T"]:
    """Return the last value of a column at or before each time; NaN before the first."""
    if not len(table):
        return np.full(len(t_s), math.nan)
    at = np.searchsorted(table[:, 0], t_s + ROUNDING_S, side="right") - 1
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
