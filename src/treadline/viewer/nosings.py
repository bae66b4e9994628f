"""Perceived nosings next to the true ones: which the camera could see, which the detector found, which it missed."""

import math

import numpy as np
from jaxtyping import Float

from treadline.angles import rotation_of
from treadline.mechanics.staircase import Staircase
from treadline.signals import PinholeCamera
from treadline.viewer.tape import DEPTH_STEP, Look

HALF_LINE_M = 0.45
"""Half length of a perceived nosing in the scene [m]: a little more than the chair's width."""
MATCH_M = 0.10
"""Largest distance between a perceived nosing and the true one [m]: a third of a run, so that no nosing takes its neighbour's."""
POINTS = 31
"""Points along a nosing at which the depth image is read: 3 cm apart, two of the kept pixels at 1 m."""
HIDDEN_M = 0.10
"""Depth before a nosing from which something hides it [m]: half a riser, more than the noise and the step of the pixels."""
MOST = 0.5
"""Share of a nosing's points that makes a cause its cause: the middle of the nosing decides about its edge."""
LIFT_M = 0.012
"""Lift of the lines above the edges [m], so that the treads do not hide them."""


class SeenNosings:
    """Comparison of perceived and true nosings.

    Args:
        staircase: True stair.
        camera: Camera of the mission.
    """

    def __init__(self, staircase: Staircase, camera: PinholeCamera) -> None:
        self._camera = camera
        self._indices = [step.index for step in staircase.steps if not step.missing]
        self._rises_m = {step.index: step.rise_m for step in staircase.steps}
        self._middles_W = staircase.nosings_W
        half = 0.5 * staircase.width_m
        turns = [(k, step.yaw_rad) for k, steps in enumerate(staircase.flights) for step in steps if not step.missing]
        ends = []
        for middle, (flight, yaw) in zip(self._middles_W, turns, strict=True):
            R_WF, _ = staircase.flight_frame(flight)
            across = R_WF @ np.array([-math.sin(yaw), math.cos(yaw), 0.0])
            ends.append((middle - half * across, middle + half * across))
        self._ends_W = np.array(ends)

    def true_lines(self) -> Float[np.ndarray, "n 2 3"]:
        """Return the true nosings as lines."""
        return (self._ends_W + np.array([0.0, 0.0, LIFT_M])).astype(np.float32)

    def compare(self, look: Look, row: dict[str, float]) -> tuple[list[int], list[int]]:
        """Return the numbers of the true nosings that were perceived and of those that were missed in a frame.

        A nosing is missed if its point in the chair's middle plane is in the image, no farther than the farthest perceived nosing,
        and nothing was perceived there. In a rejected frame all nosings in the image are missed.

        Args:
            row: Row of the tape at the exposure.
        """
        numbers, points_B = self._ahead(row)
        if not len(numbers) or not look.is_judged:
            return [], []
        seen_x = look.nosings_B[:, 0] if len(look.nosings_B) else np.empty(0)
        gaps = np.abs(points_B[:, :1] - seen_x).min(axis=1) if len(seen_x) else np.full(len(numbers), np.inf)
        found = gaps <= MATCH_M
        reach = np.abs(seen_x).max() + MATCH_M if len(seen_x) else np.inf
        missed = ~found & self._in_view(points_B) & (np.abs(points_B[:, 0]) <= reach)
        return [n for n, yes in zip(numbers, found, strict=True) if yes], [n for n, yes in zip(numbers, missed, strict=True) if yes]

    def why_missed(self, number: int, look: Look, row: dict[str, float]) -> str:
        """Return why a true nosing was missed in a frame, by the depth image along the nosing."""
        if look.reason is not None:
            return "the frame is rejected"
        if look.depth_m is None:
            return "its image is not kept"
        depth_m, true_m = self._depths_at(number, look.depth_m, row)
        if not len(true_m):
            return "outside the image"
        blank = np.isnan(depth_m)
        near = depth_m < true_m - HIDDEN_M
        if blank.mean() >= MOST:
            return f"no depth at {100.0 * blank.mean():.0f} % of its pixels"
        if near.mean() >= MOST:
            return f"hidden by something {np.median(true_m[near] - depth_m[near]):.2f} m nearer"
        if not self._riser_in_view(number, row):
            return "its riser is not in the image"
        return f"depth at {100.0 * (1.0 - blank.mean()):.0f} % of its pixels, but too few of its planes for an edge"

    def _riser_in_view(self, number: int, row: dict[str, float]) -> bool:
        """Return whether the lower end of the riser below a nosing is in the image, in the chair's middle plane."""
        numbers, points_B = self._ahead(row)
        R_WB = rotation_of(np.array([row["qw"], row["qx"], row["qy"], row["qz"]]))
        foot_B = points_B[numbers.index(number)] - self._rises_m[number] * R_WB[2]
        return bool(self._in_view(foot_B[None])[0])

    def _depths_at(
        self, number: int, depth_m: Float[np.ndarray, "h w"], row: dict[str, float]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Return measured and true depth at points of a nosing that are in the image, within the perceived width [m]."""
        numbers, points_B = self._ahead(row)
        R_WB = rotation_of(np.array([row["qw"], row["qx"], row["qy"], row["qz"]]))
        along = np.diff(self._ends_W[self._indices.index(number)], axis=0)[0] @ R_WB
        offsets = np.linspace(-HALF_LINE_M, HALF_LINE_M, POINTS)[:, None]
        points = points_B[numbers.index(number)] + offsets * along / np.linalg.norm(along)
        points = points[self._in_view(points)]
        camera = self._camera
        x, y, z = ((points - np.array(camera.mount_m)) @ camera.R_BC).T
        u, v = camera.fx_px * x / z + camera.cx_px, camera.fy_px * y / z + camera.cy_px
        rows = np.clip(np.round(v / DEPTH_STEP).astype(int), 0, depth_m.shape[0] - 1)
        columns = np.clip(np.round(u / DEPTH_STEP).astype(int), 0, depth_m.shape[1] - 1)
        return depth_m[rows, columns], z

    def lines(self, look: Look, row: dict[str, float]) -> tuple[Float[np.ndarray, "s 2 3"], Float[np.ndarray, "m 2 3"]]:
        """Return the perceived nosings in W, and the missed true ones, as lines."""
        R_WB, p_WB = (
            rotation_of(np.array([row["qw"], row["qx"], row["qy"], row["qz"]])),
            np.array([row["x_m"], row["y_m"], row["z_m"]]),
        )
        heading = row["heading_rad"] if look.heading_rad is None else look.heading_rad
        across_B = HALF_LINE_M * np.array([math.sin(heading), math.cos(heading), 0.0])
        middles = look.nosings_B.reshape(-1, 3)
        seen_B = np.stack([middles - across_B, middles + across_B], axis=1)
        seen_W = p_WB + seen_B @ R_WB.T + np.array([0.0, 0.0, 2.0 * LIFT_M])
        _, missed = self.compare(look, row)
        rows = [self._indices.index(number) for number in missed]
        return seen_W.astype(np.float32), (self._ends_W[rows] + np.array([0.0, 0.0, 2.0 * LIFT_M])).astype(np.float32)

    def _ahead(self, row: dict[str, float]) -> tuple[list[int], Float[np.ndarray, "n 3"]]:
        """Return the numbers of the nosings, and their intersections with the chair's middle plane in B."""
        R_WB = rotation_of(np.array([row["qw"], row["qx"], row["qy"], row["qz"]]))
        ends_B = (self._ends_W - np.array([row["x_m"], row["y_m"], row["z_m"]])) @ R_WB
        y0, y1 = ends_B[:, 0, 1], ends_B[:, 1, 1]
        crosses = (y0 * y1 <= 0.0) & (y0 != y1)
        share = np.where(crosses, y0 / np.where(y0 == y1, 1.0, y0 - y1), 0.0)
        points = ends_B[:, 0] + share[:, None] * (ends_B[:, 1] - ends_B[:, 0])
        return [n for n, yes in zip(self._indices, crosses, strict=True) if yes], points[crosses]

    def _in_view(self, points_B: Float[np.ndarray, "n 3"]) -> np.ndarray:
        camera = self._camera
        x, y, z = ((points_B - np.array(camera.mount_m)) @ camera.R_BC).T
        ahead = z > 0.0
        depth = np.where(ahead, z, 1.0)
        u, v = camera.fx_px * x / depth + camera.cx_px, camera.fy_px * y / depth + camera.cy_px
        return np.asarray(ahead & (u >= 0.0) & (u <= camera.width_px) & (v >= 0.0) & (v <= camera.height_px))
