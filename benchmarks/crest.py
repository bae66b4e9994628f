"""Pitch rate, seat error and vertical acceleration at crest, top entry and foot; also with errors and with a limited flipper.

Run: ``python benchmarks/crest.py`` (about two minutes of CPU). tests/experiments/test_crest.py checks a part of these figures.
"""

from collections.abc import Callable
from functools import partial

from crossing import CrestCase, cross

SLOPES_DEG = (25.0, 28.0, 30.0)
GRIPS = (1.0, 0.806)
HEAVY_MAX_DEG = 26.0
"""Steepest slope [°] of the cases with a payload of 110 kg."""


def table(title: str, cases: dict[str, CrestCase]) -> None:
    """Print one row a case."""
    print(f"\n{title}")
    for name, case in cases.items():
        ride = cross(case)
        stage = ride.stages[-1][1] if ride.stages else ""
        print(
            f"{name:36} {'across' if ride.is_across else stage:8} {ride.duration_s:5.1f} s  {ride.pitch_rate_deg_s:6.1f} °/s  "
            f"seat {ride.seat_deg:4.1f}°  {ride.vertical_m_s2:5.2f} m/s²",
            flush=True,
        )


def errors(make: Callable[..., CrestCase]) -> dict[str, CrestCase]:
    """Return the cases with an error of the assumed nosing or centre of mass."""
    return {
        "nosing -15 cm": make(nosing_error_m=-0.15),
        "nosing +10 cm": make(nosing_error_m=0.10),
        "centre of mass -10 cm": make(com_error_m=-0.10),
        "centre of mass +10 cm": make(com_error_m=0.10),
    }


def limited(make: Callable[..., CrestCase], heavy_deg: float, lost_at_deg: float, duration_s: float) -> dict[str, CrestCase]:
    """Return the cases with a lost motor, without a flipper and with a weak one."""
    lost = {"motor_lost_at_deg": lost_at_deg, "duration_s": duration_s}
    return {
        f"motor lost half-way, 110 kg, {heavy_deg:.0f}°": make(slope_deg=heavy_deg, payload_kg=110.0, **lost),
        "the same without its brake": make(lost_damping_n_m_s_rad=0.0, **lost),
        "no flipper": make(chair="wheelchair-fixed", duration_s=16.0),
        "40 N·m": make(torque_n_m=40.0, duration_s=duration_s),
    }


for slope in SLOPES_DEG:
    heavy, up = min(slope, HEAVY_MAX_DEG), partial(CrestCase, slope_deg=slope)
    table(
        f"Up over the crest, {slope:.0f}°",
        {
            "nominal, 50 kg": up(),
            "empty": up(payload_kg=0.0),
            f"110 kg at {heavy:.0f}°": up(slope_deg=heavy, payload_kg=110.0),
            **errors(up),
            "heading 10°": up(heading_deg=10.0),
            "friction 1.0": up(friction=GRIPS),
            "friction 1.0, empty": up(friction=GRIPS, payload_kg=0.0),
            **limited(up, heavy, 0.5 * slope, 40.0),
            "range to -45°, centre of mass -10 cm": up(range_deg=(-45.0, 60.0), com_error_m=-0.10),
        },
    )

for slope in (20.0, *SLOPES_DEG):
    heavy, down = min(slope, HEAVY_MAX_DEG), partial(CrestCase, direction="down", slope_deg=slope)
    table(
        f"Rearwards down over the edge, {slope:.0f}°",
        {
            "nominal, 50 kg": down(),
            "empty": down(payload_kg=0.0),
            "80 kg": down(payload_kg=80.0),
            f"110 kg at {heavy:.0f}°": down(slope_deg=heavy, payload_kg=110.0),
            **errors(down),
            "-15 cm, centre of mass +10 cm": down(nosing_error_m=-0.15, com_error_m=0.1),
            "slope -1°": down(slope_error_deg=-1.0),
            "slope +1°": down(slope_error_deg=1.0),
            "heading 5°": down(heading_deg=5.0),
            **limited(down, heavy, 0.5 * slope, 20.0),
            "range to -45°": down(range_deg=(-45.0, 60.0)),
            "range to -45°, belts that do not wait": down(range_deg=(-45.0, 60.0), margin_deg=-60.0),
            "40 N·m, belts that do not wait": down(torque_n_m=40.0, margin_deg=-60.0),
        },
    )

for slope in SLOPES_DEG:
    foot = partial(CrestCase, at="foot", slope_deg=slope)
    table(
        f"At the foot, {slope:.0f}°: no flipper at work",
        {
            "mount at 0.1 m/s": foot(),
            "mount at 0.2 m/s": foot(speed_m_s=0.2),
            "leave rearwards at 0.1 m/s": foot(direction="down"),
            "leave rearwards at 0.2 m/s": foot(direction="down", speed_m_s=0.2),
        },
    )
