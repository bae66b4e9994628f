"""Common parts of URDF and SDF: numbers as text, one-line elements, rotations as angles."""

import math
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from jaxtyping import Float

from treadline.scenario.chair import Point


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
