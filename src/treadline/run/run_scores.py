"""Scores of a run, computed from the simulator's ground truth at 100 Hz, ``t = 0`` included.

The paper scores the heading alone; roll-back, lateral drift and the friction margin are added here.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from operator import attrgetter

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.arrays import rms
from treadline.core.ports import Truth
from treadline.core.printing import Brief
from treadline.core.signals import TICK_S
from treadline.plant.mujoco import TOLERANCE_M_S2
from treadline.playback import phases_at
from treadline.vehicle.comfort import SETTLED_RAD, STEADY_FROM_S, comfort, lasting
from treadline.vehicle.tip_over_margin import MARGIN_LIMIT_RAD

LEVEL_RAD = 4.0 * DEG
"""Pitch up to which the chair counts as level, on the floor or a landing."""
CREEP_FROM_S = 2.0
"""Time after a hold from which creep is measured [s]: the speed ramp of 0.3 s has ended, and rocking on the nosings has decayed."""
CREEP_LEAST_S = 10.0
"""Shortest interval of a creep measurement [s]: at 0.1 mm/min the chair moves 17 µm, far above rounding."""
MARGIN_TICKS = 10
"""Shortest duration of a tip-over margin that counts [ticks]: 0.1 s, in which a chair that is δ beyond its balance turns by
g t²/2h = 0.1 δ with the centre of mass 0.5 m above the edge."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Trace(Brief):
    """Ground truth as columns, one row per 10 ms."""

    columns: dict[str, Float[np.ndarray, " T"]]

    @classmethod
    def of(cls, samples: Sequence[Truth]) -> "Trace":
        """Return the columns of a sequence of samples."""
        names = [item.name for item in fields(Truth)]
        rows = np.array([attrgetter(*names)(sample) for sample in samples], dtype=float)
        rows = rows.reshape(-1, len(names))  # also without samples
        return cls(columns={name: rows[:, i] for i, name in enumerate(names)})

    def __getitem__(self, name: str) -> Float[np.ndarray, " T"]:
        return self.columns[name]


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """Scores of one traversal."""

    duration_s: float
    rms_heading_deg: float
    """RMS heading in the nosing plane over the whole run, turns on landings left out, as in all scores of the heading [°]."""
    rms_yaw_deg: float
    """RMS yaw about gravity over the whole run [°]."""
    steady_rms_heading_deg: float | None
    """RMS heading from 20 s on [°]; None if the run ended before."""
    settle_s: float | None
    """Settling time [s], after which |heading| stays within 2°; None if the run ends outside."""
    final_heading_deg: float
    max_abs_heading_deg: float
    roll_back_m: float
    """Largest distance moved against the direction of travel on the flight [m], from the furthest point reached there before; a
    chair that is set back on a floor or a landing does not roll back."""
    lateral_m: float
    """Largest distance across the flight from the start [m]."""
    climbed_m: float
    seat_rms_deg: float | None
    """RMS of the seat's pitch; None without a seat linkage."""
    seat_max_deg: float | None
    max_pitch_rate_deg_s: float
    """Largest pitch rate, mean over 50 ms [°/s]: faster changes do not move a body."""
    max_pitch_jolt_deg_s: float
    """Largest pitch rate of a single sample [°/s]: a chair that rocks over steps uneven by 2 mm turns by tenths of a degree within
    one sample."""
    min_stability_margin_deg: float
    """Smallest tip-over margin that lasts 0.1 s [°]: the minimum over the run of the maximum of any ten consecutive samples."""
    seconds_below_7_deg: float
    """Time with a tip-over margin below 7° [s], the limit of ISO 7176-24; every sample counts."""
    max_friction_use: float
    """Largest share of the friction circle used to hold the heading; the chair slides at 1."""
    aligned_s: float | None
    """Time at which the chair, square to the stair, started the approach [s]; None without an approach."""
    aligned_rms_heading_deg: float | None
    """RMS heading from ``aligned_s`` on, but from a turn on a landing to the next approach [°]."""
    aligned_max_heading_deg: float | None
    """Largest |heading| at these times [°]."""
    passenger_max_m_s2: float
    """Largest magnitude of the passenger's acceleration, mean over 50 ms [m/s²]."""
    passenger_vertical_m_s2: float
    """Largest vertical acceleration of the passenger, mean over 50 ms [m/s²]."""
    passenger_longitudinal_m_s2: float
    """Largest horizontal acceleration along the chair's forward axis, mean over 50 ms [m/s²]."""
    passenger_lateral_m_s2: float
    """Largest horizontal acceleration across the chair's forward axis, mean over 50 ms [m/s²]."""
    passenger_jerk_m_s3: float
    """Jerk of the passenger, 99th percentile of means over 50 ms [m/s³], which excludes noise of single samples."""
    airborne_share: float | None
    """Share of the physics steps without any contact of the chair; None where the simulator does not report it."""
    max_contact_force_share: float | None
    """Largest sum of the normal contact forces, as a share of the weight."""
    unconverged_share: float | None
    """Share of the ticks in which the residual of the contact forces exceeds the tolerance of the contact correction, 0.01 m/s²."""
    held_creep_mm_min: float | None
    """Creep of a held chair over the stair [mm/min], from 2 s after the hold to the end; None if that is less than 10 s."""
    energy_wh: float
    """Energy drawn from the battery for the belts [Wh], battery losses included; zero for a chair without [motor]."""
    peak_power_w: float
    """Largest power drawn from the battery in a tick [W]."""
    max_belt_force_n: float
    """Largest magnitude of the traction of one belt, mean over 50 ms [N]."""
    phases: tuple[tuple[float, str], ...]
    """Start time [s] and name of each phase of the mission."""

    @property
    def settling(self) -> str:
        """How the heading settled, in words: after the alignment of a whole traversal, else to ±2°."""
        if self.aligned_max_heading_deg is not None:
            return f"at most {self.aligned_max_heading_deg:.1f}° once aligned"
        return "did not settle" if self.settle_s is None else f"settled to ±2° in {self.settle_s:.1f} s"


