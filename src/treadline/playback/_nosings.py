"""Perceived nosings next to the true ones, in one frame and over a run: ``stair maps, poses, Staircase -> found, missed, why``.

``NosingComparison`` judges one frame; ``perceived_nosings`` judges all frames of a run.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.camera_images import PinholeCamera
from treadline.core.rotations import Rotation, Vector3, rotation_of
from treadline.playback._recording import Recording
from treadline.vehicle.staircase import Staircase

MATCH_SHARE = 1.0 / 3.0
"""Largest distance between a perceived and a true nosing as a share of the distance between neighbours: below a half, no nosing
takes its neighbour's place."""
HALF_LINE_M = 0.45
"""Half length of a perceived nosing [m]: a little more than the chair's width."""
POINTS = 31
"""Points along a nosing at which a depth image is read: 3 cm apart, two pixels of a quarter of the image at 1 m."""
HIDDEN_M = 0.10
"""Depth before a nosing from which something hides it [m]: half a riser, more than the noise and the step of the pixels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameNosings:
    """Numbers of true nosings in one frame, counted from 1 at the lowest step."""

    t_s: float
    """Exposure time of the frame [s]."""
    found: tuple[int, ...]
    """True nosings that were perceived."""
    missed: tuple[int, ...]
    """True nosings in the image that were not perceived, see ``NosingComparison.compare``."""


def missed_text(frames: Sequence[FrameNosings]) -> str:
    """Return one sentence about the missed nosings of a whole run."""
    missing = [frame for frame in frames if frame.missed]
    if not missing:
        return f"no nosing was missed in {len(frames)} frame{'' if len(frames) == 1 else 's'} with a perceived stair"
    parts = []
    for number in sorted({number for frame in missing for number in frame.missed}):
        times_s = [frame.t_s for frame in missing if number in frame.missed]
        first_s, last_s, count = times_s[0], times_s[-1], len(times_s)
        where = f"one frame ({first_s:.2f} s)" if count == 1 else f"{count} frames ({first_s:.2f} s to {last_s:.2f} s)"
        parts.append(f"nosing {number} in {where}")
    return f"{len(missing)} of {len(frames)} frames with a perceived stair missed a nosing: {'; '.join(parts)}"


def in_runs(numbers: Sequence[int]) -> str:
    """Return sorted numbers with consecutive ones as ranges: 3–5, 7."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and number == parts[-1][-1] + 1:
            parts[-1].append(number)
        else:
            parts.append([number])
    return ", ".join(str(part[0]) if len(part) == 1 else f"{part[0]}–{part[-1]}" for part in parts) or "none"


def perceived_text(count: int, found: Sequence[int] | None) -> str:
    """Return how many nosings a frame perceives, the numbers of the true ones, and how many are none.

    Args:
        count: Perceived nosings.
        found: Numbers of the true nosings among them; None if the stair is unknown.
    """
    text = f"perceives {count} nosing{'' if count == 1 else 's'}"
    if found is None or not count:
        return text
    if not found:
        return f"{text}, and no true one among them"
    if len(found) == count:
        return f"{text}: {in_runs(found)}"
    return f"{text}: {in_runs(found)}, and {count - len(found)} where no true one is"


