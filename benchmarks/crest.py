"""Pitch rate, seat error and vertical acceleration at crest, top entry and foot; also with errors and with a limited flipper.

Run: ``python benchmarks/crest.py`` (about two minutes of CPU). tests/experiments/test_crest.py checks a part of these figures.
"""

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


for slope in SLOPES_DEG:
    heavy, half = min(slope, HEAVY_MAX_DEG), 0.5 * slope
    table(
        f"Up over the crest, {slope:.0f}°",
        {
            "nominal, 50 kg": CrestCase(slope_deg=slope),
            "empty": CrestCase(slope_deg=slope, payload_kg=0.0),
            f"110 kg at {heavy:.0f}°": CrestCase(slope_deg=heavy, payload_kg=110.0),
            "nosing -15 cm": CrestCase(slope_deg=slope, nosing_error_m=-0.15),
            "nosing +10 cm": CrestCase(slope_deg=slope, nosing_error_m=0.10),
            "centre of mass -10 cm": CrestCase(slope_deg=slope, com_error_m=-0.10),
            "centre of mass +10 cm": CrestCase(slope_deg=slope, com_error_m=0.10),
            "heading 10°": CrestCase(slope_deg=slope, heading_deg=10.0),
            "friction 1.0": CrestCase(slope_deg=slope, friction=GRIPS),
            "friction 1.0, empty": CrestCase(slope_deg=slope, friction=GRIPS, payload_kg=0.0),
            f"motor lost half-way, 110 kg, {heavy:.0f}°": CrestCase(slope_deg=heavy, payload_kg=110.0, motor_lost_at_deg=half),
            "the same without its brake": CrestCase(slope_deg=slope, motor_lost_at_deg=half, lost_damping_n_m_s_rad=0.0),
            "no flipper": CrestCase(slope_deg=slope, chair="wheelchair-fixed", duration_s=16.0),
            "range to -45°, centre of mass -10 cm": CrestCase(slope_deg=slope, range_deg=(-45.0, 60.0), com_error_m=-0.10),
            "40 N·m": CrestCase(slope_deg=slope, torque_n_m=40.0),
        },
    )

for slope in (20.0, *SLOPES_DEG):
    heavy, half = min(slope, HEAVY_MAX_DEG), 0.5 * slope
    table(
        f"Rearwards down over the edge, {slope:.0f}°",
        {
            "nominal, 50 kg": CrestCase(direction="down", slope_deg=slope),
            "empty": CrestCase(direction="down", slope_deg=slope, payload_kg=0.0),
            "80 kg": CrestCase(direction="down", slope_deg=slope, payload_kg=80.0),
            f"110 kg at {heavy:.0f}°": CrestCase(direction="down", slope_deg=heavy, payload_kg=110.0),
            "nosing -15 cm": CrestCase(direction="down", slope_deg=slope, nosing_error_m=-0.15),
            "nosing +10 cm": CrestCase(direction="down", slope_deg=slope, nosing_error_m=0.10),
            "centre of mass -10 cm": CrestCase(direction="down", slope_deg=slope, com_error_m=-0.10),
            "centre of mass +10 cm": CrestCase(direction="down", slope_deg=slope, com_error_m=0.10),
            "-15 cm, centre of mass +10 cm": CrestCase(direction="down", slope_deg=slope, nosing_error_m=-0.15, com_error_m=0.1),
            "slope -2°": CrestCase(direction="down", slope_deg=slope, slope_error_deg=-2.0),
            "slope +2°": CrestCase(direction="down", slope_deg=slope, slope_error_deg=2.0),
            "heading 5°": CrestCase(direction="down", slope_deg=slope, heading_deg=5.0),
            f"motor lost half-way, 110 kg, {heavy:.0f}°": CrestCase(
                direction="down", slope_deg=heavy, payload_kg=110.0, motor_lost_at_deg=half, duration_s=20.0
            ),
            "the same without its brake": CrestCase(
                direction="down", slope_deg=slope, motor_lost_at_deg=half, lost_damping_n_m_s_rad=0.0, duration_s=20.0
            ),
            "no flipper": CrestCase(direction="down", slope_deg=slope, chair="wheelchair-fixed", duration_s=16.0),
            "range to -45°": CrestCase(direction="down", slope_deg=slope, range_deg=(-45.0, 60.0)),
            "range to -45°, belts that do not wait": CrestCase(
                direction="down", slope_deg=slope, range_deg=(-45.0, 60.0), keep_m=-1.0
            ),
            "40 N·m": CrestCase(direction="down", slope_deg=slope, torque_n_m=40.0, duration_s=20.0),
            "40 N·m, belts that do not wait": CrestCase(direction="down", slope_deg=slope, torque_n_m=40.0, keep_m=-1.0),
        },
    )

for slope in SLOPES_DEG:
    table(
        f"At the foot, {slope:.0f}°: no flipper at work",
        {
            "mount at 0.1 m/s": CrestCase(at="foot", slope_deg=slope),
            "mount at 0.2 m/s": CrestCase(at="foot", slope_deg=slope, speed_m_s=0.2),
            "leave rearwards at 0.1 m/s": CrestCase(direction="down", at="foot", slope_deg=slope),
            "leave rearwards at 0.2 m/s": CrestCase(direction="down", at="foot", slope_deg=slope, speed_m_s=0.2),
        },
    )
