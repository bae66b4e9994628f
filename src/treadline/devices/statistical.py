"""A camera without images: what a stair detector would say of a frame from where the chair stands.

``(t, pose) -> HeadingMeasurement and StairMap, or nothing``. Geometry tells which nosings, walls and ends a frame would show.
``exact`` hands them over almost as they are, for ``vision = "truth"``; otherwise they err as the detector did on rendered frames
of whole traversals: as often refused or missed, as far off, and as alike from one frame to the next. The numbers come from
``data/cameras/statistical.json``, which ``benchmarks/statistical.py`` fits and holds against other drives.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from treadline.angles import DEG
from treadline.mechanics.staircase import Staircase, Step
from treadline.signals import HeadingMeasurement, PinholeCamera, StairMap

EXACT_SIGMA_RAD, EXACT_PLACE_M = 0.05 * DEG, 0.001
"""Noise of ``exact``: small, so that a filter has something to weigh."""
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
LEAST_WALL = 0.03
"""Share of the coarse image that a wall fills where it is surely seen."""
LEAST_NOSINGS = 2
LONGEST_RUN_M = 0.52
"""``perception.nosings.STEP_RUN_M``: to a detector, what is longer is no step."""
HEADING_LIMIT_RAD = 45.0 * DEG
END_HEIGHT, END_BEHIND = 0.9, (1.25, 1.9)
"""Where the next step is missed: so many rises above the last nosing, one run behind it; so many runs behind and below it."""
END_SHARE = 0.4
"""Of those points that must be in view."""
FAR_FIRST_M = 1.2
"""Depth from which the nearest nosing is seen from the floor before the flight."""
FAR_END_M = 2.5
"""Depth from which an end that is in view is often not told."""
COUNTS = (2, 3, 4, 6)
"""Nosings told, from which on another cell of a table holds."""
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
        self._flights = self._numbers * staircase.flight_count // len(staircase.steps)
        self._places_W = np.array([[step.x_m, 0.0, step.z_m] for step in steps])
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


class StatisticalCamera:
    """Says what a stair detector would say.

    Args:
        exact: Tell what is in view as it is, but for a trace of noise.
    """

    def __init__(self, staircase: Staircase, calibration: PinholeCamera, rng: np.random.Generator, *, exact: bool = False) -> None:
        self._geometry = Geometry(staircase, calibration)
        self._rng = rng
        kind = "open" if staircase.open_risers else "closed"
        self._errors = None if exact else _Errors(kind, len(staircase.steps), rng)

    def look(
        self, t_s: float, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"]
    ) -> tuple[HeadingMeasurement | StairMap, ...]:
        """Return heading and map of one instant; nothing where a frame would be refused."""
        seen = self._geometry.outlook(R_WB, p_WB)
        if self._errors is not None:
            return self._errors.told(t_s, seen, R_WB, p_WB)
        if seen is None or int(seen.seen.sum()) < LEAST_NOSINGS:
            return ()
        return self._told_exactly(t_s, seen)

    def _told_exactly(self, t_s: float, seen: Outlook) -> tuple[HeadingMeasurement | StairMap, ...]:
        nosings = seen.nosings_B[seen.seen]
        nosings[:, ::2] += EXACT_PLACE_M * self._rng.standard_normal((len(nosings), 2))
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
                ends=seen.ends and seen.last == int(seen.numbers[seen.seen][-1]),
                left_wall_m=seen.left.free_m if seen.left and seen.left.share > LEAST_WALL else None,
                right_wall_m=seen.right.free_m if seen.right and seen.right.share > LEAST_WALL else None,
                obstacle_m=None,
            ),
        )


LATENTS = ("accept", "heading", "sigma", "slope", "pitch", "along", "height", "ends", "left", "right", "obstacle", "where")
OF_NOSINGS = ("told", "along", "height")


class _Wander:
    """Normal numbers, each with a part that stays all drive, one that changes with the way, and one of the frame's own."""

    def __init__(self, shares: Float[np.ndarray, "k 2"], way_m: Float[np.ndarray, " k"], rng: np.random.Generator) -> None:
        own = np.maximum(1.0 - shares.sum(axis=1), 0.0)
        self._stays, self._changes, self._own = np.sqrt(shares[:, 0]), np.sqrt(shares[:, 1]), np.sqrt(own)
        self._way_m = way_m
        self._rng = rng
        self._drive, self._slow = rng.standard_normal((2, len(way_m)))
        self._place: Float[np.ndarray, " 3"] | None = None

    def at(self, p_WB: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " k"]:
        """Return the numbers of a frame taken here."""
        fresh, own = self._rng.standard_normal((2, len(self._way_m)))
        if self._place is not None:
            alike = np.exp(-float(np.linalg.norm(p_WB - self._place)) / self._way_m)
            self._slow = alike * self._slow + np.sqrt(1.0 - alike**2) * fresh
        self._place = p_WB.copy()
        return np.asarray(self._stays * self._drive + self._changes * self._slow + self._own * own)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Told:
    """Which of an outlook's nosings are told, and with which normal numbers they err."""

    which: Int[np.ndarray, " k"]
    latents: Float[np.ndarray, "3 k"]


