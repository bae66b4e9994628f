"""A single step in a frame, up or down: a kerb, a threshold, a dock.

One nosing repeats nothing, so that the lattice finds no evidence in it. What shows it is the level on which the chair stands,
another level as deep and as wide as the chair needs, and the straight edge between them: the front of the upper level, and its
riser on the way up. Only a horizontal chair knows the height of its own level, the plane of the belts.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from treadline.core.camera_images import PinholeCamera
from treadline.core.signals import Direction
from treadline.core.step_sizes import SINGLE_RISE_M
from treadline.perception._lattice import (
    EVIDENCE,
    RISER_GAP_M,
    USUAL_SIZE,
    Scene,
    levels_of,
    nosing_of,
    risers_at,
    turned_axes,
    voted_azimuths,
)
from treadline.perception._plane_segmentation import Line
from treadline.perception._stair_shape import StairShape
from treadline.perception._step_parts import TREAD_SIGMA_M, Axes, Flight, Tread, viewing_direction
from treadline.perception.free_ground import DROP_M, FLAT_RAD, LEVEL_SIZE_M

RUN_M = 0.30
"""Run by which a single step is described [m], that of usual steps: a map must have one, and a single step has none."""
BORDER = 0.05
"""Width of the image's border, in image widths: the image cuts a line that ends there. Blocks of a surface are 2 to 4 % wide."""


def lowest_step_in(scene: Scene, swept_half_m: float) -> Flight | None:
    """Return what ``single_step_in`` does for a step of the least height, which may be measured as less."""
    # Levels are separated by half of the lowest step.
    levels = levels_of(scene.frame.camera, scene.blocks, scene.level, 0.5 * SINGLE_RISE_M[0])
    return single_step_in(replace(scene, treads=levels), swept_half_m, least_m=SINGLE_RISE_M[0] - TREAD_SIGMA_M)


def single_step_in(scene: Scene, swept_half_m: float, least_m: float = SINGLE_RISE_M[0]) -> Flight | None:
    """Return the single step ahead of a horizontal chair as a flight of one nosing, or None.

    Args:
        swept_half_m: Half width of the volume swept by the chair: both levels must be as wide.
        least_m: Least measured height.
    """
    camera = scene.frame.camera
    up_B = camera.R_BC @ scene.level.up
    if float(up_B[2]) < math.cos(FLAT_RAD):
        return None
    p_BC = np.array(camera.mount_m)
    ground_m, middle_m = -float(p_BC @ up_B), -float((camera.R_BC.T @ p_BC) @ scene.level.right)
    direction: Direction = "up" if viewing_direction(camera.R_BC) > 0.0 else "down"
    for azimuth in voted_azimuths(scene):
        voted = turned_axes(scene.level, azimuth)
        for low, high in _pairs(scene, voted, ground_m, direction, least_m):
            front = high.front(voted, direction)
            if front is None or front.kind == "vague" or not _is_wide(front, camera, voted, middle_m, swept_half_m):
                continue
            along = front.ends_m[1] - front.ends_m[0]
            axes = turned_axes(scene.level, azimuth - math.atan2(float(along @ voted.ahead), float(along @ voted.right)))
            place_m = float(front.middle @ axes.ahead)
            if not _meet(scene, low, high, axes, place_m, direction):
                continue
            faces = risers_at(scene, azimuth) if direction == "up" else ()
            risers = [riser for riser in faces if abs(float(riser.surface.centre @ axes.ahead) - place_m) < RISER_GAP_M]
            nosing = nosing_of(1, _height(high, axes), [high], [high], risers, scene.blocks, axes, direction)
            if nosing.has_direction:
                return Flight(
                    direction=direction,
                    evidence=EVIDENCE,
                    rise_m=_height(high, axes) - _height(low, axes),
                    run_m=RUN_M,
                    levels=2,
                    size_prior=USUAL_SIZE,
                    treads=[tread.surface for tread in scene.treads],
                    nosings=[nosing],
                    facing=axes.ahead,
                    matched_treads=[(0, False, low), (1, True, high)],
                    matched_risers=[(1, riser) for riser in risers],
                    is_single=True,
                )
    return None


def shape_of_single(flight: Flight) -> StairShape:
    """Return the dimensions of a single step, whose run is nominal."""
    sigma_m = math.sqrt(2.0) * TREAD_SIGMA_M
    return StairShape(
        rise_m=flight.rise_m,
        run_m=RUN_M,
        slope_rad=math.atan2(flight.rise_m, RUN_M),
        rise_sigma_m=sigma_m,
        run_sigma_m=math.inf,
        slope_sigma_rad=sigma_m / math.hypot(flight.rise_m, RUN_M),
        distance_m=flight.nosings[0].ahead_m,
        blind_m=flight.nosings[0].ahead_m,
        direction=flight.direction,
    )


def _pairs(scene: Scene, axes: Axes, ground_m: float, direction: Direction, least_m: float) -> Iterator[tuple[Tread, Tread]]:
    """Yield the chair's own level and another one a step higher or lower: the lower first."""
    own = [tread for tread in scene.treads if abs(_height(tread, axes) - ground_m) < DROP_M]
    for level in own:
        for other in scene.treads:
            rise_m = _height(other, axes) - _height(level, axes)
            rise_m = rise_m if direction == "up" else -rise_m
            if least_m <= rise_m <= SINGLE_RISE_M[1]:
                yield (level, other) if direction == "up" else (other, level)


def _is_wide(front: Line, camera: PinholeCamera, axes: Axes, middle_m: float, half_m: float) -> bool:
    """Return whether an edge is as wide as the chair sweeps, as far as the image shows it."""
    asides_m = front.ends_m @ axes.right - middle_m
    columns, _ = camera.point_to_pixel(front.ends_m)
    border_px = BORDER * camera.width_px
    is_cut = ~np.isfinite(columns) | (columns < border_px) | (columns > camera.width_px - 1 - border_px)
    return bool((is_cut[0] or -asides_m[0] > half_m) and (is_cut[1] or asides_m[1] > half_m))


def _meet(scene: Scene, low: Tread, high: Tread, axes: Axes, place_m: float, direction: Direction) -> bool:
    """Return whether the lower level lies on one side of the edge and the upper one on the other, the far one deep enough."""
    low_m, high_m = (tread.surface.span_m(scene.blocks, axes.ahead) for tread in (low, high))
    if direction == "down":
        return low_m[1] - max(low_m[0], place_m) > LEVEL_SIZE_M[0]
    foot = low.ends(axes)[1]
    meets = foot is not None and abs(float(foot.middle @ axes.ahead) - place_m) < RISER_GAP_M
    return meets and high_m[1] - place_m > LEVEL_SIZE_M[0]


def _height(tread: Tread, axes: Axes) -> float:
    return float(tread.surface.centre @ axes.up)
