"""A camera without images: what a stair detector would say of a frame from where the chair stands.

``(t, pose) -> HeadingMeasurement and StairMap, or nothing``. Geometry tells which nosings, walls and ends a frame would show;
``exact`` hands them over almost as they are, for ``vision = "truth"``.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from treadline.angles import DEG
from treadline.mechanics.staircase import Staircase
from treadline.signals import HeadingMeasurement, PinholeCamera, StairMap
from treadline.sim.camera.truth import crossings

EXACT_SIGMA_RAD, EXACT_PLACE_M = 0.05 * DEG, 0.001
"""Noise of ``exact``: small, so that a filter has something to weigh."""
NEAR_M, FAR_M = 0.45, 4.0
"""Depth between which a Kinect shows a nosing sharply enough to be told from the next."""
ASIDES = 13
"""Points along an edge that are asked whether they are in view."""
LEAST_WIDTH_M = 0.3
"""Of an edge in view for it to count: ``perception.nosings`` asks as much of a row."""
RAYS = (12, 9)
"""Columns and rows of the coarse image that tells what fills the view."""
LEAST_WALL = 0.03
"""Share of the coarse image that a wall must fill."""
LEAST_NOSINGS = 2
HEADING_LIMIT_RAD = 45.0 * DEG
END_HEIGHT, END_BEHIND = 0.9, (1.25, 1.9)
"""Where the next step is missed: so many rises above the last nosing, one run behind it; so many runs below and behind it."""
END_SHARE = 0.4
"""Of those points that must be in view."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outlook:
    """What is in view, exactly."""

    direction: Literal["up", "down"]
    heading_rad: float
    nosings_B: Float[np.ndarray, "n 3"]
    """Those in view, the nearest first."""
    depths_m: Float[np.ndarray, " n"]
    """Of the middle of what is seen of each, along the optical axis."""
    widths_m: Float[np.ndarray, " n"]
    """Of what is seen of each."""
    rise_m: float
    run_m: float
    """Mean of the steps in view."""
    ends: bool
    left_wall_m: float | None
    right_wall_m: float | None
    share: float
    """Of the image that shows the flight."""


