"""Belts among the links of a robot description: pulleys of the chassis, and flippers.

``links -> DescribedBelts``. What hangs on a section of the belts turns with it; all else is one chassis, with its joints at zero.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from treadline.core.errors import SettingsError
from treadline.core.rotations import Vector3, rotation_x
from treadline.vehicle.description_links import ALONG, CollisionSolid, DescribedLink, summed
from treadline.vehicle.tracks import IN_LINE_M

SAME_M = 1e-3
"""Distance up to which two axes are one [m]: descriptions are written in millimetres."""
ABOUT_Y = rotation_x(-0.5 * math.pi)
"""Axes of a round shape that lies along y."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flippers:
    """Links of both sides that turn about one axis."""

    links: list[DescribedLink]
    """Links with the joint, one or one on either side."""
    whole: list[DescribedLink]
    """All links that turn with them."""
    pulleys: list[CollisionSolid]

    @property
    def axis_m(self) -> Vector3:
        """Middle of their axes [m]."""
        return np.mean([link.origin_m for link in self.links], axis=0)

    @property
    def tip(self) -> CollisionSolid:
        """Pulley that is farthest from the axis."""
        return max(self.pulleys, key=lambda pulley: math.dist(pulley.centre_m[::2], self.axis_m[::2]))

    @property
    def raises(self) -> float:
        """Sign with which raising the tip turns it about y."""
        return -math.copysign(1.0, self.tip.centre_m[0] - self.axis_m[0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DescribedBelts:
    """Belts among the links of a description: the chassis with its pulleys, and pairs of flippers."""

    chassis: list[DescribedLink]
    pulleys: list[CollisionSolid]
    flippers: list[Flippers]
    held: list[str]
    """Joints that are held at zero."""


def find_belts(file: str, links: Sequence[DescribedLink], pattern: str | None) -> DescribedBelts:
    """Return the belts of a description.

    Args:
        file: File, for error messages.
        pattern: Regular expression of the names of the belts' links or shapes; None: what is round about y, left and right alike.

    Raises:
        SettingsError: If there are none.
    """
    by_name = {link.name: link for link in links}
    pulleys = {link.name: _pulleys(link, pattern) for link in links}
    if pattern is None:
        pulleys = _mirrored(pulleys)
    if not any(pulleys.values()):
        named = (
            "nothing round about y lies left or right of its middle"
            if pattern is None
            else f"nothing of the name '{pattern}' is there"
        )
        raise SettingsError(
            f"{file}: has no belts: {named}; give --belts 'REGEX' for the links with their pulleys, of {', '.join(by_name)}"
        )
    turning = {link.name for link in links if _turns(link, links, pulleys)}

    def section(link: DescribedLink) -> str | None:
        while link.name not in turning and link.parent is not None:
            link = by_name[link.parent]
        return link.name if link.name in turning else None

    members: dict[str | None, list[DescribedLink]] = {}
    for link in links:
        members.setdefault(section(link), []).append(link)
    pairs: list[list[DescribedLink]] = []  # left and right by their axis
    for link in (by_name[name] for name in sorted(turning)):
        same = next((pair for pair in pairs if math.dist(pair[0].origin_m[::2], link.origin_m[::2]) < SAME_M), None)
        pairs.append([link]) if same is None else same.append(link)
    return DescribedBelts(
        chassis=members.get(None, []),
        pulleys=[pulley for link in members.get(None, []) for pulley in pulleys[link.name]],
        flippers=[_pair(file, pair, members, pulleys) for pair in pairs],
        held=[link.joint.name for link in links if link.joint and link.name not in turning and _is_held(link, pulleys[link.name])],
    )


def _is_held(link: DescribedLink, pulleys: Sequence[CollisionSolid]) -> bool:
    """Whether a link moves against its parent, and is no wheel."""
    is_wheel = any(math.dist(pulley.centre_m[::2], link.origin_m[::2]) < SAME_M for pulley in pulleys)
    return link.joint is not None and link.joint.kind != "fixed" and not is_wheel


def _mirrored(pulleys: dict[str, list[CollisionSolid]]) -> dict[str, list[CollisionSolid]]:
    """Return pulleys that have one like them on the other side: a lens on a mast has not."""
    places = [pulley.centre_m for found in pulleys.values() for pulley in found]

    def has_twin(place: Vector3) -> bool:
        return any(other[1] * place[1] < 0.0 and math.dist(other[::2], place[::2]) < IN_LINE_M for other in places)

    return {name: [pulley for pulley in found if has_twin(pulley.centre_m)] for name, found in pulleys.items()}


def _pulleys(link: DescribedLink, pattern: str | None) -> list[CollisionSolid]:
    """Return the pulleys of a link.

    With names, a box is a belt about two pulleys as high as the box, and a link without box or round shape, as one of a mesh, is a
    pulley of unknown size at its origin.
    """
    if pattern is None:
        return [solid for solid in link.solids if solid.is_pulley]
    whole = re.fullmatch(pattern, link.name) is not None
    chosen = [solid for solid in link.solids if whole or re.fullmatch(pattern, solid.name)]
    if whole and not link.solids and abs(link.origin_m[1]) > 0.0:
        unknown = np.full(3, math.nan)
        return [CollisionSolid(name=link.name, is_round=True, centre_m=link.origin_m, R=ABOUT_Y, half_m=unknown)]
    return [solid for solid in chosen if solid.is_pulley] or [end for solid in chosen if not solid.is_round for end in _ends(solid)]


def _ends(box: CollisionSolid) -> list[CollisionSolid]:
    """Return the pulleys at both ends of a belt that is a box."""
    length_m, width_m, radius_m = box.half_m.tolist()
    out = box.R @ [length_m - radius_m, 0.0, 0.0]
    half_m = np.array([radius_m, radius_m, width_m])
    return [
        replace(box, is_round=True, centre_m=box.centre_m + sign * out, R=box.R @ ABOUT_Y, half_m=half_m) for sign in (-1.0, 1.0)
    ]


def _turns(link: DescribedLink, links: Sequence[DescribedLink], pulleys: dict[str, list[CollisionSolid]]) -> bool:
    """Whether a link turns a section of the belts: about y, with pulleys on one side of its axis; a rocker has them on both."""
    if link.joint is None or link.joint.kind != "hinge" or abs(link.joint.axis[1]) < ALONG:
        return False
    below, before = {link.name}, 0
    while len(below) > before:
        before = len(below)
        below |= {one.name for one in links if one.parent in below}
    away = [pulley.centre_m[0] - link.origin_m[0] for name in below for pulley in pulleys[name]]
    apart = [math.dist(pulley.centre_m[::2], link.origin_m[::2]) for name in below for pulley in pulleys[name]]
    return max(apart, default=0.0) > SAME_M and (min(away) > -SAME_M or max(away) < SAME_M)


def _pair(
    file: str, pair: list[DescribedLink], members: dict[str | None, list[DescribedLink]], pulleys: dict[str, list[CollisionSolid]]
) -> Flippers:
    """Return the flippers about one axis."""
    sides = [math.copysign(1.0, link.origin_m[1]) for link in pair]
    if len(pair) > 2 or (len(pair) == 2 and sides[0] == sides[1]):
        names = ", ".join(link.name for link in pair)
        raise SettingsError(f"{file}: links {names} turn about one axis, two sections on one side; give one of them another axis")
    whole = [member for link in pair for member in members[link.name]]
    if summed(whole)[0] <= 0.0:
        raise SettingsError(f"{file}: link '{pair[0].name}' has a mass of 0; give its <inertial> the mass of the flipper")
    found = [pulley for link in whole for pulley in pulleys[link.name]]
    sized = [pulley for pulley in found if math.isfinite(pulley.half_m[0])]  # a frame at the tip of a belt is no axis of it
    return Flippers(links=pair, whole=whole, pulleys=sized or found)
