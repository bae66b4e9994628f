"""What of a staircase is in view of a camera on a chair, exactly: nosings, walls and the flight's end.

``pose -> Outlook, or nothing``. ``devices/statistical.py`` then errs as a detector does.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from treadline.angles import DEG
from treadline.mechanics.staircase import Staircase, Step
from treadline.signals import PinholeCamera

NEAR_M, FAR_M = 0.45, 4.0
"""Depth between which a Kinect shows a nosing sharply enough to be told from the next."""
ASIDES = 13
"""Points along an edge that are asked whether they are in view."""
LEAST_WIDTH_M = 0.3
"""Of an edge in view for it to count: ``perception.nosings`` asks as much of a row."""
BEYOND_PX, OUTSIDE_PX = 40.0, -1000.0
"""How far outside the image an edge still may be told, for its riser is seen; and the margin of what is hidden."""
RAYS = (12, 9)
"""Columns and rows of the coarse image that tells how much of the view walls fill."""
LEAST_NOSINGS = 2
HEADING_LIMIT_RAD = 45.0 * DEG
END_HEIGHT, END_BEHIND = 0.9, (1.25, 1.9)
"""Where the next step is missed: so many rises above the last nosing, one run behind it; so many runs behind and below it."""
END_SHARE = 0.4
"""Of those points that must be in view."""
FAR_FIRST_M = 1.2
"""Depth from which the nearest nosing is seen from the floor before the flight."""
Direction = Literal["up", "down"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wall:
    """A wall beside the flight."""

    free_m: float
    """From the chair's middle, square to the wall."""
    share: float
    """Of the image."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outlook:
    """What is in view of one flight, exactly."""

    direction: Direction
    heading_rad: float
    numbers: Int[np.ndarray, " n"]
    """Which nosings are in the image or a little outside it, the nearest first."""
    nosings_B: Float[np.ndarray, "n 3"]
    margins_px: Float[np.ndarray, " n"]
    """How far inside the image the best ``LEAST_WIDTH_M`` of each lies."""
    depths_m: Float[np.ndarray, " n"]
    """Along the optical axis, at the middle of the flight."""
    rise_m: float
    run_m: float
    """Mean of the steps above."""
    last: int
    """Number of the flight's last nosing."""
    ends: bool
    """Whether it would be seen that no step follows that one."""
    left: Wall | None
    right: Wall | None

    @property
    def seen(self) -> Bool[np.ndarray, " n"]:
        """Which nosings are in view."""
        return (self.margins_px > 0.0) & (self.depths_m > NEAR_M) & (self.depths_m < FAR_M)

    @property
    def doubt(self) -> int:
        """Return which row of acceptance holds: a wall beside the flight and a first nosing far away make a detector careful."""
        walled = self.left is not None or self.right is not None
        return 2 * int(walled) + int(self.depths_m[0] > FAR_FIRST_M)


