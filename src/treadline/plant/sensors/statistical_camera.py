"""Statistical camera: the output of a stair detector, simulated without images.

``(t, pose) -> HeadingMeasurement and StairMap, or nothing; FreeGround``. ``visibility.py`` computes the nosings, walls and flight
ends in view. With ``exact`` they are reported almost without error, for ``vision = "truth"``; otherwise with the errors of the
detector on rendered frames of full traversals: the same rates of rejection and misses, error sizes, and correlation between frames.
The parameters are in ``data/cameras/statistical.json``; ``benchmarks/statistical.py`` fits them and validates them on other runs.
"""

import json
import math
from bisect import bisect
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera
from treadline.core.rotations import Rotation, Vector3
from treadline.core.signals import FreeGround, HeadingMeasurement, StairMap
from treadline.core.step_sizes import RUN_M
from treadline.plant.sensors._free_ground import GroundAhead
from treadline.vehicle.staircase import Staircase
from treadline.vehicle.visibility import Geometry, Visibility, VisibleSide, least_nosings

EXACT_SIGMA_RAD, EXACT_PLACE_M = 0.05 * DEG, 0.001
"""Noise of ``exact``: heading [rad] and nosing position [m]; non-zero, so that a filter has a finite weight."""
LEAST_WALL = 0.03
"""Fraction of the coarse image filled by a wall above which the wall is always detected."""
FAR_END_M = 2.5
"""Depth above which a visible end of the flight is often missed [m]."""
COUNTS = (2, 3, 4, 6)
"""Lower limits of the classes of reported-nosing count."""


Detected = tuple[HeadingMeasurement | StairMap | FreeGround, ...]
"""Output of the detector for one frame; empty if it rejects the frame and does not measure the ground."""
Found = tuple[float, float, Float[np.ndarray, "k 3"], dict[str, Any]]
"""Heading and its standard deviation [rad], nosings in B, and the other keys of the map."""


class StatisticalCamera:
    """Camera model with the output of a stair detector.

    Args:
        sensor: Kind of the depth sensor.
        exact: Report the visible stair with negligible noise.
        ground: Measurement of the ground ahead; None reports none.
    """

    def __init__(
        self,
        staircase: Staircase,
        calibration: PinholeCamera,
        rng: np.random.Generator,
        *,
        sensor: str = "kinect1",
        exact: bool = False,
        ground: GroundAhead | None = None,
    ) -> None:
        self._geometry = Geometry(staircase, calibration)
        self._least = least_nosings(staircase)
        self._rng = rng
        kind = "open" if staircase.open_risers else "closed"
        self._errors = None if exact else _Errors(sensor, kind, len(staircase.steps), rng)
        self._ground = ground

    def look(self, t_s: float, R_WB: Rotation, p_WB: Vector3) -> Detected:
        """Return heading and map of one instant, if the detector would accept the frame, and the ground ahead."""
        seen = self._geometry.visibility(R_WB, p_WB)
        found = self._exactly(seen) if self._errors is None else self._errors.found(seen, R_WB, p_WB)
        ground = () if self._ground is None else (self._ground.look(t_s, R_WB, p_WB),)
        if seen is None or found is None:
            return ground
        heading_rad, sigma_rad, nosings, stair = found
        return (
            HeadingMeasurement(t_s=t_s, heading_rad=heading_rad, sigma_rad=sigma_rad, edge_count=len(nosings)),
            StairMap(
                t_s=t_s,
                direction=seen.direction,
                nosings_B=tuple(map(tuple, nosings.tolist())),
                obstacle_m=None,
                **stair,
                **_sides(seen),
            ),
            *ground,
        )

    def _exactly(self, seen: Visibility | None) -> "Found | None":
        if seen is None or int(seen.seen.sum()) < self._least:
            return None
        nosings = seen.nosings_B[seen.seen]
        nosings[:, ::2] += EXACT_PLACE_M * self._rng.standard_normal((len(nosings), 2))
        heading = seen.heading_rad + EXACT_SIGMA_RAD * float(self._rng.standard_normal())
        stair: dict[str, Any] = {
            "rise_m": seen.rise_m,
            "run_m": seen.run_m,
            "slope_rad": math.atan2(seen.rise_m, seen.run_m),
            "ends": seen.ends and seen.last == int(seen.numbers[seen.seen][-1]),
        }
        for name, side in zip(("left", "right"), seen.sides, strict=True):
            stair[f"{name}_wall_m"] = side.end_m if side.kind == "wall" and side.share > LEAST_WALL else None
        return heading, EXACT_SIGMA_RAD, nosings, stair


