"""Static stability on a stair: tip-over margins in four directions for a given payload position."""

import math

from treadline.mechanics.chair import EMPTY_SEAT_KG, ChairDescription, Flipper, Point
from treadline.mechanics.tipping import Margins, tipping_margins, worst_support
from treadline.scenario import Chair


def seat_mass_kg(loading: Chair) -> float:
    """Return the mass rotating with the seat [kg]."""
    return EMPTY_SEAT_KG + loading.payload_kg


def payload_com(chair: ChairDescription, loading: Chair) -> Point:
    """Return the payload's centre of mass relative to the hinge, in the seat frame [m]."""
    (x, y, z), (dx, dy, dz) = chair.seat.payload_com_m, loading.payload_offset_m
    return (x + dx, y + dy, z + dz)


def payload_place(chair: ChairDescription, loading: Chair, seat_angle_rad: float) -> Point:
    """Return the payload's centre of mass in B [m] at a forward seat angle."""
    c, s = math.cos(seat_angle_rad), math.sin(seat_angle_rad)
    x, y, z = payload_com(chair, loading)
    hx, hy, hz = chair.seat.hinge_m
    return (hx + loading.seat_shift_m + c * x + s * z, hy + y, hz - s * x + c * z)


def centre_of_mass(chair: ChairDescription, loading: Chair, seat_angle_rad: float, flipper_angle_rad: float | None = None) -> Point:
    """Return the centre of mass of chair and payload in B [m] at a forward seat angle.

    Args:
        flipper_angle_rad: Angle of the flipper; None: its rest angle.
    """
    seat_kg, chassis_kg = seat_mass_kg(loading), chair.masses.chassis_kg
    payload = payload_place(chair, loading, seat_angle_rad)
    chassis = chair.masses.chassis_com_m
    if chair.flipper is not None:
        chassis_kg, chassis = _with_flipper(chair, chair.flipper, flipper_angle_rad)
    total = chassis_kg + seat_kg
    return (
        (chassis_kg * chassis[0] + seat_kg * payload[0]) / total,
        (chassis_kg * chassis[1] + seat_kg * payload[1]) / total,
        (chassis_kg * chassis[2] + seat_kg * payload[2]) / total,
    )


def _with_flipper(chair: ChairDescription, flipper: Flipper, angle_rad: float | None) -> tuple[float, Point]:
    """Return mass and centre of mass of chassis and flipper together."""
    tracks, (x, y, z), chassis_kg = chair.tracks, chair.masses.chassis_com_m, chair.masses.chassis_kg
    angle = math.radians(tracks.approach_angle_deg) if angle_rad is None else angle_rad
    out = 0.5 * tracks.approach_m
    flipper_x = 0.5 * tracks.flat_run_m + out * math.cos(angle)
    flipper_z = tracks.pulley_radius_m + out * math.sin(angle)
    total = chassis_kg + flipper.mass_kg
    return total, (
        (chassis_kg * x + flipper.mass_kg * flipper_x) / total,
        chassis_kg * y / total,
        (chassis_kg * z + flipper.mass_kg * flipper_z) / total,
    )


def static_margins(chair: ChairDescription, loading: Chair, slope_rad: float, pitch_m: float, heading_rad: float) -> Margins:
    """Return the tip-over margins of a chair at rest on a stair, with the seat levelled against the pitch."""
    up = (math.sin(slope_rad) * math.cos(heading_rad), -math.sin(slope_rad) * math.sin(heading_rad), math.cos(slope_rad))
    pitch = math.asin(up[0])
    com = centre_of_mass(chair, loading, pitch)
    return tipping_margins(com, up, worst_support(chair, pitch_m))
