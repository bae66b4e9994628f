"""Perceived nosings next to the true ones in one frame: lines in the scene, and why a nosing was missed."""

import math

import numpy as np
from jaxtyping import Float

from treadline.core.angles import rotation_of
from treadline.playback.nosing_matches import NosingComparison
from treadline.view.tape import DEPTH_STEP, Look

HALF_LINE_M = 0.45
"""Half length of a perceived nosing in the scene [m]: a little more than the chair's width."""
POINTS = 31
"""Points along a nosing at which the depth image is read: 3 cm apart, two of the kept pixels at 1 m."""
HIDDEN_M = 0.10
"""Depth before a nosing from which something hides it [m]: half a riser, more than the noise and the step of the pixels."""
MOST = 0.5
"""Share of a nosing's points that makes a cause its cause: the middle of the nosing decides about its edge."""
LIFT_M = 0.012
"""Lift of the lines above the edges [m], so that the treads do not hide them."""


class SeenNosings(NosingComparison):
    """Comparison of perceived and true nosings in the frames of a tape; nosings are counted from 1 at the lowest step.

    Args:
        staircase: True stair.
        camera: Camera of the mission.
    """

    def true_lines(self) -> Float[np.ndarray, "n 2 3"]:
        """Return the true nosings as lines."""
        return (self.ends_W + np.array([0.0, 0.0, LIFT_M])).astype(np.float32)

    def judge(self, look: Look, row: dict[str, float]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return the numbers of the true nosings that were perceived and of those that were missed in a frame.

        Args:
            row: Row of the tape at the exposure.
        """
        return self.compare(look.nosings_B.reshape(-1, 3), *pose_of(row)) if look.is_judged else ((), ())

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

    def _point_of(self, number: int, row: dict[str, float]) -> Float[np.ndarray, " 3"]:
        """Return the intersection of a nosing with the chair's middle plane in B [m]."""
        crosses, points_B = self.ahead(*pose_of(row))
        return np.asarray(points_B[self.numbers[crosses].tolist().index(number)])

    def _place_of(self, number: int) -> int:
        return int(self.numbers.tolist().index(number))

    def _riser_in_view(self, number: int, row: dict[str, float]) -> bool:
        """Return whether the lower end of the riser below a nosing is in the image, in the chair's middle plane."""
        R_WB, _ = pose_of(row)
        foot_B = self._point_of(number, row) + 2.0 * self.sides_W[0, self._place_of(number)] @ R_WB
        return bool(self.in_view(foot_B[None])[0])

    def _depths_at(
        self, number: int, depth_m: Float[np.ndarray, "h w"], row: dict[str, float]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Return measured and true depth at points of a nosing that are in the image, within the perceived width [m]."""
        R_WB, _ = pose_of(row)
        along = np.diff(self.ends_W[self._place_of(number)], axis=0)[0] @ R_WB
        offsets = np.linspace(-HALF_LINE_M, HALF_LINE_M, POINTS)[:, None]
        points = self._point_of(number, row) + offsets * along / np.linalg.norm(along)
        points = points[self.in_view(points)]
        camera = self.camera
        x, y, z = ((points - np.array(camera.mount_m)) @ camera.R_BC).T
        u, v = camera.fx_px * x / z + camera.cx_px, camera.fy_px * y / z + camera.cy_px
        rows = np.clip(np.round(v / DEPTH_STEP).astype(int), 0, depth_m.shape[0] - 1)
        columns = np.clip(np.round(u / DEPTH_STEP).astype(int), 0, depth_m.shape[1] - 1)
        return depth_m[rows, columns], z

    def lines(self, look: Look, row: dict[str, float]) -> tuple[Float[np.ndarray, "s 2 3"], Float[np.ndarray, "m 2 3"]]:
        """Return the perceived nosings in W, and the missed true ones, as lines."""
        R_WB, p_WB = pose_of(row)
        heading = row["heading_rad"] if look.heading_rad is None else look.heading_rad
        across_B = HALF_LINE_M * np.array([math.sin(heading), math.cos(heading), 0.0])
        middles = look.nosings_B.reshape(-1, 3)
        seen_B = np.stack([middles - across_B, middles + across_B], axis=1)
        seen_W = p_WB + seen_B @ R_WB.T + np.array([0.0, 0.0, 2.0 * LIFT_M])
        _, missed = self.judge(look, row)
        missed_W = self.ends_W[[self._place_of(number) for number in missed]] + np.array([0.0, 0.0, 2.0 * LIFT_M])
        return seen_W.astype(np.float32), missed_W.astype(np.float32)


def pose_of(row: dict[str, float]) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    """Return rotation and position of the chair in a row of a tape."""
    quaternion = np.array([row["qw"], row["qx"], row["qy"], row["qz"]])
    return rotation_of(quaternion), np.array([row["x_m"], row["y_m"], row["z_m"]])
