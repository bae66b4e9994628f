"""Default method of the stair detector: edge direction from all treads, risers and nosings in view.

Gravity sorts surfaces into treads and risers; the flight with the most evidence is searched for among them; the edge direction is
perpendicular to all of their normals; the heading follows in the chair frame. Each stage reads what the one before found: planar
blocks, the scene's surfaces, the flight, its edges, its shape. Without an IMU, gravity is estimated from the treads, and more of a
stair must be visible. A flight that was found is accepted as a stair that can be driven on, or refused with a cause.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from jaxtyping import Float32

from treadline.core.angles import DEG
from treadline.core.arrays import cross
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.rotations import Rotation, Vector3
from treadline.core.signals import StairMap
from treadline.perception._acceptance import Finding, lacking_evidence, refusal_of
from treadline.perception._edge_fit import EdgeFit, fit_edges
from treadline.perception._form import bow_of, sides_of
from treadline.perception._gravity_direction import GRAVITY_SIGMA, down_of_treads, levelled, off_gravity
from treadline.perception._lattice import EVIDENCE, LEAST_BLOCKS, UNCONFIRMED, UPRIGHT, Scene, flight_in, scene_of
from treadline.perception._plane_segmentation import PlanarBlocks, Surface, reduced, surface_blocks, uncertain_blocks
from treadline.perception._single_step import lowest_step_in, shape_of_single, single_step_in
from treadline.perception._stair_map import map_of
from treadline.perception._stair_shape import axes_of, shape_of, stair_axes_of
from treadline.perception._step_parts import Axes, Flight, viewing_direction
from treadline.perception.detection import StairDetection, refused
from treadline.perception.frame_quality import ENOUGH
from treadline.perception.free_ground import SWEPT_HALF_M
from treadline.perception.steps import SeenStep, steps_of, steps_without_flight, turn_of

LOOKING_AHEAD, LOOKING_DOWN, LEVELS = (5.0 * DEG, 70.0 * DEG), (60.0 * DEG, 100.0 * DEG), 3
"""Ranges of camera pitch for gravity from treads [rad]: nearer to horizontal, treads vanish; nearer to straight down, where a wall
seen from the front and a floor seen from above are alike, more levels must be evenly spaced."""
TREADS_SIGMA = 3.0 * DEG
"""Standard deviation of gravity from treads [rad]."""
TREADS_LEAST = 2
"""Least number of treads horizontal by gravity, above which no tilted ones are considered."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Down:
    """Hypothesis for the direction of gravity."""

    direction: Vector3
    """Direction used to sort surfaces."""
    reference: Vector3
    """Reference for the tilt of edges and treads, with its standard deviation."""
    sigma_rad: float
    least_levels: int
    """Least number of evenly spaced tread levels: higher for an uncertain direction."""


def detect_stair(frame: RgbdFrame, gravity_C: Vector3 | None, swept_half_m: float | None) -> StairDetection:
    """Return the detection result of a frame.

    Args:
        swept_half_m: Half width of the volume swept by the chair; a narrower flight is refused. None without a chair.
    """
    depth_m = frame.depth_m
    if depth_m.dtype != np.float32 or not (depth_m.flags.c_contiguous and depth_m.flags.writeable):
        # A contiguous copy: each memory layout would compile the kernels again.
        frame = replace(frame, depth_m=np.require(depth_m, np.float32, ["C", "W"]))
    dense = reduced(frame)
    search = _Search(frame=dense, camera=frame.camera, swept_half_m=swept_half_m)
    blocks = surface_blocks(dense.depth_m, dense.camera)
    if len(blocks.sums) < 3 * LEAST_BLOCKS:
        return refused(_too_few(blocks, frame.depth_m))
    if gravity_C is not None:
        return replace(search.with_imu(blocks, gravity_C), blocks=blocks)
    sight = refused("gravity is not known, and no treads show it")
    for pitch_rad, least_levels in ((LOOKING_AHEAD, 0), (LOOKING_DOWN, LEVELS)):
        guess = down_of_treads(blocks.unit, pitch_rad)
        if guess is None or sight.accepted:
            continue
        tried = search.under(_Down(direction=guess, reference=guess, sigma_rad=TREADS_SIGMA, least_levels=least_levels), blocks)
        sight = tried if tried.accepted or not least_levels else sight
    return replace(sight, blocks=blocks)


