"""Assumed load of the chair: its weight, and the intersection of the plumb line through the centre of mass with the belts.

``chair, payload -> weight, centre of mass with level seat``. Plant and ``check`` use the true position of the load
(``bodies.centre_of_mass``); a mission uses the entered weight.
"""

import math
from dataclasses import dataclass

from treadline.scenario.chair import GRAVITY_M_S2, ChairDescription
from treadline.vehicle.tracks import sections


@dataclass(frozen=True, slots=True, kw_only=True)
class Loading:
    """Chair with the assumed payload."""

    chair: ChairDescription
    payload_kg: float

    @property
    def seat_kg(self) -> float:
        """Mass rotating with the seat, or fixed to the chassis of a chair without one [kg]."""
        return self.chair.empty_seat_kg + self.payload_kg

    @property
    def weight_n(self) -> float:
        """Weight of chair and payload [N]."""
        return GRAVITY_M_S2 * (self.chair.masses.chassis_kg + sum(part.mass_kg for part in sections(self.chair)) + self.seat_kg)


def centre_of_mass_level(loading: Loading, pitch_rad: float) -> tuple[float, float]:
    """Return the assumed centre of mass (x, z) in B [m] with level seat, or with the payload fixed to the chassis."""
    chair = loading.chair
    seat_rad = 0.0 if chair.seat is None else pitch_rad
    c, s = math.cos(seat_rad), math.sin(seat_rad)
    (hx, _, hz), (px, _, pz) = chair.payload_origin_m, chair.payload_com_m
    chassis, (cx, _, cz) = chair.masses.chassis_kg, chair.masses.chassis_com_m
    # A flipper's own centre is not far from its axis when the plumb line passes the nosing.
    parts = [(part.mass_kg, *part.start_m) for part in sections(chair)]
    parts += [(chassis, cx, cz), (loading.seat_kg, hx + c * px + s * pz, hz - s * px + c * pz)]
    total = sum(kg for kg, _, _ in parts)
    x, z = (sum(part[0] * part[axis] for part in parts) / total for axis in (1, 2))
    return x, z


def plumb(loading: Loading, pitch_rad: float) -> float:
    """Return the intersection of the plumb line through the assumed centre of mass with the belts, ahead of mid-track [m]."""
    x, z = centre_of_mass_level(loading, pitch_rad)
    return x - z * math.tan(pitch_rad)
