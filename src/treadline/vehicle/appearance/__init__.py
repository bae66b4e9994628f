"""Appearance of chair, passenger and stair: triangle meshes generated from their descriptions, for viewers, URDF and drawings.

Origins of the lengths: places and sizes of hull, belts, pulleys, flipper, seat linkage, payload and cameras are those of the
chair's file, and steps those of the staircase. A person's segment lengths are fractions of the stature (Drillis and Contini, 1966),
and the camera housing has the size of a data sheet. Every other length and fraction in this package is *drawn only*: chosen for the
look, without an origin. No block, simulator or check reads a mesh (an import contract in ``pyproject.toml``), so no result depends
on it.
"""

from treadline.vehicle.appearance.belts import lug_part, lug_poses
from treadline.vehicle.appearance.chair_parts import TRIANGLE_BUDGET, body_poses, chair_parts
from treadline.vehicle.appearance.parts import BodyName, MeshPart
from treadline.vehicle.appearance.stair_parts import obstacle_part, stair_parts

__all__ = [
    "TRIANGLE_BUDGET",
    "BodyName",
    "MeshPart",
    "body_poses",
    "chair_parts",
    "lug_part",
    "lug_poses",
    "obstacle_part",
    "stair_parts",
]
