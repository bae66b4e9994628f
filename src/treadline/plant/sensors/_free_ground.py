"""Ground ahead of the camera by the stair's geometry, with the errors of a detector: ``pose -> FreeGround``.

Points on the chair's present level, over the width that the chair sweeps, are in the image or not, and ground bears them or not.
Things that stand on the ground hide nothing here: what rises bears.
"""

import math

import numpy as np
from jaxtyping import Float

from treadline.core.camera_images import PinholeCamera
from treadline.core.signals import FreeGround
from treadline.scenario.chair import ChairDescription
from treadline.scenario.stair import RISE_M
from treadline.vehicle.stair_solids import ground_m, stair_surfaces
from treadline.vehicle.staircase import Staircase
from treadline.vehicle.visibility import margins_px

RANGE_M = 2.0
"""Largest distance from mid-track at which ground is measured [m]: a pixel row of a Kinect covers 17 mm of floor there, and as
much again at 2.6 m."""
SIGMA_M = 0.010
"""Standard deviation of the measured end of the ground [m]: that of a falling flight's nosing at 2 to 2.5 m depth, the most of the
range, in ``data/cameras/statistical.json``."""
GRAIN_M = 0.01
"""Distance between two points along the viewing direction [m]: one standard deviation."""
LINES = 5
"""Number of lines of points over the swept width: at 30° of heading an edge is cut within 5 cm of its nearest point."""


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
        self._camera, self._rng, self._sigma_m = calibration, rng, sigma_m
        self._way = 1.0 if calibration.R_BC[0, 2] > 0.0 else -1.0
        self._pulley_B = np.array([self._way * 0.5 * chair.tracks.flat_run_m, 0.0, chair.tracks.pulley_radius_m])
        self._half_m = chair.swept_half_m
        self._far_m = np.arange(0.5 * chair.tracks.flat_run_m, RANGE_M, GRAIN_M)
        far, aside = np.meshgrid(self._far_m, np.linspace(-self._half_m, self._half_m, LINES), indexing="ij")
        self._points = np.stack([far.ravel(), aside.ravel()], axis=1)

    def look(self, t_s: float, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"]) -> FreeGround:
        """Return the ground ahead at a pose of the chair."""
        ahead = self._way * R_WB[:2, 0] / math.hypot(*R_WB[:2, 0])
        places = p_WB[:2] + self._points @ np.array([ahead, [-ahead[1], ahead[0]]])
        x, y, _, _, half_length, half_width, _ = self._surfaces.T
        near = self._surfaces[np.hypot(x - p_WB[0], y - p_WB[1]) < RANGE_M + np.hypot(half_length, half_width)]
        level = float(ground_m(near, (p_WB + R_WB @ self._pulley_B)[None])[0])
        if not math.isfinite(level):  # the pulley is beyond the end
            level = float(p_WB[2])
        # No flight rises by more than 45°: what is higher belongs to another flight, above this one.
        tops = ground_m(near, np.column_stack([places, level + self._points[:, 0]]))
        bears = (tops > level - RISE_M[0]).reshape(-1, LINES)
        seen = self._in_image(places, level, R_WB, p_WB).reshape(-1, LINES).all(axis=1)
        return self._measured(t_s, seen, bears)

    def _in_image(
        self, places: Float[np.ndarray, "n 2"], level: float, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"]
    ) -> Float[np.ndarray, " n"]:
        camera = self._camera
        points_B = (np.column_stack([places, np.full(len(places), level)]) - p_WB) @ R_WB
        return np.asarray(margins_px(camera, (points_B - camera.mount_m) @ camera.R_BC) > 0.0)

    def _measured(self, t_s: float, seen: Float[np.ndarray, " n"], bears: Float[np.ndarray, "n k"]) -> FreeGround:
        """Return the measurement of one frame; each takes the same number of random draws."""
        noise, turn_noise = self._rng.standard_normal(2).tolist()
        first = int(seen.argmax()) if seen.any() else len(seen) - 1
        whole = seen & bears.all(axis=1)
        stop = first + int((~whole[first:]).argmax()) if not whole[first:].all() else len(seen) - 1
        near_m, far_m = float(self._far_m[first]), float(self._far_m[stop])
        view = "front" if self._way > 0.0 else "rear"
        if stop == first or whole[stop] or not seen[stop]:
            return FreeGround(t_s=t_s, view=view, blind_m=near_m, seen_m=far_m)
        ends = np.where(bears[first:].all(axis=0), np.inf, self._far_m[first + (~bears[first:]).argmax(axis=0)])
        right_m, *_, left_m = ends.tolist()
        turn_sigma_rad = math.sqrt(2.0) * self._sigma_m / (2.0 * self._half_m)
        crosses = math.isfinite(right_m) and math.isfinite(left_m)
        end_m = max(far_m - 0.5 * GRAIN_M + self._sigma_m * noise, near_m)
        return FreeGround(
            t_s=t_s,
            view=view,
            blind_m=near_m,
            seen_m=end_m,
            end_m=end_m,
            end_sigma_m=self._sigma_m,
            direction_rad=math.atan2(right_m - left_m, 2.0 * self._half_m) + turn_sigma_rad * turn_noise if crosses else None,
            direction_sigma_rad=turn_sigma_rad if crosses else None,
        )
