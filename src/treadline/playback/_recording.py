"""Recording of a run: poses, joint positions, signals, events and phases on one time grid.

The one type of a run, complete or still growing. Frames as in ``signals``: W world, B chair. A quantity without data is NaN;
``Recording.missing`` gives the reason as a sentence.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, get_args

import numpy as np
from jaxtyping import Float, Int, Shaped

from treadline.core.signals import ROUNDING_S, Event, Phase
from treadline.core.slip import DRIVEN_LEAST_M, slip_ratio
from treadline.guard import GuardConfig
from treadline.scenario.chair import GRAVITY_M_S2, ChairDescription
from treadline.scenario.scenario import Scenario
from treadline.vehicle.staircase import Staircase, build_staircase
from treadline.vehicle.tip_over_margin import MARGIN_LIMIT_RAD

PHASES = get_args(Phase)
"""Names of the events that begin a phase."""
GUARD: Mapping[str, Any] = {item.name: item.default for item in fields(GuardConfig)}
"""Limits of the guard that are the same for all chairs, by name."""

FORMER = {"square_rad": "max_heading_error_rad", "deviation": "slip"}
"""Names of two limits in runs of version 0.3 and before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits of a run that plots and texts show, by the guard's names; None where the run does not state the limit."""

    margin_rad: float | None = MARGIN_LIMIT_RAD
    """Least accepted tip-over margin [rad]."""
    pitch_rate_rad_s: float | None = None
    """Pitch rate beyond which the guard holds [rad/s]."""
    belt_limit_m_s: float | None = None
    """Largest speed of one belt [m/s]."""
    square_rad: float | None = None
    """Largest heading error over crest and edge [rad]."""
    deviation: float | None = None
    """Slip ratio beyond which the guard restricts the speed."""
    roll_back_m: float | None = None
    """Roll-back beyond which the guard holds [m]."""
    seat_rad: float | None = None
    """Deviation of the seat from horizontal beyond which the guard holds [rad]."""

    @classmethod
    def of_guard(cls, guard: Mapping[str, Any]) -> "Limits":
        """Return the limits from the guard's configuration as kept in ``manifest.json``, or from ``asdict(GuardConfig)``."""
        found = {item.name: guard.get(item.name, guard.get(FORMER.get(item.name, ""))) for item in fields(cls)}
        return cls(**{name: float(value) for name, value in found.items() if isinstance(value, int | float)})


@dataclass(frozen=True, slots=True, kw_only=True)
class PhaseSpan:
    """Phase of the traversal with its start, end and cause."""

    start_s: float
    end_s: float
    name: str
    cause: str


def phases_of(events: Sequence[Event], end_s: float) -> tuple[PhaseSpan, ...]:
    """Return the phases that events begin; the last one lasts to ``end_s``, the time of the last sample [s]."""
    entered = [event for event in events if event.name in PHASES]
    ends = [*(event.t_s for event in entered[1:]), max(end_s, entered[-1].t_s if entered else end_s)]
    return tuple(
        PhaseSpan(start_s=event.t_s, end_s=end, name=event.name, cause=event.cause)
        for event, end in zip(entered, ends, strict=False)
    )


def phases_at(t_s: Float[np.ndarray, " T"], starts: Sequence[tuple[float, str]]) -> Shaped[np.ndarray, " T"]:
    """Return the name of the phase at each time; empty before the first.

    Args:
        starts: Start [s] and name of each phase, in order of time.
    """
    names = np.array(["", *(name for _, name in starts)])
    return np.asarray(names[np.searchsorted([start_s for start_s, _ in starts], t_s, side="right")])


def ahead_of(quat_WB: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3"]:
    """Return the direction of B's x axis in W, the first column of the rotation matrix."""
    w, x, y, z = quat_WB.T
    return np.column_stack([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)])


