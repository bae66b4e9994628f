"""Static stability on a stair: tip-over margins in four directions for a given payload position."""

import math

from treadline.scenario.chair import ChairDescription, Flipper, Point
from treadline.scenario.scenario import Chair
from treadline.vehicle.loading import Loading
from treadline.vehicle.tip_over_margin import Margins, tipping_margins, worst_support


def seat_mass_kg(chair: ChairDescription, loading: Chair) -> float:
    """Return the mass rotating with the seat, or fixed to the chassis of a chair without one [kg]."""
    return chair.empty_seat_kg + loading.payload_kg


def payload_com(chair: ChairDescription, loading: Chair) -> Point:
    """Return the payload's centre of mass in the payload's frame, which turns with the seat [m]."""
    (x, y, z), (dx, dy, dz) = chair.payload_com_m, loading.payload_offset_m
    return (x + dx, y + dy, z + dz)


def payload_place(chair: ChairDescription, loading: Chair, seat_angle_rad: float) -> Point:
    """Return the payload's centre of mass in B [m] at a forward seat angle; a payload without a seat does not turn."""
    angle_rad = 0.0 if chair.seat is None else seat_angle_rad
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    x, y, z = payload_com(chair, loading)
    hx, hy, hz = payload_origin(chair, loading)
    return (hx + c * x + s * z, hy + y, hz - s * x + c * z)


def payload_origin(chair: ChairDescription, loading: Chair) -> Point:
    """Return the origin of the payload's frame in B [m], with the seat shift."""
    x, y, z = chair.payload_origin_m
    return (x if chair.seat is None else x + loading.seat_shift_m, y, z)


def centre_of_mass(chair: ChairDescription, loading: Chair, seat_angle_rad: float, flipper_angle_rad: float | None = None) -> Point:
    """Return the centre of mass of chair and payload in B [m] at a forward seat angle.

    Args:
        flipper_angle_rad: Angle of the flipper; None: its rest angle.
    """
    seat_kg, chassis_kg = seat_mass_kg(chair, loading), chair.masses.chassis_kg
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


def static_margins(chair: ChairDescription, loading: Chair, slope_rad: float, pitch_m: float | None, heading_rad: float) -> Margins:
    """Return the tip-over margins of a chair at rest on a stair, with the seat, if it has a linkage, levelled against the pitch.

    A square chair lays its flipper along the flight, where it supports the front; a turned chair lifts it to turn.

    Args:
        pitch_m: Largest distance between neighbouring nosings [m]; None for a single one: floor and landing bear the belts' ends.
    """
    up = (math.sin(slope_rad) * math.cos(heading_rad), -math.sin(slope_rad) * math.sin(heading_rad), math.cos(slope_rad))
    pitch = math.asin(up[0])
    com = centre_of_mass(chair, loading, pitch)
    lifted = heading_rad != 0.0 or pitch_m is None
    weight_n = None if lifted else Loading(chair=chair, payload_kg=loading.payload_kg).weight_n
    return tipping_margins(com, up, worst_support(chair, pitch_m or 0.0, weight_n))
