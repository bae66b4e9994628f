"""A camera without images: what a stair detector would say of a frame from where the chair stands.

``(t, pose) -> HeadingMeasurement and StairMap, or nothing``. ``devices/outlook.py`` tells which nosings, walls and ends a frame
would show. ``exact`` hands them over almost as they are, for ``vision = "truth"``; otherwise they err as the detector did on
rendered frames of whole traversals: as often refused or missed, as far off, and as alike from one frame to the next. The numbers
come from ``data/cameras/statistical.json``, which ``benchmarks/statistical.py`` fits and holds against other drives.
"""

import json
import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from treadline.angles import DEG
from treadline.devices.outlook import LEAST_NOSINGS, Geometry, Outlook, TurningGeometry, Wall
from treadline.mechanics.staircase import Staircase
from treadline.signals import HeadingMeasurement, PinholeCamera, StairMap

EXACT_SIGMA_RAD, EXACT_PLACE_M = 0.05 * DEG, 0.001
"""Noise of ``exact``: small, so that a filter has something to weigh."""
LEAST_WALL = 0.03
"""Share of the coarse image that a wall fills where it is surely seen."""
LONGEST_RUN_M = 0.52
"""``perception.nosings.STEP_RUN_M``: to a detector, what is longer is no step."""
FAR_END_M = 2.5
"""Depth from which an end that is in view is often not told."""
COUNTS = (2, 3, 4, 6)
"""Nosings told, from which on another cell of a table holds."""


class StatisticalCamera:
    """Says what a stair detector would say.

    Args:
        exact: Tell what is in view as it is, but for a trace of noise.
    """

    def __init__(self, staircase: Staircase, calibration: PinholeCamera, rng: np.random.Generator, *, exact: bool = False) -> None:
        self._geometry = (TurningGeometry if staircase.turn_rad else Geometry)(staircase, calibration)
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


LATENTS = ("accept", "heading", "sigma", "slope", "pitch", "along", "height", "ends", "left", "right", "where")
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
                obstacle_m=None,
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


@cache
def fitted_numbers() -> dict[str, Any]:
    """Return the numbers that a fit to rendered frames left."""
    text = files("treadline").joinpath("data", "cameras", "statistical.json").read_text(encoding="utf-8")
    return dict(json.loads(text))
