"""Ground ahead of the camera by the stair's geometry, with the errors of a detector: ``pose -> FreeGround``.

Points on the chair's present level, over the width that the chair sweeps, are in the image or not, and ground bears them or not.
Things that stand on the ground hide nothing here: what rises bears.
"""

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.camera_images import PinholeCamera
from treadline.core.rotations import Rotation, Vector3
from treadline.core.signals import FreeGround, Vector, View
from treadline.core.step_sizes import SINGLE_RISE_M
from treadline.scenario.chair import ChairDescription
from treadline.vehicle.stair_solids import ground_m, landing_sides, landing_walls, stair_surfaces
from treadline.vehicle.staircase import Staircase
from treadline.vehicle.visibility import margins_px

RANGE_M = 2.0
"""Largest distance from mid-track at which ground is measured [m]: a pixel row of a Kinect covers 15 mm of floor there."""
SIGMA_M = 0.010
"""Standard deviation of the measured end of the ground [m], and distance between two points: that of a falling flight's nosing in
2.0 to 2.5 m depth, the furthest of the range, in ``data/cameras/statistical.json``."""
SIDE_STEP_M, SIDE_PARTS = 0.05, 12
"""Distance between the points along a landing's side that are in view or not [m], and their number up it: 0.2 m apart on a wall."""
LINES = 5
"""Number of lines of points over the swept width, 0.2 m apart: between two of them a right-angled corner is at most 0.1 m
nearer."""


