"""Penetration of a chair at its start pose into the stair: ``Vehicle, Standing, Staircase -> Overlap``, or None.

Boxes against boxes, by the separating axis theorem (Gottschalk et al., SIGGRAPH 1996). A pulley is treated as round along each
tested axis; the axes are those of the boxes, so that the edge of a box can appear up to 0.4 pulley radii too near.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.angles import rotation_y
from treadline.vehicle.bodies import Body, Standing, Vehicle, solids
from treadline.vehicle.staircase import Box, Staircase

PARALLEL = 1e-9
"""Squared sine of the angle below which two edges count as parallel, so that their cross product is not used as an axis."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacedPart:
    """Part of the chair in the world: a box or a cylinder."""

    name: str
    centre_W: Float[np.ndarray, " 3"]
    half_m: Float[np.ndarray, " 3"]
    R_WK: Float[np.ndarray, "3 3"]
    is_round: bool = False
    """Whether the part is a cylinder about its y."""

    def reach(self, axes: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Return the extent of the part from its centre along unit vectors [m]."""
        along = np.abs(axes @ self.R_WK)
        if not self.is_round:
            return np.asarray(along @ self.half_m)
        across = np.sqrt(np.maximum(1.0 - along[:, 1] ** 2, 0.0))
        return np.asarray(self.half_m[0] * across + self.half_m[1] * along[:, 1])


@dataclass(frozen=True, slots=True, kw_only=True)
class Overlap:
    """Deepest overlap of a part of the chair with a part of the stair."""

    part: str
    """Shape of the chair, named as in ``bodies.vehicle``."""
    into: str
    """Kind of the stair's box."""
    index: int
    """Index of the step; -1 for floor and walls."""
    depth_m: float


def placed_parts(chair: Vehicle, start: Standing, flipper_rad: float) -> tuple[PlacedPart, ...]:
    """Return the chair's shapes at its start pose."""
    return tuple(_placed(chair, start, flipper_rad))


def _placed(chair: Vehicle, start: Standing, flipper_rad: float) -> Iterator[PlacedPart]:
    for body in chair.bodies:
        R_BK = _joint(body, start, flipper_rad)
        for shape in body.shapes:
            centre_B = np.array(body.origin_m) + R_BK @ np.array(shape.centre_m)
            yield PlacedPart(
                name=shape.name,
                centre_W=start.p_WB + start.R_WB @ centre_B,
                half_m=np.array(shape.half_m),
                R_WK=start.R_WB @ R_BK @ rotation_y(-shape.nose_up_rad),
                is_round=shape.kind == "cylinder",
            )


def _joint(body: Body, start: Standing, flipper_rad: float) -> Float[np.ndarray, "3 3"]:
    """Return the rotation of a body relative to the chassis."""
    return {"seat": rotation_y(start.seat_rad), "flipper": rotation_y(-flipper_rad)}.get(body.name, np.eye(3))


def deepest_overlap(parts: tuple[PlacedPart, ...], staircase: Staircase) -> Overlap | None:
    """Return the deepest overlap of the chair with the stair, or None."""
    boxes = [solid.box for solid in solids(staircase)]
    centres, radii = np.array([box.centre_W for box in boxes]), np.array([math.hypot(*box.half_m) for box in boxes])
    worst: Overlap | None = None
    for part in parts:
        reach_m = radii + float(np.linalg.norm(part.half_m))
        for place in np.flatnonzero(np.linalg.norm(centres - part.centre_W, axis=1) < reach_m):
            box = boxes[int(place)]
            depth_m = depth_of_overlap(part, box)
            if depth_m > (0.0 if worst is None else worst.depth_m):
                worst = Overlap(part=part.name, into=box.kind, index=box.index, depth_m=depth_m)
    return worst


def depth_of_overlap(part: PlacedPart, box: Box) -> float:
    """Return the distance needed to separate two boxes [m], negative without contact."""
    A, B = part.R_WK, box.R_WK
    apart = np.array(box.centre_W) - part.centre_W
    cross = np.cross(A.T[:, None, :], B.T[None, :, :]).reshape(-1, 3)
    squared = np.einsum("ij,ij->i", cross, cross)
    axes = np.vstack([A.T, B.T, cross[squared > PARALLEL] / np.sqrt(squared[squared > PARALLEL])[:, None]])
    reach = part.reach(axes) + np.abs(axes @ B) @ np.array(box.half_m)
    return float((reach - np.abs(axes @ apart)).min())
