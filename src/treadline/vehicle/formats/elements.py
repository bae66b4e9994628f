"""Common parts of URDF and SDF: numbers as text, one-line elements, and the distribution of a mass over links."""

import math
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from jaxtyping import Float

from treadline.scenario.chair import Point
from treadline.vehicle.bodies import Body

SHARE = 0.02
"""Fraction of a body's mass in the link on either side: simulators need a mass in each link, with an unchanged sum."""
SIDE_SIZE_M = 0.05
"""Edge length of the thin horizontal plate with the inertia of a side link [m], small enough for a thin flipper."""
Inertia = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mass:
    """Mass, its centre in the link's frame, and principal moments about that centre."""

    mass_kg: float
    com_m: Point
    inertia: Inertia


def divided(body: Body, aside_m: float) -> tuple[Mass, Mass, Mass]:
    """Return a body's mass as masses of the middle, left and right link, in the body's frame.

    The two sides are level with the centre of mass, ``aside_m`` to either side: sum, centre and moments are those of the body.
    """
    x, y, z = body.com_m
    side_kg = SHARE * body.mass_kg
    own = side_kg * SIDE_SIZE_M**2 / 12.0
    ixx, iyy, izz = body.inertia
    apart = side_kg * aside_m**2
    middle = Mass(
        mass_kg=body.mass_kg - 2.0 * side_kg,
        com_m=body.com_m,
        inertia=(ixx - 2.0 * (apart + own), iyy - 2.0 * own, izz - 2.0 * (apart + 2.0 * own)),
    )
    left, right = (Mass(mass_kg=side_kg, com_m=(x, y + sign * aside_m, z), inertia=(own, own, 2.0 * own)) for sign in (1.0, -1.0))
    return middle, left, right


def text(*values: float) -> str:
    """Return numbers separated by blanks, with all digits."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def child(parent: Element, tag: str, content: str | None = None, **attributes: str) -> Element:
    """Append an element and return it."""
    element = SubElement(parent, tag, attributes)
    element.text = content
    return element


def document(root: Element) -> str:
    """Return a complete file."""
    indent(root)
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode") + "\n"


def roll_pitch_yaw(R: Float[np.ndarray, "3 3"]) -> Point:
    """Return the angles about fixed x, y, z, in that order, of a rotation matrix."""
    pitch = math.asin(max(-1.0, min(1.0, -float(R[2, 0]))))
    if abs(float(R[2, 0])) > 1.0 - 1e-12:
        return 0.0, pitch, math.atan2(-float(R[0, 1]), float(R[1, 1]))
    return math.atan2(float(R[2, 1]), float(R[2, 2])), pitch, math.atan2(float(R[1, 0]), float(R[0, 0]))