class NosingComparison:
    """Comparison of perceived and true nosings.

    Args:
        staircase: True stair.
        camera: Camera of the mission.
    """

    def __init__(self, staircase: Staircase, camera: PinholeCamera) -> None:
        self.camera = camera
        self._within_m = MATCH_SHARE * staircase.pitch_m
        steps = [(k, step) for k, flight in enumerate(staircase.flights) for step in flight if not step.missing]
        self.numbers = np.array([step.index + 1 for _, step in steps])
        """Numbers of the nosings, counted from 1 at the lowest step."""
        half_m = 0.5 * staircase.width_m
        ends, onward = [], []
        for middle, (flight, step) in zip(staircase.nosings_W, steps, strict=True):
            c, s = math.cos(step.yaw_rad), math.sin(step.yaw_rad)
            R_WF, _ = staircase.flight_frame(flight)
            across = R_WF @ np.array([-s, c, 0.0])
            ends.append((middle - half_m * across, middle + half_m * across))
            onward.append(R_WF @ np.array([c, s, 0.0]))
        self.ends_W = np.array(ends)
        """Right and left end of each nosing in W [m], of shape (n, 2, 3)."""
        half_rise_m, half_run_m = (0.5 * staircase.pitch_m * f(staircase.slope_rad) for f in (math.sin, math.cos))
        # An edge shows only where the surfaces on its two sides do: to the middle of the riser and to the middle of the tread.
        riser_W = np.broadcast_to([0.0, 0.0, -half_rise_m], (len(onward), 3))
        self.sides_W = np.stack([riser_W, half_run_m * np.array(onward)])
        """Vectors from each nosing to the middles of its riser and of its tread in W [m], of shape (2, n, 3)."""

    def compare(
        self, nosings_B: Float[np.ndarray, "n 3"], R_WB: Rotation, p_WB: Vector3
    ) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return the numbers of the true nosings that were perceived and of those that were missed in a frame.

        A nosing is missed if nothing was perceived there, and if it lies between two found ones, or its riser and its tread are in
        the image in the chair's middle plane, no farther than the farthest perceived nosing. In a frame without a perceived
        nosing all nosings in the image are missed.

        Args:
            nosings_B: Perceived nosings in the chair's middle plane.
            R_WB: Attitude at the exposure.
            p_WB: Position at the exposure.
        """
        crosses, points_B = self.ahead(R_WB, p_WB)
        numbers, seen = self.numbers[crosses], nosings_B[np.isfinite(nosings_B).all(axis=1)]
        gaps = np.linalg.norm(points_B[:, None] - seen[None], axis=2).min(axis=1, initial=np.inf)
        found = gaps <= self._within_m
        reach_m = np.abs(seen[:, 0]).max() + self._within_m if len(seen) else np.inf
        in_view = np.logical_and.reduce([self.in_view(points_B + side[crosses] @ R_WB) for side in self.sides_W])
        places = np.flatnonzero(found)
        between = np.zeros(len(found), dtype=bool)
        if len(places):
            between[places[0] : places[-1]] = True
        missed = ~found & (between | (in_view & (np.abs(points_B[:, 0]) <= reach_m)))
        return tuple(numbers[found].tolist()), tuple(numbers[missed].tolist())

    def ahead(self, R_WB: Rotation, p_WB: Vector3) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, "k 3"]]:
        """Return which nosings cross the chair's middle plane, and their intersections with it in B [m]."""
        ends_B = (self.ends_W - p_WB) @ R_WB
        y0, y1 = ends_B[:, 0, 1], ends_B[:, 1, 1]
        crosses = (y0 * y1 <= 0.0) & (y0 != y1)
        share = np.where(crosses, y0 / np.where(y0 == y1, 1.0, y0 - y1), 0.0)
        return crosses, (ends_B[:, 0] + share[:, None] * (ends_B[:, 1] - ends_B[:, 0]))[crosses]

    def in_view(self, points_B: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Return which points are in the image."""
        camera = self.camera
        u, v, z = pixels_of(camera, points_B)
        inside = (u >= 0.0) & (u <= camera.width_px) & (v >= 0.0) & (v <= camera.height_px)
        return np.asarray((z > 0.0) & inside)

    def why_missed(self, number: int, depth_m: Float[np.ndarray, "h w"], R_WB: Rotation, p_WB: Vector3) -> str:
        """Return why a true nosing was missed in a frame, by the depth along it: the cause of at least half of its points.

        Args:
            depth_m: Depth image, possibly of every n-th row and column [m].
        """
        measured_m, true_m = self._depths_at(number, depth_m, R_WB, p_WB)
        if not len(true_m):
            return "outside the image"
        blank, near = np.isnan(measured_m), measured_m < true_m - HIDDEN_M
        if blank.mean() >= 0.5:
            return f"no depth at {100.0 * blank.mean():.0f} % of its pixels"
        if near.mean() >= 0.5:
            return f"hidden by something {np.median(true_m[near] - measured_m[near]):.2f} m nearer"
        foot_B = self._middle_of(number, R_WB, p_WB) + 2.0 * self.sides_W[0, self.place_of(number)] @ R_WB
        if not self.in_view(foot_B[None])[0]:
            return "its riser is not in the image"
        return f"depth at {100.0 * (1.0 - blank.mean()):.0f} % of its pixels, but too few of its planes for an edge"

    def place_of(self, number: int) -> int:
        """Return the position of a nosing among ``ends_W``."""
        return int(self.numbers.tolist().index(number))

    def _middle_of(self, number: int, R_WB: Rotation, p_WB: Vector3) -> Vector3:
        """Return the intersection of a nosing with the chair's middle plane in B [m]."""
        crosses, points_B = self.ahead(R_WB, p_WB)
        return np.asarray(points_B[self.numbers[crosses].tolist().index(number)])

    def _depths_at(
        self, number: int, depth_m: Float[np.ndarray, "h w"], R_WB: Rotation, p_WB: Vector3
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Return measured and true depth at points of a nosing that are in the image, within the perceived width [m]."""
        along = np.diff(self.ends_W[self.place_of(number)], axis=0)[0] @ R_WB
        offsets = np.linspace(-HALF_LINE_M, HALF_LINE_M, POINTS)[:, None]
        points = self._middle_of(number, R_WB, p_WB) + offsets * along / np.linalg.norm(along)
        u, v, z = pixels_of(self.camera, points[self.in_view(points)])
        step = round(self.camera.width_px / depth_m.shape[1])
        rows = np.clip(np.round(v / step).astype(int), 0, depth_m.shape[0] - 1)
        columns = np.clip(np.round(u / step).astype(int), 0, depth_m.shape[1] - 1)
        return depth_m[rows, columns], z


def pixels_of(
    camera: PinholeCamera, points_B: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return column, row and depth of points [px, px, m]; of points behind the camera, the depth alone counts."""
    x, y, z = ((points_B - np.array(camera.mount_m)) @ camera.R_BC).T
    depth = np.where(z > 0.0, z, 1.0)
    return camera.fx_px * x / depth + camera.cx_px, camera.fy_px * y / depth + camera.cy_px, z


def perceived_nosings(recording: Recording) -> tuple[FrameNosings, ...] | None:
    """Return the nosings of every frame with a perceived stair; None if the stair or the chair's place is unknown."""
    comparison = comparison_of(recording)
    if comparison is None or not recording.has_poses:
        return None
    frames = []
    for seen in recording.maps:
        k = recording.index_at(seen.t_s)
        found, missed = comparison.compare(seen.nosings_B, rotation_of(recording.quat_WB[k]), recording.p_WB[k])
        frames.append(FrameNosings(t_s=seen.t_s, found=found, missed=missed))
    return tuple(frames)


def comparison_of(recording: Recording) -> NosingComparison | None:
    """Return the comparison for a recording's stair and camera; None if the stair is unknown."""
    scenario, staircase = recording.scenario, recording.staircase
    if scenario is None or staircase is None:
        return None
    rear = scenario.drive.direction == "down"
    return NosingComparison(staircase, recording.chair.camera_at(scenario.sensors.rows_px, rear=rear))