class GroundAhead:
    """Simulated measurement of the ground ahead.

    Args:
        sigma_m: Standard deviation of the measured end [m].
    """

    def __init__(
        self,
        staircase: Staircase,
        chair: ChairDescription,
        calibration: PinholeCamera,
        rng: np.random.Generator,
        sigma_m: float = SIGMA_M,
    ) -> None:
        self._surfaces = stair_surfaces(staircase)
        self._walls = landing_walls(staircase)
        self._camera, self._rng, self._sigma_m = calibration, rng, sigma_m
        self._sides_W, self._side_rng = landing_sides(staircase), rng.spawn(1)[0]
        self._view: View = "front" if calibration.R_BC[0, 2] > 0.0 else "rear"
        self._way = 1.0 if self._view == "front" else -1.0
        radius_m = chair.tracks.pulley_radius_m
        self._under_B = np.array([[self._way * 0.5 * chair.tracks.flat_run_m, 0.0, radius_m], [0.0, 0.0, radius_m]])
        """Axis of the leading pulley, and mid-track at the same height."""
        self._width_m = 2.0 * chair.swept_half_m
        self._far_m = np.arange(0.5 * chair.tracks.flat_run_m, RANGE_M, SIGMA_M)
        asides_m = self._width_m * np.linspace(-0.5, 0.5, LINES)
        self._points = np.stack(np.meshgrid(self._far_m, asides_m, indexing="ij"), axis=-1).reshape(-1, 2)

    def look(self, t_s: float, R_WB: Rotation, p_WB: Vector3) -> FreeGround:
        """Return the ground ahead at a pose of the chair."""
        ahead = self._way * R_WB[:2, 0] / math.hypot(*R_WB[:2, 0])
        places = p_WB[:2] + self._points @ np.array([ahead, [-ahead[1], ahead[0]]])
        x, y, _, _, half_length, half_width, _, _ = self._surfaces.T
        near = self._surfaces[np.hypot(x - p_WB[0], y - p_WB[1]) < RANGE_M + np.hypot(half_length, half_width)]
        under_W = p_WB + self._under_B @ R_WB.T
        levels_m = ground_m(near, under_W)
        # A pulley beyond an edge has the ground of mid-track; over a crest, the ground below it.
        level_m = float(levels_m[np.argmin(np.abs(levels_m - under_W[0, 2]))])
        if not math.isfinite(level_m):  # the chair has left all ground
            level_m = float(p_WB[2])
        # No flight rises by more than 45°: what is higher belongs to another flight, above this one.
        tops_m = ground_m(near, np.column_stack([places, level_m + self._points[:, 0]])).reshape(-1, LINES)
        points_B = (np.column_stack([places, np.full(len(places), level_m)]) - p_WB) @ R_WB
        margins = margins_px(self._camera, (points_B - self._camera.mount_m) @ self._camera.R_BC)
        seen = np.asarray(np.all(margins.reshape(-1, LINES) > 0.0, axis=1))
        # A ramp descends by less from point to point.
        bears = tops_m >= np.vstack([np.full(LINES, level_m), tops_m[:-1]]) - SINGLE_RISE_M[0]
        bears &= np.isfinite(tops_m)
        for wall in self._walls:  # what stands on this level rises, and hides what is behind it
            if abs(wall.centre_W[2] - wall.half_m[2] - level_m) < SINGLE_RISE_M[0]:
                in_K = np.abs((places - wall.centre_W[:2]) @ wall.R_WK[:2, :2]) <= wall.half_m[:2]
                bears |= np.logical_or.accumulate(in_K.all(axis=1).reshape(-1, LINES))
        return replace(self._measured(t_s, seen, np.logical_and.accumulate(bears)), sides_B=self._sides(R_WB, p_WB, ahead, level_m))

    def _sides(self, R_WB: Rotation, p_WB: Vector3, ahead: Float[np.ndarray, " 2"], level_m: float) -> tuple[Vector, ...]:
        """Return the ends of the parts in view of the landing's sides, in the level frame of the chair."""
        found: list[Vector] = []
        forward = self._way * np.array([ahead, [-ahead[1], ahead[0]]])
        for ends, height_m in self._sides_W:
            if abs(ends[0, 2] - level_m) > SINGLE_RISE_M[0]:
                continue
            count = max(math.ceil(float(np.linalg.norm(ends[1] - ends[0])) / SIDE_STEP_M), 2)
            points = ends[0] + np.linspace(0.0, 1.0, count)[:, None] * (ends[1] - ends[0])
            up = points + np.linspace(0.0, height_m, SIDE_PARTS)[:, None, None] * (0.0, 0.0, 1.0)
            margins = margins_px(self._camera, ((up - p_WB) @ R_WB - self._camera.mount_m) @ self._camera.R_BC)
            shown = np.flatnonzero((margins > 0.0).any(axis=0) & (np.hypot(*(points - p_WB)[:, :2].T) < RANGE_M))
            noise = self._sigma_m * self._side_rng.standard_normal((2, 2))
            if len(shown) > 2:
                found += [(x, y, 0.0) for x, y in ((points[shown[[0, -1]]] - p_WB)[:, :2] @ forward.T + noise).tolist()]
        return tuple(found)

    def _measured(self, t_s: float, seen: Bool[np.ndarray, " n"], bears: Bool[np.ndarray, "n k"]) -> FreeGround:
        """Return the measurement of one frame; each takes the same number of random draws.

        Args:
            seen: Whether the whole width is in the image, by distance.
            bears: Whether ground bears each point.
        """
        noise, turn_noise = self._rng.standard_normal(2).tolist()
        first = int(np.argmax(seen)) if np.any(seen) else len(seen) - 1
        lost = ~(seen & bears.all(axis=1))[first:]
        last = first + int(np.argmax(lost)) if lost.any() else len(seen) - 1
        blind_m, seen_m = float(self._far_m[first]), float(self._far_m[last])
        if last == first or not lost.any() or not seen[last]:
            return FreeGround(t_s=t_s, view=self._view, blind_m=blind_m, seen_m=seen_m)
        end_m = max(seen_m - 0.5 * SIGMA_M + self._sigma_m * noise, blind_m)
        drops = ~bears[first:]
        right_m, left_m = (float(self._far_m[first + int(np.argmax(drops[:, line]))]) for line in (0, -1))
        crosses = bool(drops[:, 0].any() and drops[:, -1].any())
        sigma_rad = math.sqrt(2.0) * self._sigma_m / self._width_m
        return FreeGround(
            t_s=t_s,
            view=self._view,
            blind_m=blind_m,
            seen_m=end_m,
            end_m=end_m,
            end_sigma_m=self._sigma_m,
            direction_rad=math.atan2(right_m - left_m, self._width_m) + sigma_rad * turn_noise if crosses else None,
            direction_sigma_rad=sigma_rad if crosses else None,
        )