def score(trace: Trace, phases: tuple[tuple[float, str], ...] = (), *, upward: bool = True, held_s: float | None = None) -> Scores:
    """Return the scores of a run with at least one sample.

    Args:
        phases: Start time [s] and name of each phase, as the mission reports them.
        upward: Whether the chair drives up the flight.
        held_s: Time of the hold that ended the run, if one did.
    """
    x, y, on_flights = trace["x_m"], trace["y_m"], phases_at(trace["t_s"], phases) != "turn"
    t, heading = trace["t_s"][on_flights], trace["heading_rad"][on_flights]
    steady = t > STEADY_FROM_S
    seat = trace["seat_pitch_rad"]
    onward = x if upward else -x
    aligned_s = next((t_s for t_s, phase in phases if phase == "approach"), None)
    margin, passenger_W = trace["stability_margin_rad"], np.stack([trace[f"passenger_{axis}_m"] for axis in "xyz"])
    passenger = comfort(passenger_W, trace["yaw_rad"])
    aligned = heading[phases_at(t, [entry for entry in phases if entry[1] in ("approach", "turn")]) == "approach"]
    return Scores(
        duration_s=float(trace["t_s"][-1]),
        rms_heading_deg=rms(heading) / DEG,
        rms_yaw_deg=rms(trace["yaw_rad"]) / DEG,
        steady_rms_heading_deg=rms(heading[steady]) / DEG if np.any(steady) else None,
        settle_s=settling_time(t, heading),
        final_heading_deg=float(trace["heading_rad"][-1]) / DEG,
        max_abs_heading_deg=float(np.abs(heading).max()) / DEG,
        roll_back_m=roll_back(onward, trace["pitch_rad"]),
        lateral_m=float(np.abs(y - y[0]).max()),
        climbed_m=float(x[-1] - x[0]),
        seat_rms_deg=_reported(seat, lambda error: np.sqrt(np.square(error).mean()) / DEG),
        seat_max_deg=_reported(seat, lambda error: np.abs(error).max() / DEG),
        max_pitch_rate_deg_s=float(np.abs(lasting(trace["pitch_rate_rad_s"])).max()) / DEG,
        max_pitch_jolt_deg_s=float(np.abs(trace["pitch_rate_rad_s"]).max()) / DEG,
        min_stability_margin_deg=lasting_minimum(margin) / DEG,
        seconds_below_7_deg=float(np.count_nonzero(margin < MARGIN_LIMIT_RAD)) * TICK_S,
        max_friction_use=float(trace["friction_use"].max()),
        aligned_s=aligned_s,
        aligned_rms_heading_deg=rms(aligned) / DEG if aligned.size else None,
        aligned_max_heading_deg=float(np.abs(aligned).max()) / DEG if aligned.size else None,
        passenger_max_m_s2=passenger.total_m_s2,
        passenger_vertical_m_s2=passenger.vertical_m_s2,
        passenger_longitudinal_m_s2=passenger.longitudinal_m_s2,
        passenger_lateral_m_s2=passenger.lateral_m_s2,
        passenger_jerk_m_s3=passenger.jerk_m_s3,
        airborne_share=_reported(trace["airborne_share"], np.mean),
        max_contact_force_share=_reported(trace["contact_force_share"], np.max),
        unconverged_share=_reported(trace["contact_residual_m_s2"], lambda residual: np.mean(residual > TOLERANCE_M_S2)),
        held_creep_mm_min=None if held_s is None else creep(trace, held_s),
        energy_wh=float(trace["power_w"].sum()) * TICK_S / 3600.0,
        peak_power_w=float(trace["power_w"].max()),
        max_belt_force_n=float(max(np.abs(lasting(trace[name])).max() for name in ("left_force_n", "right_force_n"))),
        phases=phases,
    )