class _Errors:
    """What keeps a detector from telling what is in view; as long as a drive."""

    def __init__(self, kind: str, steps: int, rng: np.random.Generator) -> None:
        self._kind = kind
        fitted = fitted_numbers()
        self._tables = fitted["tables"]
        self._grid = np.array(fitted["normal_grid"])
        shared = [fitted["shared"][name] for name in LATENTS]
        shared += [fitted["shared"][f"nosing {name}"] for name in OF_NOSINGS for _ in range(steps)]
        self._common = np.array([fitted["common"][name] for name in ("along", "height")])[:, None]
        numbers = np.array(shared)
        self._wander = _Wander(numbers[:, :2], numbers[:, 2], rng)

    def told(
        self, t_s: float, seen: Outlook | None, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"]
    ) -> tuple[HeadingMeasurement | StairMap, ...]:
        """Return what is told of what is in view."""
        # A metre ahead of the chair: a turn changes the view as a way does.
        normal = self._wander.at(p_WB + R_WB[:, 0])
        if seen is None:
            return ()
        table = self._tables[f"{seen.direction} {self._kind}"]
        latent = dict(zip(LATENTS, normal[: len(LATENTS)].tolist(), strict=True))
        second = np.sort(seen.margins_px)[-2]
        accept = table["accept"]["score"][seen.doubt]
        if latent["accept"] > np.interp(second, table["accept"]["margins_px"], accept) or seen.run_m > LONGEST_RUN_M:
            return ()
        of_nosings = normal[len(LATENTS) :].reshape(len(OF_NOSINGS), -1)[:, seen.numbers]
        which = self._which(table["told"], seen, of_nosings[0])
        cell = cell_of(len(which))
        nosings = self._nosings(table, seen, which, of_nosings[1:, which], np.array([latent["along"], latent["height"]]))
        slope = math.atan2(seen.rise_m, seen.run_m) + self._value(table["slope"][cell], latent["slope"])
        pitch = math.hypot(seen.rise_m, seen.run_m) + self._value(table["pitch"][cell], latent["pitch"])
        sigma = self._value(table["heading"][cell]["sigma"], latent["sigma"])
        strain = self._value(table["heading"][cell]["strain"], latent["heading"])
        obstacle = latent["obstacle"] < table["obstacle"]["score"]
        return (
            HeadingMeasurement(
                t_s=t_s,
                heading_rad=seen.heading_rad + strain * sigma ** table["heading"][cell]["power"],
                sigma_rad=sigma,
                edge_count=len(which),
            ),
            StairMap(
                t_s=t_s,
                direction=seen.direction,
                nosings_B=nosings,
                rise_m=pitch * math.sin(slope),
                run_m=pitch * math.cos(slope),
                slope_rad=slope,
                ends=latent["ends"] < table["ends"][end_class(seen, int(seen.numbers[which[-1]]))],
                left_wall_m=self._wall(table["wall"], seen.left, latent["left"], latent["where"]),
                right_wall_m=self._wall(table["wall"], seen.right, latent["right"], -latent["where"]),
                obstacle_m=self._value(table["obstacle"]["where"], latent["where"]) if obstacle else None,
            ),
        )

    def _value(self, quantiles: list[float], normal: float) -> float:
        return float(np.interp(normal, self._grid, quantiles))

    def _which(self, table: dict[str, Any], seen: Outlook, normal: Float[np.ndarray, " n"]) -> Int[np.ndarray, " k"]:
        """Return the places of the nosings told: the two best at least, for the frame was accepted."""
        row, column = told_cell(seen)
        spare = np.array(table["score"])[row, column] - normal
        spare[np.argsort(spare)[-LEAST_NOSINGS:]] = np.inf
        return np.flatnonzero(spare > 0.0)

    def _nosings(
        self,
        table: dict[str, Any],
        seen: Outlook,
        which: Int[np.ndarray, " k"],
        own: Float[np.ndarray, "2 k"],
        common: Float[np.ndarray, " 2"],
    ) -> Float[np.ndarray, "k 3"]:
        """Return the nosings told, each off by what all are and by what it is itself."""
        normal = np.sqrt(self._common) * common[:, None] + np.sqrt(1.0 - self._common) * own
        cells = np.searchsorted(DEPTHS_M, seen.depths_m[which])
        nosings = seen.nosings_B[which]
        away = -1.0 if nosings[0, 0] < 0.0 else 1.0
        for place, cell in enumerate(cells):
            nosings[place, 0] += away * self._value(table["along"][cell], normal[0, place])
            nosings[place, 2] += self._value(table["height"][cell], normal[1, place])
        return nosings

    def _wall(self, table: dict[str, Any], wall: Wall | None, normal: float, where: float) -> float | None:
        if wall is None or normal > table["score"][int(np.searchsorted(WALL_SHARES, wall.share))]:
            return None
        return wall.free_m + self._value(table["error"], where)


DEPTHS_M, MARGINS_PX, WALL_SHARES = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5), (-20.0, -10.0, 0.0, 5.0, 10.0, 20.0), (0.005, 0.03, 0.1)
"""Where one cell of a table ends and the next begins."""


def cell_of(count: int) -> int:
    """Return the cell of a table that holds for so many nosings told."""
    return max(int(np.searchsorted(COUNTS, count, side="right")) - 1, 0)


def told_cell(seen: Outlook) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Return row and column of each nosing in the table of how often it is told."""
    return np.searchsorted(MARGINS_PX, seen.margins_px), np.searchsorted(DEPTHS_M, seen.depths_m)


def end_class(seen: Outlook, last_told: int) -> int:
    """Return what there is to tell of the flight's end: not in view, in view without what is beyond, with it, far away."""
    if last_told != seen.last:
        return 0
    if not seen.ends:
        return 1
    return 2 if seen.depths_m[-1] < FAR_END_M else 3


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


@cache
def fitted_numbers() -> dict[str, Any]:
    """Return the numbers that a fit to rendered frames left."""
    text = files("treadline").joinpath("data", "cameras", "statistical.json").read_text(encoding="utf-8")
    return dict(json.loads(text))