def _sides(seen: Visibility) -> dict[str, Any]:
    """Return the sides of a map, without errors.

    The detector's ends of nosings err by less than 2 cm (``tests/perception/test_form.py``); how far its nosings are in view
    differs from this by up to 6 cm (``tests/plant/test_statistical.py``).
    """
    sides = dict(zip(("left", "right"), seen.sides, strict=True))
    return (
        {f"{name}_seen_m": side.seen_m for name, side in sides.items() if math.isfinite(side.seen_m)}
        | {f"{name}_edge_m": side.edge_m for name, side in sides.items()}
        | {f"{name}_side": None if side.edge_m is None else side.kind for name, side in sides.items()}
    )


LATENTS = ("accept", "heading", "sigma", "slope", "pitch", "along", "height", "ends", "left", "right", "where")
"""Names of the latent normal variables of a frame."""
NOSING_ERRORS = ("told", "along", "height")
"""Names of the latent normal variables of each nosing."""


class _Wander:
    """Correlated normal variables: sum of a part constant over the run, a part varying with distance, and a part of each frame."""

    def __init__(self, shares: Float[np.ndarray, "k 2"], way_m: Float[np.ndarray, " k"], rng: np.random.Generator) -> None:
        own = np.maximum(1.0 - shares.sum(axis=1), 0.0)
        self._stays, self._changes, self._own = np.sqrt(shares[:, 0]), np.sqrt(shares[:, 1]), np.sqrt(own)
        self._way_m = way_m
        self._rng = rng
        self._drive, self._slow = rng.standard_normal((2, len(way_m)))
        self._place: Vector3 | None = None

    def at(self, p_WB: Vector3) -> Float[np.ndarray, " k"]:
        """Return the variables for a frame at this position."""
        fresh, own = self._rng.standard_normal((2, len(self._way_m)))
        if self._place is not None:
            alike = np.exp(-float(np.linalg.norm(p_WB - self._place)) / self._way_m)
            self._slow = alike * self._slow + np.sqrt(1.0 - alike**2) * fresh
        self._place = p_WB.copy()
        return np.asarray(self._stays * self._drive + self._changes * self._slow + self._own * own)


