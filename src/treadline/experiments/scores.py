"""What a run is judged by: figures computed from the simulator's truth at 100 Hz, ``t = 0`` included.

The paper scores heading alone; roll-back, lateral drift and the friction margin stand beside it here.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG, rms
from treadline.mechanics.comfort import COMFORT_TICKS, lasting, lasting_change
from treadline.ports import Truth
from treadline.signals import TICK_S

SETTLED_RAD = 2.0 * DEG
STEADY_FROM_S = 20.0
"""After any turn from ±30° has ended (Fig. 10)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trace:
    """Truth as columns, one row per 10 ms."""

    columns: dict[str, Float[np.ndarray, " T"]]

    @classmethod
    def of(cls, samples: Sequence[Truth]) -> "Trace":
        """Return the columns of a sequence of samples."""
        names = [item.name for item in fields(Truth)]
        rows = np.array([[getattr(sample, name) for name in names] for sample in samples], dtype=float)
        rows = rows.reshape(-1, len(names))  # of no samples too
        return cls(columns={name: rows[:, i] for i, name in enumerate(names)})

    def __getitem__(self, name: str) -> Float[np.ndarray, " T"]:
        return self.columns[name]


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """The figures of one traversal."""

    duration_s: float
    rms_heading_deg: float
    """In the nosing plane, over the whole run."""
    rms_yaw_deg: float
    """The same about gravity."""
    steady_rms_heading_deg: float | None
    """From 20 s on; None when the run ended before."""
    settle_s: float | None
    """Time after which |heading| stays within 2°; None when it never does."""
    final_heading_deg: float
    max_abs_heading_deg: float
    roll_back_m: float
    """Largest retreat along the flight, against the direction of travel, from the furthest point reached before it."""
    lateral_m: float
    """Largest distance across the flight from the start."""
    climbed_m: float
    seat_rms_deg: float
    seat_max_deg: float
    max_pitch_rate_deg_s: float
    """As a mean over 50 ms: what a body follows."""
    max_pitch_jolt_deg_s: float
    """Of a single sample: a chair that rocks over steps uneven by 2 mm turns by tenths of a degree, but at once."""
    min_stability_margin_deg: float
    max_friction_use: float
    """Largest share of the friction circle that holding the heading took; 1 slides."""
    aligned_s: float | None
    """When the chair was square to the stair and went for it; None if it never was, or began on the flight."""
    aligned_rms_heading_deg: float | None
    """From then on."""
    aligned_max_heading_deg: float | None
    passenger_max_m_s2: float
    """Largest acceleration of the passenger, level and upright together, as a mean over 50 ms."""
    passenger_jerk_m_s3: float
    """99th percentile of how fast that changes: it is a jolt that lasts, not one sample's noise."""
    energy_wh: float
    """Drawn from the battery for the belts, its own loss included; zero for a chair without [motor]."""
    peak_power_w: float
    """Largest power drawn from the battery in a tick."""
    max_belt_force_n: float
    """Largest traction of one belt, either way, as a mean over 50 ms."""
    phases: tuple[tuple[float, str], ...]
    """When each phase began."""


UNMOVED = Scores(
    duration_s=0.0,
    rms_heading_deg=0.0,
    rms_yaw_deg=0.0,
    steady_rms_heading_deg=None,
    settle_s=None,
    final_heading_deg=0.0,
    max_abs_heading_deg=0.0,
    roll_back_m=0.0,
    lateral_m=0.0,
    climbed_m=0.0,
    seat_rms_deg=0.0,
    seat_max_deg=0.0,
    max_pitch_rate_deg_s=0.0,
    max_pitch_jolt_deg_s=0.0,
    min_stability_margin_deg=0.0,
    max_friction_use=0.0,
    aligned_s=None,
    aligned_rms_heading_deg=None,
    aligned_max_heading_deg=None,
    passenger_max_m_s2=0.0,
    passenger_jerk_m_s3=0.0,
    energy_wh=0.0,
    peak_power_w=0.0,
    max_belt_force_n=0.0,
    phases=(),
)


