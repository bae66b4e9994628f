"""The flight in a frame: treads by gravity, its azimuth by vote, risers by azimuth, nosings in a row."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.perception.geometry import way_of
from treadline.perception.lines import nosing_line
from treadline.perception.nosings import STEP_RISE_M, Axes, Direction, Nosing, direction_of, nosings_of
from treadline.perception.planes import Blocks, Surface, joined
from treadline.perception.rows import flight_of
from treadline.perception.stopwatch import Stopwatch
from treadline.perception.vectors import cross
from treadline.perception.votes import line_votes, votes_of
from treadline.signals import PinholeCamera, RgbdFrame

UPRIGHT = 18.0 * DEG
"""How far a block's normal may lie from vertical (tread) or horizontal (riser)."""
RISER_SPREAD = 14.0 * DEG
"""How far a riser block's azimuth may lie from the vote."""
RISER_GAP_M, TREAD_GAP_M = 0.06, 0.045
"""Levels further apart are different surfaces: less than half of the smallest run and rise."""
LEAST_BLOCKS = 8
LOW_SHARE = 0.6
"""Of a surface's columns that must be no taller than a step for the rest to be the end of a wall beside it."""
CONCLUSIVE = 3
"""Nosings in a row after which no other azimuth is tried."""
ENDS: tuple[Literal["lower", "upper"], ...] = ("lower", "upper")
LEVEL_LEAST = 0.2
"""Of the chair's long axis that must be level to tell where ahead is."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flight:
    """A flight as far as one frame shows it."""

    direction: Direction
    risers: list[Surface]
    treads: list[Surface]
    nosings: list[Nosing]
    """The nearest first."""
    facing: Float[np.ndarray, " 3"]
    """Level, roughly square to the edges, in C."""


def flight_under(
    frame: RgbdFrame,
    blocks: Blocks,
    unit: Float[np.ndarray, "b 3"],
    down: Float[np.ndarray, " 3"],
    directions: tuple[Direction, ...],
    watch: Stopwatch,
) -> Flight | str:
    """Return the flight nearest to the camera under the first azimuth that shows one for certain, or why there is none.

    Args:
        unit: Unit normals of the blocks.
        down: Unit vector in C.
        directions: Which way the flight may go.
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
    # A level surface above the eye is the underside of something.
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
        told = ("up" if len(risers) >= 2 else None, direction_of(treads, axes))
        for direction in (way for way in directions if way in told):
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
        # The way on from here: a flight beyond a landing is another one.
        return min(seen, key=_reach)
    if not voted:
        return "no riser and no nosing faces the camera"
    return f"{most_risers} riser(s) in view, and no two nosings a step apart whose heights are seen"


def _reach(flight: Flight) -> tuple[bool, float]:
    return len(flight.nosings) < CONCLUSIVE, flight.nosings[0].ahead_m


def _riser_of(surface: Surface, blocks: Blocks, camera: PinholeCamera, axes: Axes) -> Surface | None:
    """Return the part of a surface that is a riser: it faces the way the vote says and is no taller than a step, as walls are.

    The end of a wall beside the flight may stand in one plane with the first riser.
    """
    if _turned_from(surface, axes.ahead) >= RISER_SPREAD:
        return None
    if _is_low(surface, blocks, axes):
        return surface
    tall = surface.heights_m(camera, axes.up) >= STEP_RISE_M[1]
    # From one tall column to the next.
    runs = np.cumsum(tall)
    low = ~tall & (runs == np.argmax(np.bincount(runs[~tall], minlength=1)))
    if np.count_nonzero(low) < LOW_SHARE * low.size:
        return None
    part = surface.within(low, blocks)
    return part if part.blocks.size >= LEAST_BLOCKS and _is_low(part, blocks, axes) else None


def _is_low(surface: Surface, blocks: Blocks, axes: Axes) -> bool:
    bottom_m, top_m = surface.span_m(blocks, axes.up)
    return top_m - bottom_m < STEP_RISE_M[1]


def _turned_from(surface: Surface, direction: Float[np.ndarray, " 3"]) -> float:
    return float(np.arccos(min(1.0, abs(float(surface.unit @ direction)))))


def _level_axes(down: Float[np.ndarray, " 3"], R_BC: Float[np.ndarray, "3 3"]) -> Axes | None:
    """Return level axes with ahead to the end of the chair that the camera looks to, or up the image where that is not level."""
    for towards in (way_of(R_BC) * R_BC[0], np.array([0.0, -1.0, 0.0])):
        ahead = towards - float(towards @ down) * down
        length = float(np.linalg.norm(ahead))
        if length > LEVEL_LEAST:
            ahead = ahead / length
            return Axes(ahead=ahead, up=-down, right=cross(down, ahead))
    return None
