"""Appearance of chair, passenger and stair: triangle meshes generated from their descriptions, for viewers, URDF and drawings."""

from treadline.appearance.belts import lug_part, lug_poses
from treadline.appearance.chair import TRIANGLE_BUDGET, body_poses, chair_parts
from treadline.appearance.parts import BodyName, MeshPart
from treadline.appearance.stair import obstacle_part, stair_parts

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
