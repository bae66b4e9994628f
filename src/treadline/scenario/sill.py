"""The ``[[sill]]`` tables of a scenario file: low edges and ramps on the floor before the stair and on landings.

Rules that join several tables: ``Stair, Sills -> the first problem, in one line``, or None.
"""

import math
from collections.abc import Sequence
from typing import Annotated

from pydantic import Field, model_validator

from treadline.core.angles import DEG
from treadline.core.settings import Settings
from treadline.core.step_sizes import ON_A_FLIGHT_RAD, SINGLE_RISE_M
from treadline.scenario.flight import RISE_M
from treadline.scenario.stair import Stair, run_of


class Sill(Settings):
    """A sill or ramp across floor or landing: a bar with ``depth_m``, else the edge of ground that goes on at another height."""

    step: int | None = None
    """Index of the landing on which it is, as in ``[[step]]``: -1 is the uppermost. Unset: on the floor before the first step."""
    distance_m: Annotated[float, Field(ge=0.1, le=10.0)]
    """Distance of its nearer edge from the first nosing, or from the landing's nosing."""
    height_m: Annotated[float, Field(ge=-RISE_M[1], le=RISE_M[1])]
    """Height above the ground before it, seen from the flight; ground that goes on lower has a negative one."""
    depth_m: Annotated[float, Field(ge=0.01, le=2.0)] | None = None
    """Depth of a bar's top, behind which the ground is as high as before it. Unset: the ground goes on at that height."""
    ramp_m: Annotated[float, Field(ge=0.01, le=3.0)] | None = None
    """Horizontal length of its slope, of a bar's on each side. Unset: it is upright."""

    @model_validator(mode="after")
    def _is_low(self) -> "Sill":
        least_m, most_m = RISE_M[0], max(SINGLE_RISE_M[0], math.tan(ON_A_FLIGHT_RAD) * (self.ramp_m or 0.0))
        if self.depth_m is not None and self.height_m < 0.0:
            raise ValueError(f"height_m is {self.height_m:g}, and a bar stands up; leave depth_m out, or give a positive height_m")
        if least_m <= abs(self.height_m) <= most_m:
            return self
        raise ValueError(
            f"height_m is {self.height_m:g}; it must be from {least_m:g} to {most_m:.2f} m up or down: give another, or a longer "
            f"ramp_m, for a ramp is at most {ON_A_FLIGHT_RAD / DEG:.0f}° steep"
        )

    @property
    def end_m(self) -> float:
        """Distance of its further edge."""
        return self.vertices(0.0)[-1][0]

    def vertices(self, z_m: float) -> list[tuple[float, float]]:
        """Return its outline on ground of a height: distance and height of each vertex [m], the nearest first."""
        top_m, ramp_m = z_m + self.height_m, self.ramp_m or 0.0
        front_m = self.distance_m + ramp_m
        outline = [(self.distance_m, z_m), (front_m, top_m)]
        if self.depth_m is not None:
            outline += [(front_m + self.depth_m, top_m), (front_m + self.depth_m + ramp_m, z_m)]
        return outline


def landing_of(stair: Stair, sill: Sill) -> int | None:
    """Return the index of a sill's landing, counted from the floor; None for the floor."""
    return None if sill.step is None else sill.step % stair.count


def sill_problem(stair: Stair, sills: Sequence[Sill]) -> str | None:
    """Return why a sill cannot be built, or None."""
    for number, sill in enumerate(sills):
        problem = _off_the_landings(stair, sill) or _overlapping(stair, sill, sills[:number])
        if problem is not None:
            return f"sill.{number}: {problem}"
    return None


def _off_the_landings(stair: Stair, sill: Sill) -> str | None:
    if sill.step is None:
        return None
    index = landing_of(stair, sill)
    if index is None or not -stair.count <= sill.step < stair.count or not stair.is_landing(index):
        landings = ", ".join(str(last) for last in stair.landings)
        return f"step is {sill.step}, and sills are on landings: give {landings}, or leave step out for the floor before the stair"
    is_last = index == stair.count - 1
    if sill.depth_m is None and not is_last:
        return f"step is {sill.step}, a landing between two flights, which has one height; give depth_m, the depth of a bar"
    name, depth_m = ("landing_m" if is_last else "between_m"), run_of(stair, (), index)
    too_far = f"it ends {sill.end_m:.2f} m behind the nosing, on a landing of {depth_m:.2f} m; give a larger stair.{name}"
    return too_far if sill.end_m >= depth_m else None


def _overlapping(stair: Stair, sill: Sill, others: Sequence[Sill]) -> str | None:
    for number, other in enumerate(others):
        overlaps = sill.distance_m <= other.end_m and other.distance_m <= sill.end_m
        if overlaps and landing_of(stair, sill) == landing_of(stair, other):
            return f"it begins at {sill.distance_m:g} m and meets sill.{number}, which ends at {other.end_m:.2f} m; move one"
    return None