class Geometry:
    """A staircase in front of a camera on a chair."""

    def __init__(self, staircase: Staircase, calibration: PinholeCamera) -> None:
        self._staircase = staircase
        self._camera = calibration
        steps = [step for step in staircase.steps if not step.missing]
        self._numbers = np.array([step.index for step in steps])
        places = np.array([place for place, step in enumerate(staircase.steps) if not step.missing])
        self._flights = places * staircase.flight_count // len(staircase.steps)
        self._places_W = np.array([step.nosing_F for step in steps])
        self._along_W = np.array([[-math.sin(step.yaw_rad), math.cos(step.yaw_rad), 0.0] for step in steps])
        asides = np.linspace(-0.5, 0.5, ASIDES) * staircase.width_m
        self._edges_W = self._places_W[:, None] + asides[:, None] * self._along_W[:, None]
        self._best = min(ASIDES, math.ceil(LEAST_WIDTH_M / staircase.width_m * (ASIDES - 1)))
        self._R_BC, self._p_BC = calibration.R_BC, np.array(calibration.mount_m)
        u = (np.arange(RAYS[0]) + 0.5) * calibration.width_px / RAYS[0]
        v = (np.arange(RAYS[1]) + 0.5) * calibration.height_px / RAYS[1]
        across, down = np.meshgrid((u - calibration.cx_px) / calibration.fx_px, (v - calibration.cy_px) / calibration.fy_px)
        self._rays_C = np.stack([across.ravel(), down.ravel(), np.ones(across.size)], axis=1)

    def outlook(self, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"]) -> Outlook | None:
        """Return what is in view from a pose, or None if that is no stair."""
        R_WC, p_WC = R_WB @ self._R_BC, p_WB + R_WB @ self._p_BC
        up = bool(R_WC[0, 2] > 0.0)
        sign = 1.0 if R_WB[1, 1] >= 0.0 else -1.0
        heading = math.atan2(sign * R_WB[1, 0], sign * R_WB[1, 1])
        if abs(heading) > HEADING_LIMIT_RAD:
            return None
        points = (self._edges_W - p_WC) @ R_WC
        margins = np.where(self._hidden(p_WC), OUTSIDE_PX, np.sort(self._margins(points), axis=1)[:, -self._best])
        row = self._row(margins > -BEYOND_PX, up=up)
        if len(row) < LEAST_NOSINGS:
            return None
        first, last = self._places_W[row[0]], self._places_W[row[-1]]
        flight = int(self._flights[row[0]])
        steps = self._staircase.flights[flight]
        left, right = self._walls(flight, R_WC, p_WC, p_WB)
        return Outlook(
            direction="up" if up else "down",
            heading_rad=heading,
            numbers=self._numbers[row],
            nosings_B=crossings(self._places_W[row], self._along_W[row], R_WB, p_WB),
            margins_px=margins[row],
            depths_m=points[row, ASIDES // 2, 2],
            rise_m=float(abs(last[2] - first[2])) / (len(row) - 1),
            run_m=float(abs(last[0] - first[0])) / (len(row) - 1),
            last=int(self._numbers[self._flights == flight][-1 if up else 0]),
            ends=self._ends_up(steps, R_WC, p_WC) if up else self._ends_down(steps, R_WC, p_WC),
            left=left if sign > 0.0 else right,
            right=right if sign > 0.0 else left,
        )

    def _margins(self, points_C: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Return how far inside the image points are, negative outside."""
        camera = self._camera
        z = np.maximum(points_C[..., 2], 1e-6)
        u = np.abs(camera.fx_px * points_C[..., 0] / z + camera.cx_px - 0.5 * (camera.width_px - 1))
        v = np.abs(camera.fy_px * points_C[..., 1] / z + camera.cy_px - 0.5 * (camera.height_px - 1))
        inside = np.minimum(0.5 * camera.width_px - u, 0.5 * camera.height_px - v)
        return np.where(points_C[..., 2] > 0.1, np.maximum(inside, OUTSIDE_PX), OUTSIDE_PX)

    def _hidden(self, p_WC: Float[np.ndarray, " 3"]) -> Bool[np.ndarray, " n"]:
        """Return which nosings are behind the steps between, in the flight's profile."""
        x, z = self._places_W[:, 0] - p_WC[0], self._places_W[:, 2] - p_WC[2]
        part = x[None, :] / np.where(np.abs(x) > 1e-9, x, 1e-9)[:, None]
        return np.asarray(((part > 0.0) & (part < 0.999) & (part * z[:, None] < z[None, :])).any(axis=1))

    def _row(self, near: Bool[np.ndarray, " n"], *, up: bool) -> Int[np.ndarray, " k"]:
        """Return the nosings that follow each other without a gap, the nearest first: of the nearest flight that shows enough."""
        places = np.flatnonzero(near)
        if not up:
            places = places[::-1]
        apart = (np.abs(np.diff(self._numbers[places])) > 1) | (np.diff(self._flights[places]) != 0)
        rows = np.split(places, np.flatnonzero(apart) + 1)
        row = rows[0]
        for other in rows[1:]:
            # What is left of a flight hides the one across the landing no longer; a gap within a flight hides what is beyond it.
            if len(row) >= LEAST_NOSINGS or self._flights[other[0]] == self._flights[row[0]]:
                break
            row = other
        return np.asarray(row)

    def _ends_up(self, flight: Sequence[Step], R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"]) -> bool:
        """Return whether the landing is to be seen through where another riser would stand."""
        staircase, last = self._staircase, flight[-1]
        height, drop = p_WC[2] - last.z_m, p_WC[2] - last.z_m - END_HEIGHT * last.rise_m
        run = flight[0].depth_m
        there = last.x_m + run
        # Of a landing between two flights the further one is seen, which is as far away.
        end = last.x_m + max(staircase.landing_m, run) if last is staircase.steps[-1] else math.inf
        if drop <= 0.0 or p_WC[0] + (there - p_WC[0]) * height / drop > end:
            return False
        return self._shown([(there, aside, last.z_m + END_HEIGHT * last.rise_m) for aside in (-0.25, 0.0, 0.25)], R_WC, p_WC)

    def _ends_down(self, flight: Sequence[Step], R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"]) -> bool:
        """Return whether the floor is to be seen that goes on where another tread would end."""
        first = flight[0]
        behind = [first.x_m - part * first.depth_m for part in np.linspace(*END_BEHIND, 4)]
        return self._shown([(x, aside, first.z_m - first.rise_m) for x in behind for aside in (-0.25, 0.0, 0.25)], R_WC, p_WC)

    def _shown(
        self, places_W: list[tuple[float, float, float]], R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"]
    ) -> bool:
        return float((self._margins((np.array(places_W) - p_WC) @ R_WC) > 0.0).mean()) > END_SHARE

    def _walls(
        self, flight: int, R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"], p_WB: Float[np.ndarray, " 3"]
    ) -> tuple[Wall | None, Wall | None]:
        """Return the walls at +y and at -y, however little of them is in view."""
        staircase = self._staircase
        if staircase.walls == "none":
            return None, None
        rays = self._rays_C @ R_WC.T
        places = self._places_W[self._flights == flight]
        first, last, slope = places[0], places[-1], math.tan(staircase.slope_rad)
        half = 0.5 * staircase.width_m
        with np.errstate(divide="ignore", invalid="ignore"):
            aside = (np.copysign(half, rays[:, 1]) - p_WC[1]) / rays[:, 1]
            below = (first[2] + slope * (p_WC[0] - first[0]) - p_WC[2]) / (rays[:, 2] - slope * rays[:, 0])
        below = np.where(below > 0.0, below, np.inf)
        x = p_WC[0] + np.clip(aside, 0.0, FAR_M) * rays[:, 0]
        shown = (aside > 0.0) & (aside < np.minimum(below, FAR_M)) & (x > staircase.flights[flight][0].x_m) & (x < last[0])
        left = Wall(free_m=half - float(p_WB[1]), share=float((shown & (rays[:, 1] > 0.0)).mean()))
        right = Wall(free_m=half + float(p_WB[1]), share=float((shown & (rays[:, 1] < 0.0)).mean()))
        return left if staircase.walls in ("left", "both") else None, right if staircase.walls in ("right", "both") else None


class TurningGeometry:
    """A staircase of flights that turn, in front of a camera on a chair: each flight is seen as if there were no other."""

    def __init__(self, staircase: Staircase, calibration: PinholeCamera) -> None:
        self._staircase = staircase
        self._frames = [staircase.flight_frame(k) for k in range(staircase.flight_count)]
        self._flights = [Geometry(staircase.alone(k), calibration) for k in range(staircase.flight_count)]

    def outlook(self, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"]) -> Outlook | None:
        """Return what is in view of the chair's own flight, or else of a neighbour's; None if that is no stair."""
        own = self._staircase.flight_at(p_WB, R_WB)
        for k in (own, own + 1, own - 1):
            if 0 <= k < len(self._flights):
                R_WF, p_WF = self._frames[k]
                seen = self._flights[k].outlook(R_WF.T @ R_WB, R_WF.T @ (p_WB - p_WF))
                if seen is not None:
                    return seen
        return None


def crossings(
    places_W: Float[np.ndarray, "n 3"],
    along_W: Float[np.ndarray, "n 3"],
    R_WB: Float[np.ndarray, "3 3"],
    p_WB: Float[np.ndarray, " 3"],
) -> Float[np.ndarray, "n 3"]:
    """Return where edges, extended beyond the stair's width, meet the chair's middle plane, in B."""
    places, along = (places_W - p_WB) @ R_WB, along_W @ R_WB
    points = places - (places[:, 1] / along[:, 1])[:, None] * along
    points[:, 1] = 0.0
    return np.asarray(points)