class Geometry:
    """A staircase in front of a camera on a chair."""

    def __init__(self, staircase: Staircase, calibration: PinholeCamera) -> None:
        self._staircase = staircase
        self._camera = calibration
        steps = [step for step in staircase.steps if not step.missing]
        self._places_W = np.array([[step.x_m, 0.0, step.z_m] for step in steps])
        self._numbers = np.array([step.index for step in steps])
        self._along_W = np.array([[-math.sin(step.yaw_rad), math.cos(step.yaw_rad), 0.0] for step in steps])
        asides = np.linspace(-0.5, 0.5, ASIDES) * staircase.width_m
        self._edges_W = self._places_W[:, None] + asides[:, None] * self._along_W[:, None]
        self._grain_m = staircase.width_m / (ASIDES - 1)
        self._R_BC, self._p_BC = calibration.R_BC, np.array(calibration.mount_m)
        last = staircase.steps[-1]
        self._end_x = last.x_m + max(staircase.landing_m, last.depth_m)

    @cached_property
    def _rays_C(self) -> Float[np.ndarray, "r 3"]:
        camera = self._camera
        u = (np.arange(RAYS[0]) + 0.5) * camera.width_px / RAYS[0]
        v = (np.arange(RAYS[1]) + 0.5) * camera.height_px / RAYS[1]
        across, down = np.meshgrid((u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px)
        return np.stack([across.ravel(), down.ravel(), np.ones(across.size)], axis=1)

    def outlook(self, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"]) -> Outlook | None:
        """Return what is in view from a pose, or None if that is no stair."""
        R_WC, p_WC = R_WB @ self._R_BC, p_WB + R_WB @ self._p_BC
        up = bool(R_WC[0, 2] > 0.0)
        sign = 1.0 if R_WB[1, 1] >= 0.0 else -1.0
        heading = math.atan2(sign * R_WB[1, 0], sign * R_WB[1, 1])
        if abs(heading) > HEADING_LIMIT_RAD:
            return None
        points = (self._edges_W - p_WC) @ R_WC
        shown = self._in_image(points) & ~self._hidden(p_WC)[:, None] & (points[:, :, 2] > NEAR_M) & (points[:, :, 2] < FAR_M)
        seen = self._row(shown.sum(axis=1) * self._grain_m >= LEAST_WIDTH_M, up=up)
        if len(seen) < LEAST_NOSINGS:
            return None
        counts = shown[seen].sum(axis=1)
        first, last = self._places_W[seen[0]], self._places_W[seen[-1]]
        walls, share = self._filled(R_WC, p_WC)
        left, right = walls if sign > 0.0 else walls[::-1]
        return Outlook(
            direction="up" if up else "down",
            heading_rad=heading,
            nosings_B=crossings(self._places_W[seen], self._along_W[seen], R_WB, p_WB),
            depths_m=(points[seen, :, 2] * shown[seen]).sum(axis=1) / counts,
            widths_m=counts * self._grain_m,
            rise_m=float(abs(last[2] - first[2])) / (len(seen) - 1),
            run_m=float(abs(last[0] - first[0])) / (len(seen) - 1),
            ends=self._ends(int(seen[-1]), R_WC, p_WC, up=up),
            left_wall_m=0.5 * self._staircase.width_m - sign * float(p_WB[1]) if left else None,
            right_wall_m=0.5 * self._staircase.width_m + sign * float(p_WB[1]) if right else None,
            share=share,
        )

    def _in_image(self, points_C: Float[np.ndarray, "*n 3"]) -> Bool[np.ndarray, "*n"]:
        camera = self._camera
        z = np.maximum(points_C[..., 2], 1e-6)
        u = camera.fx_px * points_C[..., 0] / z + camera.cx_px
        v = camera.fy_px * points_C[..., 1] / z + camera.cy_px
        inside = (points_C[..., 2] > 0.1) & (np.abs(u - camera.cx_px) < 0.5 * camera.width_px)
        return np.asarray(inside & (np.abs(v - camera.cy_px) < 0.5 * camera.height_px))

    def _hidden(self, p_WC: Float[np.ndarray, " 3"]) -> Bool[np.ndarray, " n"]:
        """Return which nosings are behind the steps between, in the flight's profile."""
        x, z = self._places_W[:, 0] - p_WC[0], self._places_W[:, 2] - p_WC[2]
        part = x[None, :] / np.where(np.abs(x) > 1e-9, x, 1e-9)[:, None]
        return np.asarray(((part > 0.0) & (part < 0.999) & (part * z[:, None] < z[None, :])).any(axis=1))

    def _row(self, seen: Bool[np.ndarray, " n"], *, up: bool) -> Int[np.ndarray, " k"]:
        """Return the nosings in view that follow each other, the nearest first."""
        places = np.flatnonzero(seen)
        if not up:
            places = places[::-1]
        gaps = np.flatnonzero(np.abs(np.diff(self._numbers[places])) > 1)
        return places[: gaps[0] + 1] if gaps.size else places

    def _ends(self, last: int, R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"], *, up: bool) -> bool:
        """Return whether it is seen that no step follows the last nosing in view."""
        staircase = self._staircase
        step = staircase.steps[-1 if up else 0]
        if last != (len(self._places_W) - 1 if up else 0):
            return False
        asides = np.linspace(-0.25, 0.25, 5)
        rise, run = staircase.steps[0].rise_m, staircase.steps[0].depth_m
        if up:
            # Through where the next riser would stand, the landing is to be seen.
            height = p_WC[2] - step.z_m
            drop = height - END_HEIGHT * rise
            x = p_WC[0] + (step.x_m + run - p_WC[0]) * height / drop if drop > 1e-3 else math.inf
            if x > self._end_x:
                return False
            places = np.array([[step.x_m + run, aside, step.z_m + END_HEIGHT * rise] for aside in asides])
        else:
            behind = step.x_m - run * np.linspace(*END_BEHIND, 4)
            places = np.array([[place, aside, step.z_m - rise] for place in behind for aside in asides])
        return bool(self._in_image((places - p_WC) @ R_WC).mean() > END_SHARE)

    def _filled(self, R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"]) -> tuple[tuple[bool, bool], float]:
        """Return whether the walls at +y and at -y are in view, and the share of the image that the flight fills."""
        staircase = self._staircase
        rays = self._rays_C @ R_WC.T
        first, last, slope = self._places_W[0], self._places_W[-1], math.tan(staircase.slope_rad)
        half = 0.5 * staircase.width_m
        with np.errstate(divide="ignore", invalid="ignore"):
            aside = (np.copysign(half, rays[:, 1]) - p_WC[1]) / rays[:, 1]
            below = (first[2] + slope * (p_WC[0] - first[0]) - p_WC[2]) / (rays[:, 2] - slope * rays[:, 0])
        aside = np.where(aside > 0.0, aside, np.inf)
        below = np.where(below > 0.0, below, np.inf)
        on_wall = p_WC[0] + np.minimum(aside, 1e3) * rays[:, 0]
        on_flight = p_WC[0] + np.minimum(below, 1e3) * rays[:, 0]
        wall = (aside < below) & (aside < FAR_M) & (on_wall > 0.0) & (on_wall < last[0])
        left = staircase.walls in ("left", "both") and float((wall & (rays[:, 1] > 0.0)).mean()) > LEAST_WALL
        right = staircase.walls in ("right", "both") and float((wall & (rays[:, 1] < 0.0)).mean()) > LEAST_WALL
        flight = (below <= aside) & (on_flight > first[0]) & (on_flight < last[0])
        return (left, right), float(flight.mean())


class StatisticalCamera:
    """Says what a stair detector would say.

    Args:
        exact: Tell what is in view as it is, but for a trace of noise.
    """

    def __init__(self, staircase: Staircase, calibration: PinholeCamera, rng: np.random.Generator, *, exact: bool = False) -> None:
        self._geometry = Geometry(staircase, calibration)
        self._rng = rng
        self._exact = exact

    def look(
        self, t_s: float, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"]
    ) -> tuple[HeadingMeasurement | StairMap, ...]:
        """Return heading and map of one instant; nothing where a frame would be refused."""
        seen = self._geometry.outlook(R_WB, p_WB)
        if seen is None:
            return ()
        noise = self._rng.standard_normal((len(seen.nosings_B), 2)) * EXACT_PLACE_M
        nosings = seen.nosings_B.copy()
        nosings[:, ::2] += noise
        heading = seen.heading_rad + EXACT_SIGMA_RAD * float(self._rng.standard_normal())
        return (
            HeadingMeasurement(t_s=t_s, heading_rad=heading, sigma_rad=EXACT_SIGMA_RAD, edge_count=len(nosings)),
            StairMap(
                t_s=t_s,
                direction=seen.direction,
                nosings_B=nosings,
                rise_m=seen.rise_m,
                run_m=seen.run_m,
                slope_rad=math.atan2(seen.rise_m, seen.run_m),
                ends=seen.ends,
                left_wall_m=seen.left_wall_m,
                right_wall_m=seen.right_wall_m,
                obstacle_m=None,
            ),
        )