class _Errors:
    """Error model of the detector for the duration of a run."""

    def __init__(self, sensor: str, kind: str, steps: int, rng: np.random.Generator) -> None:
        self._kind = kind
        fitted = fitted_numbers()[sensor]
        self._tables = fitted["tables"]
        self._grid: list[float] = fitted["normal_grid"]
        shared = [fitted["shared"][name] for name in LATENTS]
        shared += [fitted["shared"][f"nosing {name}"] for name in NOSING_ERRORS for _ in range(steps)]
        self._common = np.array([fitted["common"][name] for name in ("along", "height")])[:, None]
        numbers = np.array(shared)
        self._wander = _Wander(numbers[:, :2], numbers[:, 2], rng)

    def found(self, seen: Visibility | None, R_WB: Rotation, p_WB: Vector3) -> Found | None:
        """Return what the detector would find in the visible stair."""
        # The reference point is a metre ahead of the chair, so that a rotation decorrelates the errors like a translation.
        normal = self._wander.at(p_WB + R_WB[:, 0])
        if seen is None:
            return None
        table = self._tables[f"{seen.direction} {self._kind}"]
        latent = dict(zip(LATENTS, normal[: len(LATENTS)].tolist(), strict=True))
        second = np.sort(seen.margins_px)[-min(2, len(seen.margins_px))]
        accept = table["accept"]["score"][seen.acceptance_row]
        if latent["accept"] > np.interp(second, table["accept"]["margins_px"], accept) or seen.run_m > RUN_M[1]:
            return None
        nosing_errors = normal[len(LATENTS) :].reshape(len(NOSING_ERRORS), -1)[:, seen.numbers]
        spare = np.array(table["told"]["score"])[reported_cell(seen)] - nosing_errors[0]
        spare[np.argsort(spare)[-2:]] = np.inf  # at least the two best nosings are reported, because the frame was accepted
        which = np.flatnonzero(spare > 0.0)
        cell = cell_of(len(which))
        nosings = self._nosings(table, seen, which, nosing_errors[1:, which], np.array([latent["along"], latent["height"]]))
        slope = math.atan2(seen.rise_m, seen.run_m) + self._value(table["slope"][cell], latent["slope"])
        pitch = math.hypot(seen.rise_m, seen.run_m) + self._value(table["pitch"][cell], latent["pitch"])
        sigma = self._value(table["heading"][cell]["sigma"], latent["sigma"])
        strain = self._value(table["heading"][cell]["strain"], latent["heading"])
        stair = {
            "rise_m": pitch * math.sin(slope),
            "run_m": pitch * math.cos(slope),
            "slope_rad": slope,
            "ends": latent["ends"] < table["ends"][end_class(seen, int(seen.numbers[which[-1]]))],
            "left_wall_m": self._wall(table["wall"], seen.sides[0], latent["left"], latent["where"]),
            "right_wall_m": self._wall(table["wall"], seen.sides[1], latent["right"], -latent["where"]),
        }
        return seen.heading_rad + strain * sigma ** table["heading"][cell]["power"], sigma, nosings, stair

    def _value(self, quantiles: list[float], normal: float) -> float:
        """Return the quantile of a normal variable by linear interpolation, constant beyond the grid."""
        grid = self._grid
        k = bisect(grid, normal) - 1
        if k < 0 or k >= len(grid) - 1:
            return quantiles[max(k, 0)]
        return (quantiles[k + 1] - quantiles[k]) / (grid[k + 1] - grid[k]) * (normal - grid[k]) + quantiles[k]

    def _nosings(
        self,
        table: dict[str, Any],
        seen: Visibility,
        which: Int[np.ndarray, " k"],
        own: Float[np.ndarray, "2 k"],
        common: Float[np.ndarray, " 2"],
    ) -> Float[np.ndarray, "k 3"]:
        """Return the reported nosings with common and individual errors."""
        along, height = (np.sqrt(self._common) * common[:, None] + np.sqrt(1.0 - self._common) * own).tolist()
        cells = np.searchsorted(DEPTHS_M, seen.depths_m[which]).tolist()
        nosings = seen.nosings_B[which]
        away = -1.0 if nosings[0, 0] < 0.0 else 1.0
        for place, cell in enumerate(cells):
            nosings[place, 0] += away * self._value(table["along"][cell], along[place])
            nosings[place, 2] += self._value(table["height"][cell], height[place])
        return nosings

    def _wall(self, table: dict[str, Any], side: VisibleSide, normal: float, where: float) -> float | None:
        if side.kind == "open" or normal > table["score"][int(np.searchsorted(WALL_SHARES, side.share))]:
            return None
        return side.end_m + self._value(table["error"], where)


DEPTHS_M, MARGINS_PX, WALL_SHARES = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5), (-20.0, -10.0, 0.0, 5.0, 10.0, 20.0), (0.005, 0.03, 0.1)
"""Class limits of the error tables: depth [m], margin [px], wall fraction."""


def cell_of(count: int) -> int:
    """Return the table cell for a number of reported nosings."""
    return max(int(np.searchsorted(COUNTS, count, side="right")) - 1, 0)


def reported_cell(seen: Visibility) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Return row and column of each nosing in the table of detection probability."""
    return np.searchsorted(MARGINS_PX, seen.margins_px), np.searchsorted(DEPTHS_M, seen.depths_m)


def end_class(seen: Visibility, last_reported: int) -> int:
    """Return the visibility class of the flight's end: not in view (0), no view beyond (1), view beyond (2), far away (3)."""
    if last_reported != seen.last:
        return 0
    if not seen.ends:
        return 1
    return 2 if seen.depths_m[-1] < FAR_END_M else 3


@cache
def fitted_numbers() -> dict[str, Any]:
    """Return the parameters fitted to rendered frames, by kind of depth sensor."""
    text = files("treadline").joinpath("data", "cameras", "statistical.json").read_text(encoding="utf-8")
    return dict(json.loads(text))
