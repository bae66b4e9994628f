"""Flight in a frame: treads from gravity, azimuth by vote, risers from the azimuth, nosings as a sequence."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.perception.geometry import viewing_direction
from treadline.perception.lines import nosing_line
from treadline.perception.nosings import STEP_RISE_M, Axes, Direction, NosingObservation, direction_of, nosings_of
from treadline.perception.planes import PlanarBlocks, Surface, joined
from treadline.perception.step_sequence import flight_of
from treadline.perception.stopwatch import Stopwatch
from treadline.perception.vectors import cross
from treadline.perception.votes import line_votes, votes_of
from treadline.signals import PinholeCamera, RgbdFrame

UPRIGHT = 18.0 * DEG
"""Largest angle of a block's normal from vertical (tread) or horizontal (riser) [rad]."""
RISER_SPREAD = 14.0 * DEG
"""Largest azimuth difference between a riser block and the vote [rad]."""
RISER_GAP_M, TREAD_GAP_M = 0.06, 0.045
"""Separation of different surfaces along their normal [m]: less than half of the smallest run and rise."""
LEAST_BLOCKS = 8
"""Least number of blocks of a surface."""
LOW_SHARE = 0.6
"""Fraction of a surface's columns no higher than a step, above which the remaining columns count as the end of an adjacent wall."""
CONCLUSIVE = 3
"""Number of consecutive nosings after which no other azimuth is tried."""
ENDS: tuple[Literal["lower", "upper"], ...] = ("lower", "upper")
LEVEL_LEAST = 0.2
"""Least horizontal component of the chair's longitudinal axis for the definition of the forward direction."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flight:
    """Visible part of a flight."""

    direction: Direction
    risers: list[Surface]
    treads: list[Surface]
    nosings: list[NosingObservation]
    """Nosings, nearest first."""
    facing: Float[np.ndarray, " 3"]
    """Horizontal unit vector, approximately perpendicular to the edges, in C."""


def flight_under(
    frame: RgbdFrame,
    blocks: PlanarBlocks,
    unit: Float[np.ndarray, "b 3"],
    down: Float[np.ndarray, " 3"],
    directions: tuple[Direction, ...],
    watch: Stopwatch,
) -> Flight | str:
    """Return the nearest flight for the first azimuth with a certain one, or the reason of its absence.

    Args:
        unit: Unit normals of the blocks.
        down: Unit vector in C.
        directions: Possible directions of the flight.
    """
    level = _level_axes(down, frame.camera.R_BC)
    if level is None:
        return "the camera looks straight up or down"
    rise = unit @ down
    vertical = np.flatnonzero(np.abs(rise) < np.sin(UPRIGHT))
    treads = joined(
        frame.camera,
        blocks,
        np.flatnonzero(np.abs(rise) > np.cos(UPRIGHT)),
        level.up,
        gap_m=TREAD_GAP_M,
        least=LEAST_BLOCKS,
    )
    # A horizontal surface above the camera is the underside of an object.
    treads = [tread for tread in treads if _turned_from(tread, level.up) < UPRIGHT and float(tread.centre @ level.up) < 0.0]
    lower, upper = ([nosing_line(tread, end, frame.camera) for tread in treads] for end in ENDS)
    lines = [line for pair in zip(lower, upper, strict=True) for line in pair if line is not None]
    watch.lap("treads")
    upright = unit[vertical]
    azimuth = np.arctan2(upright @ level.right, upright @ level.ahead)
    most_risers, voted = 0, False
    seen: list[Flight] = []
    for peak in votes_of(azimuth, *line_votes(lines, frame.camera.width_px, level)):
        voted = True
        facing = np.cos(peak) * level.ahead + np.sin(peak) * level.right
        axes = Axes(ahead=facing, up=level.up, right=cross(-level.up, facing))
        members = vertical[np.abs(azimuth - peak) < RISER_SPREAD]
        risers = joined(frame.camera, blocks, members, facing, gap_m=RISER_GAP_M, least=LEAST_BLOCKS)
        risers = [riser for surface in risers if (riser := _riser_of(surface, blocks, frame.camera, axes)) is not None]
        most_risers = max(most_risers, len(risers))
        possible = ("up" if len(risers) >= 2 else None, direction_of(treads, axes))
        for direction in (candidate for candidate in directions if candidate in possible):
            ends = lower if direction == "up" else upper
            found = nosings_of(risers if direction == "up" else [], treads, ends, blocks, frame.camera, axes, direction)
            nosings = flight_of(found, treads, axes, direction)
            if nosings:
                seen.append(
                    Flight(
                        direction=direction,
                        risers=[nosing.riser for nosing in nosings if nosing.riser is not None],
                        treads=treads,
                        nosings=nosings,
                        facing=facing,
                    )
                )
        if any(len(flight.nosings) >= CONCLUSIVE for flight in seen):
            break
    watch.lap("flight")
    if seen:
        # Only the nearest flight: a flight beyond a landing is a separate one.
        return min(seen, key=_reach)
    if not voted:
        return "no riser and no nosing faces the camera"
    return f"{most_risers} riser(s) in view, and no two nosings a step apart whose heights are seen"


def _reach(flight: Flight) -> tuple[bool, float]:
    return len(flight.nosings) < CONCLUSIVE, flight.nosings[0].ahead_m


def _riser_of(surface: Surface, blocks: PlanarBlocks, camera: PinholeCamera, axes: Axes) -> Surface | None:
    """Return the part of a surface that is a riser: it faces the voted azimuth and is no higher than a step, unlike walls.

    The end of a wall next to the flight can be coplanar with the first riser.
    """
    if _turned_from(surface, axes.ahead) >= RISER_SPREAD:
        return None
    if _is_low(surface, blocks, axes):
        return surface
    tall = surface.heights_m(camera, axes.up) >= STEP_RISE_M[1]
    # Gaps between adjacent tall columns.
    runs = np.cumsum(tall)
    low = ~tall & (runs == np.argmax(np.bincount(runs[~tall], minlength=1)))
    if np.count_nonzero(low) < LOW_SHARE * low.size:
        return None
    part = surface.within(low, blocks)
    return part if part.blocks.size >= LEAST_BLOCKS and _is_low(part, blocks, axes) else None


def _is_low(surface: Surface, blocks: PlanarBlocks, axes: Axes) -> bool:
    bottom_m, top_m = surface.span_m(blocks, axes.up)
    return top_m - bottom_m < STEP_RISE_M[1]


def _turned_from(surface: Surface, direction: Float[np.ndarray, " 3"]) -> float:
    return float(np.arccos(min(1.0, abs(float(surface.unit @ direction)))))


def _level_axes(down: Float[np.ndarray, " 3"], R_BC: Float[np.ndarray, "3 3"]) -> Axes | None:
    """Return horizontal axes, forward in the camera's viewing direction along the chair, or up the image if undefined."""
    for towards in (viewing_direction(R_BC) * R_BC[0], np.array([0.0, -1.0, 0.0])):
        ahead = towards - float(towards @ down) * down
        length = float(np.linalg.norm(ahead))
        if length > LEVEL_LEAST:
            ahead = ahead / length
            return Axes(ahead=ahead, up=-down, right=cross(down, ahead))
    return None
