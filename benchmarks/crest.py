"""The crest in figures: pitch rate, seat error, vertical acceleration; with the arm, with errors, and with less of an arm.

Run: ``python benchmarks/crest.py`` (about a minute of CPU). The tests hold a part of it: tests/experiments/test_crest.py.
"""

from treadline.experiments.crest import CrestCase, cross

for slope_deg in (25.0, 28.0, 30.0):
    half_deg = 0.5 * slope_deg
    cases = {
        "nominal": CrestCase(slope_deg=slope_deg),
        "nosing -15 cm": CrestCase(slope_deg=slope_deg, nosing_error_m=-0.15),
        "nosing +10 cm": CrestCase(slope_deg=slope_deg, nosing_error_m=0.10),
        "centre of mass -10 cm": CrestCase(slope_deg=slope_deg, com_error_m=-0.10),
        "centre of mass +10 cm": CrestCase(slope_deg=slope_deg, com_error_m=0.10),
        "empty": CrestCase(slope_deg=slope_deg, payload_kg=0.0),
        "110 kg": CrestCase(slope_deg=slope_deg, payload_kg=110.0),
        "heading 10°": CrestCase(slope_deg=slope_deg, heading_deg=10.0),
        "motor lost, 110 kg": CrestCase(slope_deg=slope_deg, payload_kg=110.0, motor_lost_at_deg=half_deg),
        "motor lost, no brake": CrestCase(slope_deg=slope_deg, motor_lost_at_deg=half_deg, lost_damping_n_m_s_rad=0.0),
        "no arm": CrestCase(slope_deg=slope_deg, chair="wheelchair", duration_s=16.0),
        "range to -45°": CrestCase(slope_deg=slope_deg, range_deg=(-45.0, 60.0), com_error_m=-0.10),
        "40 N·m": CrestCase(slope_deg=slope_deg, torque_n_m=40.0),
    }
    for name, case in cases.items():
        ride = cross(case)
        print(
            f"{slope_deg:.0f}°  {name:24} {'across' if ride.is_across else 'not across':10} {ride.duration_s:5.1f} s "
            f"{ride.pitch_rate_deg_s:6.1f} °/s  seat {ride.seat_deg:4.1f}°  {ride.vertical_m_s2:5.2f} m/s²"
        )
