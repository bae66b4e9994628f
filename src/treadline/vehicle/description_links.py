"""Links of a robot description, whatever its format: masses, joints and solids in the frame of the description at zero joints."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.core.errors import SettingsError
from treadline.core.rotations import Rotation, Vector3

ALONG = 0.999
"""Cosine above which an axis is called parallel to another: 2.6°, the rounding of angles in hand-written files."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CollisionSolid:
    """Collision shape: a box, or what is round about an axis (cylinder, capsule, sphere)."""

    name: str
    is_round: bool
    centre_m: Vector3
    R: Rotation
    """Axes of the shape; a round one turns about its z axis."""
    half_m: Vector3
    """Half extents along these axes; of a round one the radius, the radius and half its length [m]."""

    @property
    def is_pulley(self) -> bool:
        """Whether it can carry a belt: round about y, on one side of the middle."""
        return self.is_round and abs(self.R[1, 2]) > ALONG and abs(self.centre_m[1]) > self.half_m[2]

    @property
    def extent_m(self) -> Vector3:
        """Half extents of its box along the axes of the description [m]."""
        return np.abs(self.R) @ self.half_m


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DescribedJoint:
    """Joint between a link and its parent."""

    name: str
    kind: Literal["fixed", "hinge", "other"]
    axis: Vector3
    range_rad: tuple[float, float] | None = None
    """Limits; None: turns without end."""
    torque_n_m: float | None = None
    rate_rad_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DescribedLink:
    """Rigid body of a description."""

    name: str
    parent: str | None
    joint: DescribedJoint | None
    origin_m: Vector3
    """Origin of the link, about which its joint turns [m]."""
    mass_kg: float
    com_m: Vector3
    inertia: Float[np.ndarray, "3 3"]
    """Inertia about the centre of mass [kg·m²]."""
    solids: tuple[CollisionSolid, ...]


def summed(links: Iterable[DescribedLink]) -> tuple[float, Vector3, Float[np.ndarray, "3 3"]]:
    """Return mass, centre of mass and inertia about it of links that are one rigid body."""
    parts = [link for link in links if link.mass_kg > 0.0]
    mass_kg = sum(link.mass_kg for link in parts)
    if mass_kg == 0.0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    com_m = np.sum([link.mass_kg * link.com_m for link in parts], axis=0) / mass_kg
    inertia = np.zeros((3, 3))
    for link in parts:
        away = link.com_m - com_m
        inertia += link.inertia + link.mass_kg * (away @ away * np.eye(3) - np.outer(away, away))
    return mass_kg, com_m, inertia


def check_tree(file: str, ends: Sequence[tuple[str, str, str]], links: Sequence[str]) -> None:
    """Refuse links that do not form one tree.

    Args:
        file: File, for error messages.
        ends: Name, parent and child of each joint.
        links: Names of all links.

    Raises:
        SettingsError: If a joint names no link, or the links form a loop or several trees.
    """
    parent_of: dict[str, str] = {}
    for joint, parent, child in ends:
        unknown = next((name for name in (parent, child) if name not in links), None)
        if unknown is not None:
            raise SettingsError(f"{file}: joint '{joint}' names link '{unknown}', which the file does not have; correct the name")
        if child in parent_of:
            raise SettingsError(f"{file}: link '{child}' hangs on '{parent_of[child]}' and '{parent}', a loop; remove one joint")
        parent_of[child] = parent
    roots = [name for name in links if name not in parent_of]
    if len(roots) != 1:
        reason = f"no joint holds the links {', '.join(roots)}" if roots else f"link '{links[0]}' hangs on itself, a loop"
        raise SettingsError(f"{file}: {reason}; a robot is one tree of links: add or remove a joint")


def numbers_of(text: str | None, default: str, where: str) -> Float[np.ndarray, " n"]:
    """Return the numbers of a text.

    Raises:
        SettingsError: If it holds others, or another count of them than the default.
    """
    try:
        values = np.array([float(word) for word in (text or default).split()])
    except ValueError:
        values = np.array([math.nan])
    if values.size != len(default.split()) or not np.isfinite(values).all():
        raise SettingsError(f"{where}: '{(text or '').strip()}' is not {len(default.split())} finite numbers; correct it")
    return values