def score(trace: Trace, phases: tuple[tuple[float, str], ...] = (), *, upward: bool = True) -> Scores:
    """Return the figures of a run; the phases are the mission's own word. A run that ended before its first row moved nothing."""
    if not len(trace["t_s"]):
        return UNMOVED
    t, heading, x, y = (trace[name] for name in ("t_s", "heading_rad", "x_m", "y_m"))
    steady = t > STEADY_FROM_S
    seat = trace["seat_pitch_rad"]
    onward = x if upward else -x
    aligned_s = next((t_s for t_s, phase in phases if phase == "approach"), None)
    peak, jerk = comfort(trace["passenger_x_m"], trace["passenger_z_m"])
    aligned = np.empty(0) if aligned_s is None else heading[t >= aligned_s]
    return Scores(
        duration_s=float(t[-1]),
        rms_heading_deg=rms(heading) / DEG,
        rms_yaw_deg=rms(trace["yaw_rad"]) / DEG,
        steady_rms_heading_deg=rms(heading[steady]) / DEG if np.any(steady) else None,
        settle_s=settling_time(t, heading),
        final_heading_deg=float(heading[-1]) / DEG,
        max_abs_heading_deg=float(np.abs(heading).max()) / DEG,
        roll_back_m=float((np.maximum.accumulate(onward) - onward).max()),
        lateral_m=float(np.abs(y - y[0]).max()),
        climbed_m=float(x[-1] - x[0]),
        seat_rms_deg=rms(seat) / DEG,
        seat_max_deg=float(np.abs(seat).max()) / DEG,
        max_pitch_rate_deg_s=float(np.abs(lasting(trace["pitch_rate_rad_s"])).max()) / DEG,
        max_pitch_jolt_deg_s=float(np.abs(trace["pitch_rate_rad_s"]).max()) / DEG,
        min_stability_margin_deg=float(trace["stability_margin_rad"].min()) / DEG,
        max_friction_use=float(trace["friction_use"].max()),
        aligned_s=aligned_s,
        aligned_rms_heading_deg=rms(aligned) / DEG if aligned.size else None,
        aligned_max_heading_deg=float(np.abs(aligned).max()) / DEG if aligned.size else None,
        passenger_max_m_s2=peak,
        passenger_jerk_m_s3=jerk,
        energy_wh=float(trace["power_w"].sum()) * TICK_S / 3600.0,
        peak_power_w=float(trace["power_w"].max()),
        max_belt_force_n=float(max(np.abs(lasting(trace[name])).max() for name in ("left_force_n", "right_force_n"))),
        phases=phases,
    )


def comfort(x_m: Float[np.ndarray, " T"], z_m: Float[np.ndarray, " T"]) -> tuple[float, float]:
    """Return a passenger's largest acceleration [m/s²] and the 99th percentile of its change [m/s³], as means over 50 ms."""
    if len(x_m) < 2 * COMFORT_TICKS + 3:
        return 0.0, 0.0
    velocity = np.diff(np.stack([x_m, z_m]), axis=1) / TICK_S
    acceleration = lasting_change(velocity)
    jerk = lasting_change(acceleration)
    return float(np.hypot(*acceleration).max()), float(np.percentile(np.hypot(*jerk), 99.0))


def settling_time(
    t_s: Float[np.ndarray, " T"], heading_rad: Float[np.ndarray, " T"], within_rad: float = SETTLED_RAD
) -> float | None:
    """Return the time from which on the heading stays within a band, or None if the run ends outside it."""
    outside = np.flatnonzero(np.abs(heading_rad) > within_rad)
    if outside.size == 0:
        return 0.0
    last = int(outside[-1])
    return None if last + 1 >= t_s.size else float(t_s[last + 1])
