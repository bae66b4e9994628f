"""Exact visibility of a staircase from a camera on the chair: nosings, walls and the end of the flight.

``pose -> Visibility, or nothing``. ``check`` uses it at the start pose; ``plant/sensors/statistical_camera.py`` adds the errors of
a detector.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera
from treadline.core.rotations import Rotation, Vector3
from treadline.core.signals import Direction, SideKind
from treadline.vehicle.staircase import Staircase, Step

NEAR_M, FAR_M = 0.45, 4.0
"""Depth range in which a Kinect resolves adjacent nosings [m]."""
ASIDES = 13
"""Number of points per edge tested for visibility."""
SIDE_ASIDES, END_SEEN_M = 57, 0.01
"""Number of points per edge tested for the visibility of its sides, and distance of the last one in view from a visible end [m]."""
LEAST_WIDTH_M = 0.3
"""Least visible width of an edge [m], as required by ``perception._lattice_kernels``."""
BEYOND_PX, OUTSIDE_PX = 40.0, -1000.0
"""Margin outside the image within which an edge can be detected from its riser [px]; and the margin assigned to hidden edges
[px]."""
RAYS = (12, 9)
"""Columns and rows of the coarse image used for the wall fractions."""
LEAST_NOSINGS = 2
"""Least number of visible nosings of a detectable flight of two steps or more."""
HEADING_LIMIT_RAD = 45.0 * DEG
"""Largest heading of a detectable stair [rad]."""
END_HEIGHT, END_BEHIND = 0.9, (1.25, 1.9)
"""Expected location of the next step beyond the end: height above the last nosing [rises], one run behind it; when descending, the
distance range behind the last nosing [runs], one rise below."""
END_SHARE = 0.4
"""Least visible fraction of the points at the expected location of the next step."""
FAR_FIRST_M = 1.2
"""Depth of the nearest nosing above which a stair is seen from the floor before the flight [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VisibleSide:
    """One side of the flight; distances from the chair's middle, perpendicular to the flight."""

    seen_m: float
    """Distance to which two nosings are in the image [m]."""
    end_m: float
    """Distance to the end of the nosings, where the wall is if there is one [m]."""
    kind: SideKind
    share: float
    """Fraction of the image filled by the wall."""

    @property
    def edge_m(self) -> float | None:
        """Distance to the end of the nosings [m]; None unless two nosings are in the image up to their end."""
        return self.end_m if self.seen_m > self.end_m - END_SEEN_M else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Visibility:
    """Visible part of one flight, without errors."""

    direction: Direction
    heading_rad: float
    numbers: Int[np.ndarray, " n"]
    """Indices of the nosings in the image or slightly outside, nearest first."""
    nosings_B: Float[np.ndarray, "n 3"]
    margins_px: Float[np.ndarray, " n"]
    """Margin of the best ``LEAST_WIDTH_M`` of each nosing from the image border [px], positive inside."""
    depths_m: Float[np.ndarray, " n"]
    """Depth of each nosing along the optical axis, at the middle of the flight [m]."""
    rise_m: float
    run_m: float
    """Mean run of these steps [m]; ``rise_m`` likewise."""
    last: int
    """Index of the last nosing of the flight."""
    ends: bool
    """Whether the absence of a further step is visible."""
    sides: tuple["VisibleSide", "VisibleSide"]
    """Left and right side of the flight."""

    @property
    def seen(self) -> Bool[np.ndarray, " n"]:
        """Mask of the nosings in view."""
        return (self.margins_px > 0.0) & (self.depths_m > NEAR_M) & (self.depths_m < FAR_M)

    @property
    def acceptance_row(self) -> int:
        """Row of the acceptance table: a wall next to the flight and a distant first nosing lower the acceptance."""
        walled = any(side.kind == "wall" for side in self.sides)
        return 2 * int(walled) + int(self.depths_m[0] > FAR_FIRST_M)


def least_nosings(staircase: Staircase) -> int:
    """Return the least number of visible nosings of a detectable flight: one where it has no more."""
    return min(LEAST_NOSINGS, max(plan.count for plan in staircase.plans))


class _Course:
    """Visibility model of flights in line and a camera."""

    def __init__(self, staircase: Staircase, calibration: PinholeCamera) -> None:
        self._staircase = staircase
        self._camera = calibration
        steps = [step for step in staircase.steps if not step.missing]
        self._numbers = np.array([step.index for step in steps])
        flights = np.repeat(np.arange(len(staircase.plans)), [plan.count for plan in staircase.plans])
        self._flights = flights[[not step.missing for step in staircase.steps]]
        self._places_W = np.array([step.nosing_F for step in steps])
        self._along_W = np.array([[-math.sin(step.yaw_rad), math.cos(step.yaw_rad), 0.0] for step in steps])
        asides = np.linspace(-0.5, 0.5, ASIDES) * staircase.width_m
        self._edges_W = self._places_W[:, None] + asides[:, None] * self._along_W[:, None]
        self._asides_m = np.linspace(-0.5, 0.5, SIDE_ASIDES) * staircase.width_m
        self._fine_W = self._places_W[:, None] + self._asides_m[:, None] * self._along_W[:, None]
        self._least = least_nosings(staircase)
        self._best = min(ASIDES, math.ceil(LEAST_WIDTH_M / staircase.width_m * (ASIDES - 1)))
        self._R_BC, self._p_BC = calibration.R_BC, np.array(calibration.mount_m)
        u = (np.arange(RAYS[0]) + 0.5) * calibration.width_px / RAYS[0]
        v = (np.arange(RAYS[1]) + 0.5) * calibration.height_px / RAYS[1]
        across, down = np.meshgrid((u - calibration.cx_px) / calibration.fx_px, (v - calibration.cy_px) / calibration.fy_px)
        self._rays_C = np.stack([across.ravel(), down.ravel(), np.ones(across.size)], axis=1)

    def visibility(self, R_WB: Rotation, p_WB: Vector3) -> Visibility | None:
        """Return the visible stair from a pose, or None without a detectable stair."""
        R_WC, p_WC = R_WB @ self._R_BC, p_WB + R_WB @ self._p_BC
        up = bool(R_WC[0, 2] > 0.0)
        sign = 1.0 if R_WB[1, 1] >= 0.0 else -1.0
        heading = math.atan2(sign * R_WB[1, 0], sign * R_WB[1, 1])
        if abs(heading) > HEADING_LIMIT_RAD:
            return None
        points = (self._edges_W - p_WC) @ R_WC
        # A nosing is hidden by the steps in front, in the profile of the flight.
        x, z = self._places_W[:, 0] - p_WC[0], self._places_W[:, 2] - p_WC[2]
        part = x[None, :] / np.where(np.abs(x) > 1e-9, x, 1e-9)[:, None]
        is_hidden = ((part > 0.0) & (part < 0.999) & (part * z[:, None] < z[None, :])).any(axis=1)
        margins = np.where(is_hidden, OUTSIDE_PX, np.sort(margins_px(self._camera, points), axis=1)[:, -self._best])
        row = self._row(margins > -BEYOND_PX, up=up)
        if len(row) < self._least:
            return None
        first, last = self._places_W[row[0]], self._places_W[row[-1]]
        flight = int(self._flights[row[0]])
        steps = self._staircase.flights[flight]
        sides = self._sides(row, flight, R_WC, p_WC, float(p_WB[1]))
        return Visibility(
            direction="up" if up else "down",
            heading_rad=heading,
            numbers=self._numbers[row],
            nosings_B=crossings(self._places_W[row], self._along_W[row], R_WB, p_WB),
            margins_px=margins[row],
            depths_m=points[row, ASIDES // 2, 2],
            rise_m=float(abs(last[2] - first[2])) / (len(row) - 1) if len(row) > 1 else steps[0].rise_m,
            run_m=float(abs(last[0] - first[0])) / (len(row) - 1)
            if len(row) > 1
            else self._staircase.pitch_m * math.cos(self._staircase.slope_rad),
            last=int(self._numbers[self._flights == flight][-1 if up else 0]),
            ends=self._ends_up(steps, R_WC, p_WC) if up else self._ends_down(steps, R_WC, p_WC),
            sides=sides if sign > 0.0 else sides[::-1],
        )

    def _sides(
        self, row: Int[np.ndarray, " k"], flight: int, R_WC: Rotation, p_WC: Vector3, aside_m: float
    ) -> tuple[VisibleSide, VisibleSide]:
        """Return the sides at +y and -y, from the nosings of one flight; a wall counts however little of it is visible."""
        shown = margins_px(self._camera, (self._fine_W[row] - p_WC) @ R_WC) > 0.0
        walls, sides = self._staircase.walls, []
        for sign, name, share in zip((1.0, -1.0), ("left", "right"), self._wall_shares(flight, R_WC, p_WC), strict=True):
            outward = np.where(shown, sign * (self._asides_m - aside_m), -np.inf).max(axis=1)
            seen_m = float(np.sort(outward)[-self._least])
            end_m = 0.5 * self._staircase.width_m - sign * aside_m
            kind: SideKind = "wall" if walls in (name, "both") else "open"
            sides.append(VisibleSide(seen_m=seen_m, end_m=end_m, kind=kind, share=share))
        return sides[0], sides[1]

    def _row(self, near: Bool[np.ndarray, " n"], *, up: bool) -> Int[np.ndarray, " k"]:
        """Return consecutive nosings without a gap, nearest first, of the nearest flight with enough visible nosings."""
        places = np.flatnonzero(near)
        if not up:
            places = places[::-1]
        apart = (np.abs(np.diff(self._numbers[places])) > 1) | (np.diff(self._flights[places]) != 0)
        rows = np.split(places, np.flatnonzero(apart) + 1)
        row = rows[0]
        for other in rows[1:]:
            # The remainder of a flight no longer hides the one across the landing; a gap within a flight hides the nosings beyond.
            if len(row) >= self._least or self._flights[other[0]] == self._flights[row[0]]:
                break
            row = other
        return np.asarray(row)

    def _ends_up(self, flight: Sequence[Step], R_WC: Rotation, p_WC: Vector3) -> bool:
        """Return whether the landing is visible through the location of a further riser."""
        staircase, last = self._staircase, flight[-1]
        height, drop = p_WC[2] - last.z_m, p_WC[2] - last.z_m - END_HEIGHT * last.rise_m
        run = flight[0].depth_m
        there = last.x_m + run
        # Across a landing between two flights the next flight is visible at any distance.
        end = last.x_m + max(staircase.landing_m, run) if last is staircase.steps[-1] else math.inf
        if drop <= 0.0 or p_WC[0] + (there - p_WC[0]) * height / drop > end:
            return False
        return self._shown([(there, aside, last.z_m + END_HEIGHT * last.rise_m) for aside in (-0.25, 0.0, 0.25)], R_WC, p_WC)

    def _ends_down(self, flight: Sequence[Step], R_WC: Rotation, p_WC: Vector3) -> bool:
        """Return whether the floor is visible beyond the location of a further tread."""
        first = flight[0]
        behind = [first.x_m - part * first.depth_m for part in np.linspace(*END_BEHIND, 4)]
        return self._shown([(x, aside, first.z_m - first.rise_m) for x in behind for aside in (-0.25, 0.0, 0.25)], R_WC, p_WC)

    def _shown(self, places_W: list[tuple[float, float, float]], R_WC: Rotation, p_WC: Vector3) -> bool:
        return float((margins_px(self._camera, (np.array(places_W) - p_WC) @ R_WC) > 0.0).mean()) > END_SHARE

    def _wall_shares(self, flight: int, R_WC: Rotation, p_WC: Vector3) -> tuple[float, float]:
        """Return the fractions of the image that walls at +y and -y fill."""
        staircase = self._staircase
        if staircase.walls == "none":
            return 0.0, 0.0
        rays = self._rays_C @ R_WC.T
        places = self._places_W[self._flights == flight]
        first, last, slope = places[0], places[-1], math.tan(staircase.plans[flight].slope_rad)
        half = 0.5 * staircase.width_m
        with np.errstate(divide="ignore", invalid="ignore"):
            aside = (np.copysign(half, rays[:, 1]) - p_WC[1]) / rays[:, 1]
            below = (first[2] + slope * (p_WC[0] - first[0]) - p_WC[2]) / (rays[:, 2] - slope * rays[:, 0])
        below = np.where(below > 0.0, below, np.inf)
        x = p_WC[0] + np.clip(aside, 0.0, FAR_M) * rays[:, 0]
        shown = (aside > 0.0) & (aside < np.minimum(below, FAR_M)) & (x > staircase.flights[flight][0].x_m) & (x < last[0])
        return float((shown & (rays[:, 1] > 0.0)).mean()), float((shown & (rays[:, 1] < 0.0)).mean())


def margins_px(camera: PinholeCamera, points_C: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
    """Return the distance of points from the border of a camera's image [px], positive inside."""
    z = np.maximum(points_C[..., 2], 1e-6)
    u = np.abs(camera.fx_px * points_C[..., 0] / z + camera.cx_px - 0.5 * (camera.width_px - 1))
    v = np.abs(camera.fy_px * points_C[..., 1] / z + camera.cy_px - 0.5 * (camera.height_px - 1))
    inside = np.minimum(0.5 * camera.width_px - u, 0.5 * camera.height_px - v)
    return np.where(points_C[..., 2] > 0.1, np.maximum(inside, OUTSIDE_PX), OUTSIDE_PX)


class Geometry:
    """Visibility model of a staircase and a camera: each course of flights in line without occlusion by the others."""

    def __init__(self, staircase: Staircase, calibration: PinholeCamera) -> None:
        self._staircase = staircase
        self._frames = [staircase.flight_frame(course.start) for course in staircase.courses]
        self._courses = [_Course(staircase.alone(k), calibration) for k in range(len(self._frames))]

    def visibility(self, R_WB: Rotation, p_WB: Vector3) -> Visibility | None:
        """Return the visible part of the chair's own course, or of a neighbouring one; None without a detectable stair."""
        own = self._staircase.course_of(self._staircase.flight_at(p_WB, R_WB))
        for k in (own, own + 1, own - 1):
            if 0 <= k < len(self._courses):
                R_WF, p_WF = self._frames[k]
                seen = self._courses[k].visibility(R_WF.T @ R_WB, R_WF.T @ (p_WB - p_WF))
                if seen is not None:
                    return seen
        return None


def crossings(
    places_W: Float[np.ndarray, "n 3"], along_W: Float[np.ndarray, "n 3"], R_WB: Rotation, p_WB: Vector3
) -> Float[np.ndarray, "n 3"]:
    """Return the intersections of edges, extended beyond the stair's width, with the chair's middle plane, in B [m]."""
    places, along = (places_W - p_WB) @ R_WB, along_W @ R_WB
    points = places - (places[:, 1] / along[:, 1])[:, None] * along
    points[:, 1] = 0.0
    return np.asarray(points)
