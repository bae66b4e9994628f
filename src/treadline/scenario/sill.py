"""The ``[[sill]]`` tables of a scenario file: low edges and ramps on the floor before the stair and on landings.

Rules that join several tables: ``Stair, Sills -> the first problem, in one line``, or None.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, model_validator

from treadline.core.angles import DEG
from treadline.core.settings import Settings
from treadline.core.step_sizes import ON_A_FLIGHT_RAD, SINGLE_RISE_M
from treadline.scenario.stair import RISE_M, Stair


class LowEdge(NamedTuple):
    """Edge of a sill or ramp next to a flight."""

    flight: int
    end: Literal["foot", "top"]
    """End of the flight from whose nosing the distance counts."""
    out_m: float
    """Distance away from the flight."""
    height_m: float
    """Height up or down; that of a ramp counts as at most the highest sill's."""


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
        least_m, most_m, slope_m = RISE_M[0], SINGLE_RISE_M[0], math.tan(ON_A_FLIGHT_RAD)
        if self.depth_m is not None and self.height_m < 0.0:
            raise ValueError(f"height_m is {self.height_m:g}, and a bar stands up; leave depth_m out, or give a positive height_m")
        if least_m <= abs(self.height_m) <= max(most_m, slope_m * (self.ramp_m or 0.0)):
            return self
        raise ValueError(
            f"height_m is {self.height_m:g}; a sill is {least_m:g} to {most_m:g} m high up or down, a ramp at most "
            f"{ON_A_FLIGHT_RAD / DEG:.0f}° steep: give a ramp_m of at least {abs(self.height_m) / slope_m:.2f}"
        )

    @property
    def end_m(self) -> float:
        """Distance of its further edge."""
        ramp_m = self.ramp_m or 0.0
        return self.distance_m + ramp_m + (0.0 if self.depth_m is None else self.depth_m + ramp_m)

    def vertices(self, z_m: float) -> list[tuple[float, float]]:
        """Return its outline on ground of a height: distance and height of each vertex [m], the nearest first."""
        top_m, ramp_m = z_m + self.height_m, self.ramp_m or 0.0
        outline = [(self.distance_m, z_m), (self.distance_m + ramp_m, top_m)]
        return outline if self.depth_m is None else [*outline, (self.end_m - ramp_m, top_m), (self.end_m, z_m)]


def landing_of(stair: Stair, sill: Sill) -> int | None:
    """Return the index of a sill's landing, counted from the floor; None for the floor."""
    return None if sill.step is None else sill.step % stair.count


def low_edges(stair: Stair, sills: Sequence[Sill]) -> tuple[LowEdge, ...]:
    """Return the edges of sills and ramps, those between two flights for both."""
    found: list[LowEdge] = []
    for sill in sills:
        landing, height_m = landing_of(stair, sill), min(abs(sill.height_m), SINGLE_RISE_M[0])
        flight = -1 if landing is None else landing // stair.steps
        for out_m in sorted({out_m for out_m, _ in sill.vertices(0.0)}):
            if landing is not None:
                found.append(LowEdge(flight, "top", out_m, height_m))
            if flight + 1 < stair.flights:
                found.append(LowEdge(flight + 1, "foot", out_m if landing is None else stair.between_m - out_m, height_m))
    return tuple(found)


def sill_problem(stair: Stair, sills: Sequence[Sill]) -> str | None:
    """Return why a sill cannot be built, or None."""
    for number, sill in enumerate(sills):
        problem = _in_a_flight(stair, sill) or _between_flights(stair, sill) or _beyond_the_landing(stair, sill)
        problem = problem or _overlapping(stair, sill, sills[:number])
        if problem is not None:
            return f"sill.{number}: {problem}"
    return None


def _in_a_flight(stair: Stair, sill: Sill) -> str | None:
    if sill.step is None or (-stair.count <= sill.step < stair.count and stair.is_landing(sill.step % stair.count)):
        return None
    landings = ", ".join(str(index) for index in range(stair.count) if stair.is_landing(index))
    return f"step is {sill.step}, and a sill is on a landing: give {landings}, or leave step out for the floor before the stair"


def _between_flights(stair: Stair, sill: Sill) -> str | None:
    if sill.step is None or sill.step % stair.count == stair.count - 1:
        return None
    if stair.turn != "none":
        return f"step is {sill.step}, and the flights turn {stair.turn} at their landings; give -1, the uppermost, or leave it out"
    if sill.depth_m is None:
        return f"step is {sill.step}, a landing between two flights, which has one height; give depth_m, the depth of a bar"
    return None


def _beyond_the_landing(stair: Stair, sill: Sill) -> str | None:
    if sill.step is None:
        return None
    is_last = sill.step % stair.count == stair.count - 1
    name, depth_m = ("landing_m", max(stair.landing_m, stair.run_m)) if is_last else ("between_m", stair.between_m)
    if sill.end_m < depth_m:
        return None
    return f"it ends {sill.end_m:.2f} m behind the nosing, on a landing of {depth_m:.2f} m; give a larger stair.{name}"


def _overlapping(stair: Stair, sill: Sill, others: Sequence[Sill]) -> str | None:
    for number, other in enumerate(others):
        overlaps = sill.distance_m <= other.end_m and other.distance_m <= sill.end_m
        if overlaps and landing_of(stair, sill) == landing_of(stair, other):
            return f"it begins at {sill.distance_m:g} m and meets sill.{number}, which ends at {other.end_m:.2f} m; move one"
    return None