def slip_of(
    t_s: Float[np.ndarray, " n"],
    p_WB: Float[np.ndarray, "n 3"],
    quat_WB: Float[np.ndarray, "n 4"],
    slower_m: Float[np.ndarray, " n"],
    heading_rad: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """Return the slip ratio over the last half second as the guard defines it; NaN where the guard does not judge it.

    It judges a chair that is square and does not turn, and whose slower belt moves.

    Args:
        slower_m: Integral of the slower belt's speed [m].
        heading_rad: True heading.
    """
    before = np.searchsorted(t_s, t_s - GUARD["lasting_s"] - ROUNDING_S)
    driven_m = slower_m - slower_m[before]
    gone_m = ((p_WB - p_WB[before]) * ahead_of(quat_WB)).sum(axis=1)
    then_rad = heading_rad[before]
    is_square = np.maximum(np.abs(heading_rad), np.abs(then_rad)) <= GUARD["square_rad"]
    is_straight = is_square & (np.abs(heading_rad - then_rad) <= GUARD["slip_turn_rad"])
    judged = is_straight & (np.abs(driven_m) >= DRIVEN_LEAST_M)
    return np.where(judged, slip_ratio(driven_m - gone_m, np.where(judged, driven_m, 1.0)), np.nan)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PerceivedStair:
    """Nosings perceived in one frame."""

    t_s: float
    """Exposure time of the frame [s]."""
    taken_s: float
    """Time at which the mission took the result [s]."""
    nosings_B: Float[np.ndarray, "n 3"]
    """Intersections of the nosings with the chair's middle plane [m]."""
    nosings_W: Float[np.ndarray, "n 3"]
    """The same points in W, by the true pose at ``t_s``; NaN without ground truth."""
    ends: bool
    """Whether the last nosing is the last of the flight."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """One run up to its end or up to now, on a uniform time grid: that of the ground truth (100 Hz) if the log has any.

    Of a run in progress the arrays are views of the builder's memory. Samples of the latest instants may still change, because a
    signal counts from its stamp and arrives later.
    """

    source: str
    """Path or name of the run."""
    t_s: Float[np.ndarray, " T"]
    p_WB: Float[np.ndarray, "T 3"]
    """Position of B in W [m]."""
    quat_WB: Float[np.ndarray, "T 4"]
    """Attitude of B in W as unit quaternions (w, x, y, z)."""
    seat_rad: Float[np.ndarray, " T"]
    """Forward angle of the seat relative to the chassis [rad], as ``appearance.body_poses`` takes it."""
    flipper_rad: Float[np.ndarray, " T"]
    """Angle of the flipper above the flat run [rad]; the approach angle of a chair without one."""
    flipper_n_m: Float[np.ndarray, " T"]
    """Torque of the flipper's motor [N m], positive raises."""
    belt_m_s: Float[np.ndarray, "T 2"]
    """Belt speeds left and right [m/s]: ground truth, else as reported by the drives."""
    belt_travel_m: Float[np.ndarray, "T 2"]
    """Distance travelled by each belt's surface since the start [m]."""
    belt_force_n: Float[np.ndarray, "T 2"]
    """Traction of the belts left and right, forward positive [N]."""
    slip: Float[np.ndarray, " T"]
    """Slip ratio by ground truth, as the guard defines it, see ``slip_of``."""
    command_m_s: Float[np.ndarray, "T 2"]
    """Commanded belt speeds [m/s]."""
    heading_rad: Float[np.ndarray, " T"]
    """True heading [rad]."""
    estimate_rad: Float[np.ndarray, " T"]
    """Estimated heading [rad]."""
    sigma_rad: Float[np.ndarray, " T"]
    """Standard deviation of the estimate [rad]."""
    pitch_rad: Float[np.ndarray, " T"]
    pitch_rate_rad_s: Float[np.ndarray, " T"]
    seat_pitch_rad: Float[np.ndarray, " T"]
    """Pitch of the seat from horizontal [rad]."""
    margin_rad: Float[np.ndarray, " T"]
    """Smallest tip-over margin [rad]."""
    friction_use: Float[np.ndarray, " T"]
    """Required fraction of the friction circle; the chair slides at 1."""
    passenger_W: Float[np.ndarray, "T 3"]
    """Centre of mass of the payload in W [m]."""
    place_S: Float[np.ndarray, "T 2"]
    """Position along and across the stair [m]."""
    events: tuple[Event, ...]
    phases: tuple[PhaseSpan, ...]
    maps: tuple[PerceivedStair, ...]
    frames_t_s: Float[np.ndarray, " F"]
    """Exposure times of the camera images in the log [s]; ``read_frames`` returns them."""
    chair: ChairDescription
    exposures_s: Float[np.ndarray, " E"] | None = None
    """Exposure times of all frames that the mission received, with or without a stair [s]; None if unknown."""
    scenario: Scenario | None = None
    """Scenario of the run; None for a log on its own, which does not say on which stair the chair drove."""
    seed: int = 0
    verdict: str | None = None
    cause: str | None = None
    limits: Limits = field(default_factory=Limits)
    missing: tuple[str, ...] = ()
    """Sentences about what the log does not hold."""

    @classmethod
    def of_curves(cls, t_s: Float[np.ndarray, " T"], chair: ChairDescription, **known: Any) -> "Recording":
        """Return a recording of the given fields; every other quantity is unknown."""
        n = len(t_s)
        unknown = {name: np.full((n, WIDTHS[name]) if name in WIDTHS else n, np.nan) for name in SAMPLED if name != "t_s"}
        rest: dict[str, Any] = {"events": (), "phases": (), "maps": (), "frames_t_s": np.empty(0), "source": ""}
        return cls(t_s=t_s, chair=chair, **{**unknown, **rest, **known})

    @property
    def duration_s(self) -> float:
        """Time of the last sample [s]."""
        return float(self.t_s[-1]) if len(self.t_s) else 0.0

    @property
    def outcome(self) -> str | None:
        """Verdict with its cause; None while the run lasts, and without a verdict."""
        return self.verdict if self.verdict is None or not self.cause else f"{self.verdict}: {self.cause}"

    @property
    def has_poses(self) -> bool:
        """Whether the chair can be drawn in the world."""
        return len(self.t_s) > 0 and bool(np.isfinite(self.p_WB).all())

    @property
    def is_reckoned(self) -> bool:
        """Whether the chair's place is that of dead reckoning, because nobody knows the true one."""
        return bool(np.isnan(self.heading_rad).all())

    @property
    def staircase(self) -> Staircase | None:
        """Staircase of the run with its jitter, or None if the scenario is unknown."""
        return None if self.scenario is None else staircase_of(self.scenario, self.seed)

    @property
    def columns(self) -> dict[str, Float[np.ndarray, " T"]]:
        """What was driven, by the names of ``Walk.columns``, with the least margin; angles in degrees.

        The torque is that with which the ground turns the flipper up: its own weight less what its motor bears.
        """
        chair, level_rad = self.chair, self.pitch_rad + self.flipper_rad
        own_n = 0.0 if chair.flipper is None else chair.flipper.mass_kg * GRAVITY_M_S2
        lever_m = 0.5 * chair.tracks.approach_m
        columns = {"t_s": self.t_s, "x_m": self.p_WB[:, 0], "z_m": self.p_WB[:, 2]}
        angles = {
            "pitch_deg": self.pitch_rad,
            "flipper_deg": self.flipper_rad,
            "rate_deg_s": np.abs(self.pitch_rate_rad_s),
            "margin_deg": self.margin_rad,
        }
        columns["torque_n_m"] = own_n * lever_m * np.cos(level_rad) - self.flipper_n_m
        return columns | {name: np.degrees(values) for name, values in angles.items()}

    def index_at(self, t_s: float) -> int:
        """Return the index of the last sample at or before a time."""
        return int(np.clip(np.searchsorted(self.t_s, t_s + 1e-9, side="right") - 1, 0, max(len(self.t_s) - 1, 0)))

    def phase_at(self, t_s: float) -> PhaseSpan | None:
        """Return the phase at a time, or None before the first."""
        return next((span for span in reversed(self.phases) if span.start_s <= t_s + 1e-9), None)

    def sampled(self, index: Int[np.ndarray, " k"], t_s: Float[np.ndarray, " k"]) -> "Recording":
        """Return the recording with the samples of an index, at new times [s]."""
        kept: dict[str, Any] = {item.name: getattr(self, item.name)[index] for item in fields(self) if item.name in SAMPLED}
        return replace(self, **{**kept, "t_s": t_s})


WIDTHS = {
    "p_WB": 3, "quat_WB": 4, "belt_m_s": 2, "belt_travel_m": 2, "belt_force_n": 2, "command_m_s": 2, "passenger_W": 3, "place_S": 2,
}  # fmt: skip
"""Numbers per sample of the fields that have more than one."""
SAMPLED = tuple(
    item.name for item in fields(Recording) if "ndarray" in str(item.type) and item.name not in ("frames_t_s", "exposures_s")
)
"""Fields with one row per sample."""


def staircase_of(scenario: Scenario, seed: int) -> Staircase:
    """Return the staircase of a run with its jitter, which the plants draw from the first stream of the run's seed."""
    return build_staircase(scenario.stair, np.random.default_rng(seed).spawn(1)[0], scenario.step, scenario.sill)
