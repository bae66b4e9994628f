"""Steps that are no plain boxes: bowed nosings, bands without depth, gratings, glass, a carpet runner."""

import math
from dataclasses import fields, replace

import numpy as np

from scenes.camera import Film
from scenes.recipe import ViewRecipe
from treadline.core.rotations import rotation_z
from treadline.plant.sensors.camera.solids import Rgb, SceneBox, part_of, placed_in

PIECES = 12
"""Number of chords of a bowed nosing: a sagitta of 0.15 m deviates from the chords by 0.15 m / 12² = 1 mm."""
OVERLAP_M = 0.002
"""Overlap of adjacent pieces [m], so that no gap opens between them."""
FILM_M = 0.0005
"""Thickness of a band without depth above its surface [m]."""
BAR_M, BAR_PITCH_M, BAR_HEIGHT_M = 0.003, 0.0333, 0.030
"""Thickness, spacing and height of the bearing bars of a pressed grating (DIN 24537-1: mesh 33.3 mm, bars 30 × 3 mm)."""
NOSING_BAR_M = 0.030
"""Depth of the solid safety edge of a grating tread [m]."""
PANE_M, STRIP_M, EDGE_M = 0.020, 0.040, 0.001
"""Thickness of a glass tread, depth of a strip along its nosing, depth of its ground edge [m]."""
RUNNER_M, RUNNER_SHARE = 0.008, 0.7
"""Thickness of a carpet runner [m], and its share of the width of the flight."""
RUNNER: Rgb = (110.0, 34.0, 40.0)
STEEL: Rgb = (128.0, 130.0, 132.0)


def shaped(solid: SceneBox, recipe: ViewRecipe, bow_m: float) -> list[SceneBox]:
    """Return the solids of a step or landing with the shapes of a recipe."""
    if bow_m != 0.0:
        return bowed(solid, bow_m, open_risers=recipe.open_risers)
    if recipe.treads == "grating":
        return grating(solid)
    if recipe.treads != "solid":
        return glass(solid, strips=recipe.treads == "glass_strips")
    extra = edge_bands(solid, recipe.edge_holes_m, open_risers=recipe.open_risers) if recipe.edge_holes_m > 0.0 else []
    return [solid, *extra, *([runner(solid)] if recipe.runner else [])]


def bowed(solid: SceneBox, bow_m: float, *, open_risers: bool) -> list[SceneBox]:
    """Return a step whose nosing is a parabola; its middle stays in place.

    Args:
        bow_m: Sagitta; positive if the middle protrudes.
    """
    depth, width, height = solid.half_m
    y = np.linspace(-width, width, PIECES + 1)
    front = -depth + bow_m * (y / width) ** 2
    back = depth + (0.0 if open_risers else abs(bow_m))
    behind = float(front.max())
    solids = [part_of(solid, (behind, back), (-width, width), (-height, height))]
    for i in range(PIECES):
        start, end = np.array([front[i], y[i]]), np.array([front[i + 1], y[i + 1]])
        turn_rad = -math.atan2(end[0] - start[0], end[1] - start[1])
        half_length = 0.5 * (behind - min(start[0], end[0]) + 0.01)
        middle = 0.5 * (start + end) + half_length * np.array([math.cos(turn_rad), math.sin(turn_rad)])
        half = np.array([half_length, 0.5 * math.dist(start, end) + 0.5 * OVERLAP_M, height])
        solids.append(placed_in(solid, np.array([*middle, 0.0]), half, rotation_z(turn_rad)))
    return solids


def edge_bands(solid: SceneBox, band_m: float, *, open_risers: bool) -> list[SceneBox]:
    """Return films without depth on both sides of the nosing, and along the rear edge of an open tread."""
    depth, width, height = solid.half_m
    above, low = (height, height + FILM_M), max(height - band_m, -height)
    bands = [
        part_of(solid, (-depth - FILM_M, -depth + band_m), (-width, width), above),
        part_of(solid, (-depth - FILM_M, -depth), (-width, width), (low, height)),
    ]
    if open_risers:
        bands.append(part_of(solid, (depth - band_m, depth), (-width, width), above))
    return [Film(**{field.name: getattr(band, field.name) for field in fields(band)}) for band in bands]


def grating(solid: SceneBox) -> list[SceneBox]:
    """Return bearing bars across the flight and a solid safety edge at the nosing."""
    depth, width, height = solid.half_m
    upright = (height - BAR_HEIGHT_M, height)
    starts = np.arange(-depth + NOSING_BAR_M + BAR_PITCH_M, depth, BAR_PITCH_M)
    bars = [part_of(solid, (start, start + BAR_M), (-width, width), upright) for start in starts]
    return [
        replace(bar, colour=STEEL) for bar in (part_of(solid, (-depth, -depth + NOSING_BAR_M), (-width, width), upright), *bars)
    ]


def glass(solid: SceneBox, *, strips: bool) -> list[SceneBox]:
    """Return what a depth sensor sees of a pane: its strip, or its ground front edge."""
    depth, width, height = solid.half_m
    return [part_of(solid, (-depth, -depth + (STRIP_M if strips else EDGE_M)), (-width, width), (height - PANE_M, height))]


def runner(solid: SceneBox) -> SceneBox:
    """Return the carpet on a step: above its tread and before its riser."""
    half_width = RUNNER_SHARE * solid.half_m[1]
    carpet = replace(solid, half_m=np.array([solid.half_m[0], half_width, solid.half_m[2]]), colour=RUNNER, texture="carpet")
    return replace(carpet, centre_W=solid.centre_W + solid.R_WK @ np.array([-RUNNER_M, 0.0, RUNNER_M]))