def _too_few(blocks: PlanarBlocks, depth_m: Float32[np.ndarray, "h w"]) -> str:
    """Return why an image has too few planar blocks for a stair."""
    (rows, columns), share = depth_m.shape, float(np.mean(depth_m > 0.0))
    least_px = (1 + math.isqrt(3 * LEAST_BLOCKS) + 1) * blocks.cell_px
    if min(rows, columns) < least_px:
        return f"an image of {columns}×{rows} pixels is too small for the planes of a stair: {least_px}×{least_px} are needed"
    cause = "nothing flat is in range" if share > ENOUGH else "there is too little depth"
    return f"{cause}: {len(blocks.sums)} blocks with a plane, {share:.0%} of the pixels with a depth"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Search:
    """Search for a stair in a frame."""

    frame: RgbdFrame
    """Frame with a dense depth image, which may be smaller than the camera's."""
    camera: PinholeCamera
    """Camera of the whole image."""
    swept_half_m: float | None

    def with_imu(self, blocks: PlanarBlocks, gravity_C: Vector3) -> StairDetection:
        """Return the result with gravity from the IMU.

        Risers alone do not determine the tilt of the edges: gravity does, and its error enters the heading. A frame with hardly a
        tread is refused if others agree on another gravity, because the error of gravity makes all treads appear tilted; so is one
        that shows no stair under the IMU's gravity, and one under theirs.
        """
        length = float(np.linalg.norm(gravity_C))
        if not (np.isfinite(length) and length > 0.0):
            return refused(f"gravity is not a direction but ({', '.join(f'{part:g}' for part in gravity_C)})")
        imu_down = gravity_C / length
        down = _Down(
            direction=levelled(imu_down, blocks.unit, UPRIGHT), reference=imu_down, sigma_rad=GRAVITY_SIGMA, least_levels=0
        )
        sight = self.under(down, blocks)
        if len(sight.treads) >= TREADS_LEAST:
            return sight
        guess = down_of_treads(blocks.unit, LOOKING_AHEAD)
        if guess is None or float(guess @ imu_down) > np.cos(UPRIGHT):
            return sight
        other = self.under(_Down(direction=guess, reference=guess, sigma_rad=TREADS_SIGMA, least_levels=0), blocks)
        normals = np.array([np.copysign(1.0, tread.unit @ guess) * tread.unit for tread in other.treads]).reshape(-1, 3)
        off = off_gravity(normals, imu_down)
        if off is None:
            return sight
        cause = f"gravity is wrong: {len(other.treads)} level surfaces agree on a vertical {off / DEG:.0f}° off the IMU's"
        return refused(cause, edge_count=sight.edge_count)

    def under(self, down: _Down, blocks: PlanarBlocks) -> StairDetection:
        """Return the result under one hypothesis of gravity."""
        sight = self._among(down, blocks, is_uncertain=False)
        found = (sight.evidence or 0.0) >= EVIDENCE
        if found or down.sigma_rad > GRAVITY_SIGMA or blocks.unresolved < 2 * LEAST_BLOCKS:
            return sight
        # Steps far away are lower than a block. Noise turns the normals of smaller blocks, but not the planes of whole risers.
        other = self._among(down, uncertain_blocks(self.frame.depth_m, self.frame.camera, blocks), is_uncertain=True)
        return other if other.accepted else sight

    def _among(self, down: _Down, blocks: PlanarBlocks, *, is_uncertain: bool) -> StairDetection:
        """Return the result of the surfaces among some blocks."""
        scene = scene_of(self.frame, blocks, down.direction, is_uncertain=is_uncertain)
        if scene is None:
            return refused("the camera looks straight up or down")
        sight = self._in_scene(down, scene)
        return sight if sight.find_steps else replace(sight, find_steps=cache(partial(self._steps_without_flight, down, scene)))

    def _steps_without_flight(self, down: _Down, scene: Scene) -> tuple[SeenStep, ...]:
        """Return the kerb of a scene without an accepted flight, or the steps that stand on each other."""
        half_m = self.swept_half_m or SWEPT_HALF_M
        kerb = single_step_in(scene, half_m) or lowest_step_in(scene, half_m)
        return steps_without_flight(scene) if kerb is None else steps_of(scene, kerb, self._fit(down, scene, kerb))

    def _fit(self, down: _Down, scene: Scene, flight: Flight) -> EdgeFit:
        return fit_edges(
            flight.nosings,
            flight.treads,
            down.reference,
            down.sigma_rad,
            cross(down.direction, flight.facing),
            self.frame.camera,
            spread_px=scene.blocks.spread_px,
            measures_range=scene.blocks.measures_range,
        )

    def _in_scene(self, down: _Down, scene: Scene) -> StairDetection:
        """Return the result of a scene's flight."""
        flight = flight_in(scene)
        if self.swept_half_m is not None and (isinstance(flight, str) or flight.evidence < UNCONFIRMED):
            flight = single_step_in(scene, self.swept_half_m) or flight
        if isinstance(flight, str):
            return refused(flight)
        if flight.evidence < UNCONFIRMED:
            return refused(lacking_evidence(flight), edge_count=len(flight.nosings), evidence=flight.evidence)
        return self._detection(down, scene, flight, self._fit(down, scene, flight))

    def _detection(self, down: _Down, scene: Scene, flight: Flight, fit: EdgeFit) -> StairDetection:
        """Return the heading on a flight with its interval, or the cause of its refusal."""
        camera, blocks = self.frame.camera, scene.blocks
        R_BC = camera.R_BC
        in_view = Axes(ahead=fit.ahead, up=-fit.down, right=fit.edge)
        fronts = [tread for _, on, tread in flight.matched_treads if on]
        sides = sides_of([*(tread.surface for tread in fronts), *flight.risers], blocks, camera, in_view)
        # The chair's right is the image's left for a rear camera.
        edge = fit.edge if float((R_BC @ fit.edge)[1]) < 0.0 else -fit.edge
        heading, change = _heading(edge, R_BC)
        sigma = fit.sigma_of(change)
        level = axes_of(viewing_direction(R_BC) * edge, down.reference, down.sigma_rad, flight, blocks, camera)
        shape = shape_of_single(flight) if flight.is_single else shape_of(flight, blocks, camera, level, fit.warp_px)
        cause = refusal_of(
            Finding(
                flight=flight,
                fit=fit,
                shape=shape,
                bow_1_m=bow_of(fronts, flight, blocks, camera, in_view, fit.warp_px),
                sides=sides,
                heading_rad=heading,
                sigma_rad=sigma,
                swept_half_m=self.swept_half_m,
                least_levels=down.least_levels,
            )
        )
        if cause is not None:
            return refused(cause, edge_count=len(flight.nosings), evidence=flight.evidence)

        find_steps = cache(partial(steps_of, scene, flight, fit))

        @cache
        def draw_map() -> StairMap:
            swept_half_m = SWEPT_HALF_M if self.swept_half_m is None else self.swept_half_m
            turn = turn_of(find_steps())
            nosings = flight.nosings if turn is None else flight.nosings[: turn.after]
            stair_map = map_of(self.frame, blocks, nosings, level.axes, shape, sides, swept_half_m, is_single=flight.is_single)
            if turn is not None:
                stair_map = replace(stair_map, ends=turn.on_landing, turn_rad=turn.turn_rad)
            return stair_map

        confirmed = flight.evidence >= EVIDENCE
        return StairDetection(
            accepted=confirmed,
            reason=None if confirmed else lacking_evidence(flight),
            unconfirmed=not confirmed,
            heading_rad=heading,
            sigma_rad=sigma,
            edge_direction_C=edge,
            edge_count=len(flight.nosings),
            box_px=_box(self.camera, blocks, [*flight.risers, *flight.steps]),
            shape=shape,
            evidence=flight.evidence,
            axes=None if flight.is_single else stair_axes_of(self.frame.t_s, level, shape, edge),
            risers=tuple(flight.risers),
            treads=tuple(flight.treads),
            draw_map=draw_map,
            find_steps=find_steps,
        )


def _heading(edge: Vector3, R_BC: Rotation) -> tuple[float, Vector3]:
    """Return ψ = atan2(-e·forward, e·right) of an edge pointing right, and its derivative with respect to the edge vector in C."""
    e_B = R_BC @ edge
    forward, left = R_BC[0], R_BC[1]
    a, b = -float(edge @ forward), -float(edge @ left)
    return float(np.arctan2(-e_B[0], -e_B[1])), (-b * forward + a * left) / (a * a + b * b)


def _box(camera: PinholeCamera, blocks: PlanarBlocks, surfaces: Sequence[Surface]) -> tuple[int, int, int, int] | None:
    if not surfaces:
        return None
    points = blocks.centres[np.concatenate([surface.blocks for surface in surfaces])]
    u, v = camera.point_to_pixel(points)
    return int(u.min()), int(v.min()), int(u.max()), int(v.max())