def _reported(values: Float[np.ndarray, " T"], summary: Callable[[np.ndarray], np.floating]) -> float | None:
    """Return a summary of what the simulator reports, or None where it reports nothing."""
    return None if np.isnan(values).any() else float(summary(values))


def creep(trace: Trace, held_s: float) -> float | None:
    """Return the creep of a chair held since ``held_s`` [mm/min], along and across combined; None if the record is too short."""
    watched = np.flatnonzero(trace["t_s"] >= held_s + CREEP_FROM_S)
    if watched.size == 0:
        return None
    first, last = watched[0], watched[-1]
    minutes = float(trace["t_s"][last] - trace["t_s"][first]) / 60.0
    if minutes * 60.0 < CREEP_LEAST_S:
        return None
    return 1000.0 * float(np.hypot(*(trace[name][last] - trace[name][first] for name in ("x_m", "y_m")))) / minutes


def roll_back(onward_m: Float[np.ndarray, " T"], pitch_rad: Float[np.ndarray, " T"]) -> float:
    """Return the largest retreat from the furthest point of each stretch in which the chair is not level [m]."""
    tilted = np.abs(pitch_rad) > LEVEL_RAD
    ends = np.flatnonzero(np.diff(tilted)) + 1
    stretches = [part for part, on in zip(np.split(onward_m, ends), np.split(tilted, ends), strict=True) if on[0]]
    return max((float((np.maximum.accumulate(part) - part).max()) for part in stretches), default=0.0)


def lasting_minimum(values: Float[np.ndarray, " T"]) -> float:
    """Return the minimum over time of the maximum over ``MARGIN_TICKS`` consecutive samples.

    Shorter dips do not count; a shorter run is one window.
    """
    window = min(MARGIN_TICKS, len(values))
    return float(np.lib.stride_tricks.sliding_window_view(values, window).max(axis=1).min())


def settling_time(
    t_s: Float[np.ndarray, " T"], heading_rad: Float[np.ndarray, " T"], within_rad: float = SETTLED_RAD
) -> float | None:
    """Return the time from which the heading stays within a band [s], or None if the run ends outside."""
    outside = np.flatnonzero(np.abs(heading_rad) > within_rad)
    if outside.size == 0:
        return 0.0
    last = int(outside[-1])
    return None if last + 1 >= t_s.size else float(t_s[last + 1])
