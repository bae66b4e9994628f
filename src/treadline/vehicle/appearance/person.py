"""Silhouette of a seated person, scaled to the payload's box and mass: ``box, mass -> joints -> meshes`` in the seat's frame.

Segment lengths are fractions of the stature after Drillis and Contini (1966).
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.scenario.chair import Size
from treadline.vehicle.appearance import palette
from treadline.vehicle.appearance.mesh import Mesh, capsule, lathe, merged, rounded_box
from treadline.vehicle.appearance.parts import MeshPart, part

STATURE_PER_BOX = 2.4
"""Stature over the height of the payload's box: 1.68 m for the box of 0.70 m of the shipped wheelchairs (drawn only)."""
BODY_MASS_INDEX = 22.0
"""Body mass index of the drawn widths [kg/m²]: middle of the normal range of the WHO, 18.5 to 25; widths grow with the root of the
mass over this mass."""
GIRTHS = 0.75, 1.45
"""Limits of the factor on all widths (drawn only)."""
TRUNK, THIGH, SHANK, FOOT, FOOT_HEIGHT, UPPER_LIMB, FOREARM, HEAD = 0.288, 0.245, 0.246, 0.152, 0.039, 0.186, 0.146, 0.182
"""Segment lengths over the stature: trunk is hip to shoulder, head includes the neck."""
RECLINE_RAD, THIGH_RAD, SHANK_RAD = 10.0 * DEG, 15.0 * DEG, 24.0 * DEG
"""Recline of the trunk, rise of the thighs and backward lean of the shanks: the feet stay inside the frame on a slope of 30°
(drawn only)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Posture:
    """Joints of a seated person in the seat's frame, in the plane y = ``hip[1]`` [m]."""

    stature_m: float
    girth: float
    """Factor on all widths."""
    hip: Float[np.ndarray, " 3"]
    shoulder: Float[np.ndarray, " 3"]
    knee: Float[np.ndarray, " 3"]
    ankle: Float[np.ndarray, " 3"]
    thigh_radius_m: float

    @property
    def sole_z(self) -> float:
        """Height of the soles [m]."""
        return float(self.ankle[2]) - FOOT_HEIGHT * self.stature_m

    @property
    def elbow_z(self) -> float:
        """Height of the elbows [m]."""
        return float(self.shoulder[2]) - 0.95 * UPPER_LIMB * self.stature_m


def posture(size_m: Size, mass_kg: float, com: Float[np.ndarray, " 3"]) -> Posture:
    """Return the joints of a person whose box and centre of mass are given.

    Args:
        com: Centre of mass in the seat's frame [m].
    """
    h = STATURE_PER_BOX * size_m[2]
    girth = min(max(math.sqrt(max(mass_kg, 1.0) / (BODY_MASS_INDEX * h * h)), GIRTHS[0]), GIRTHS[1])
    hip = com + h * np.array([-0.077, 0.0, -0.116])  # a seated person's centre of mass is in front of the abdomen
    shoulder = hip + TRUNK * h * np.array([-math.sin(RECLINE_RAD), 0.0, math.cos(RECLINE_RAD)])
    knee = hip + THIGH * h * np.array([math.cos(THIGH_RAD), 0.0, math.sin(THIGH_RAD)])
    ankle = knee + SHANK * h * np.array([-math.sin(SHANK_RAD), 0.0, -math.cos(SHANK_RAD)])
    return Posture(
        stature_m=h, girth=girth, hip=hip, shoulder=shoulder, knee=knee, ankle=ankle, thigh_radius_m=0.042 * h * math.sqrt(girth)
    )


def person_parts(seated: Posture) -> list[MeshPart]:
    """Return head, trunk, limbs and shoes of a seated person."""
    h, g = seated.stature_m, seated.girth
    up = (seated.shoulder - seated.hip) / (TRUNK * h)

    def section(along: float, across: float, deep: float) -> tuple[float, float, float]:
        return along * h, across * g * h, deep * g * h

    trunk = lathe(
        seated.hip,
        seated.shoulder,
        [
            section(-0.035, 0.06, 0.035),
            section(-0.02, 0.09, 0.055),
            section(0.03, 0.098, 0.064),
            section(0.12, 0.085, 0.06),
            section(0.21, 0.1, 0.066),
            section(0.27, 0.105, 0.056),
            section(0.298, 0.08, 0.04),
            section(0.315, 0.04, 0.03),
        ],
        sides=14,
    )
    skin: list[Mesh] = []
    sleeves: list[Mesh] = []
    legs: list[Mesh] = []
    shoes: list[Mesh] = []
    neck = seated.shoulder + 0.02 * h * up
    skin.append(capsule(neck, neck + 0.05 * h * up, 0.03 * h))
    chin = neck + h * np.array([0.0, 0.0, 0.035])
    skull = [(0.0, 0.02), (0.012, 0.034), (0.045, 0.044), (0.08, 0.046), (0.105, 0.04), (0.122, 0.026), (0.13, 0.01)]
    head = lathe(chin, chin + np.array([0.0, 0.0, 1.0]), [(a * h, w * h, 1.18 * w * h) for a, w in skull], sides=12)
    skin.append(head)
    hair = lathe(
        chin + h * np.array([-0.007, 0.0, 0.0]),
        chin + h * np.array([-0.007, 0.0, 1.0]),
        [(a * h, w * h, 1.18 * w * h) for a, w in ((0.07, 0.042), (0.085, 0.0475), (0.11, 0.043), (0.128, 0.028), (0.136, 0.01))],
        sides=12,
    )
    for s in (1.0, -1.0):
        aside = np.array([0.0, s, 0.0])
        upper = seated.shoulder + h * (0.1 * g * aside - 0.012 * up)
        elbow = np.array([upper[0] + 0.06 * h, upper[1] + 0.012 * s * h, seated.elbow_z])
        hand = elbow + FOREARM * h * np.array([0.97, -0.12 * s, 0.05])
        sleeves.append(capsule(upper, elbow, 0.03 * g * h, 0.024 * g * h))
        sleeves.append(capsule(elbow, 0.25 * elbow + 0.75 * hand, 0.024 * g * h, 0.018 * g * h))
        skin.append(capsule(0.25 * elbow + 0.75 * hand, hand + 0.03 * h * np.array([1.0, 0.0, 0.0]), 0.017 * h, 0.02 * h, sides=8))
        hip = seated.hip + 0.052 * g * h * aside
        knee = seated.knee + 0.056 * h * aside
        ankle = seated.ankle + 0.056 * h * aside
        legs.append(capsule(hip, knee, seated.thigh_radius_m * 1.05, 0.033 * h * math.sqrt(g)))
        legs.append(capsule(knee, ankle, 0.033 * h * math.sqrt(g), 0.024 * h * math.sqrt(g)))
        foot = rounded_box(
            (0.3 * FOOT * h, 0.0, -0.5 * FOOT_HEIGHT * h), (FOOT * h, 0.055 * h, FOOT_HEIGHT * h), 0.35 * FOOT_HEIGHT * h
        )
        shoes.append(foot.moved(ankle))
    return [
        part("person_skin", "seat", skin, palette.SKIN),
        part("person_hair", "seat", [hair], palette.HAIR),
        part("person_shirt", "seat", [merged([trunk, *sleeves])], palette.SHIRT),
        part("person_trousers", "seat", legs, palette.TROUSERS),
        part("person_shoes", "seat", shoes, palette.SHOES),
    ]
