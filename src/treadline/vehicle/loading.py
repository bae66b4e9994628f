"""Load of the chair: centre of mass and weight, and the intersection of the plumb line through the centre of mass with the belts.

``chair, payload -> centre of mass, weight``. Plant and ``check`` use the true position of the load (``centre_of_mass``); a mission
uses the entered weight (``Loading``, ``centre_of_mass_level``).
"""

import math
from dataclasses import dataclass

from treadline.scenario.chair import GRAVITY_M_S2, ChairDescription, Flipper, Point
from treadline.scenario.scenario import Chair


@dataclass(frozen=True, slots=True, kw_only=True)
class Loading:
    """Chair with the assumed payload."""

    chair: ChairDescription
    payload_kg: float
    com_error_m: float = 0.0
    """Error added to the centre of mass along the chair [m], for tests."""

    @property
    def seat_kg(self) -> float:
        """Mass rotating with the seat, or fixed to the chassis of a chair without one [kg]."""
        return self.chair.empty_seat_kg + self.payload_kg

    @property
    def weight_n(self) -> float:
        """Weight of chair and payload [N]."""
        flipper_kg = 0.0 if self.chair.flipper is None else self.chair.flipper.mass_kg
        return GRAVITY_M_S2 * (self.chair.masses.chassis_kg + flipper_kg + self.seat_kg)


def centre_of_mass_level(loading: Loading, pitch_rad: float) -> tuple[float, float]:
    """Return the assumed centre of mass (x, z) in B [m] with level seat, or with the payload fixed to the chassis."""
    chair = loading.chair
    seat_rad = 0.0 if chair.seat is None else pitch_rad
    c, s = math.cos(seat_rad), math.sin(seat_rad)
    (hx, _, hz), (px, _, pz) = chair.payload_origin_m, chair.payload_com_m
    chassis, (cx, _, cz) = chair.masses.chassis_kg, chair.masses.chassis_com_m
    # The flipper reaches ahead and down, its own centre not far from its axis when the plumb line passes the nosing.
    flipper, pivot = 0.0 if chair.flipper is None else chair.flipper.mass_kg, 0.5 * chair.tracks.flat_run_m
    total = chassis + flipper + loading.seat_kg
    x = (chassis * cx + flipper * pivot + loading.seat_kg * (hx + c * px + s * pz)) / total
    z = (chassis * cz + flipper * chair.tracks.pulley_radius_m + loading.seat_kg * (hz - s * px + c * pz)) / total
    return x + loading.com_error_m, z


def plumb(loading: Loading, pitch_rad: float) -> float:
    """Return the intersection of the plumb line through the assumed centre of mass with the belts, ahead of mid-track [m]."""
    x, z = centre_of_mass_level(loading, pitch_rad)
    return x - z * math.tan(pitch_rad)


def before_for_margin(loading: Loading, pitch_rad: float, margin_rad: float) -> float:
    """Return how far before a nosing, along the belts, the plumb line must be for a tip-over margin about that nosing [m]."""
    _, z = centre_of_mass_level(loading, pitch_rad)
    return z * (math.tan(pitch_rad + margin_rad) - math.tan(pitch_rad))


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
    seat_kg, chassis_kg = chair.empty_seat_kg + loading.payload_kg, chair.masses.chassis_kg
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
