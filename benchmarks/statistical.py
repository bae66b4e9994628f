"""Fit and validate the statistical camera: ``python benchmarks/statistical.py [--camera KIND] [--drives N] [--seed S] [--fit]``.

Renders full traversals (floor, mounting, flight, top; landing, top entry, flight, bottom), each with its own errors of the camera
and of the stair, and runs the stair detector on every frame. The detections are compared with the geometry in view; the errors give
the numbers of a kind of camera in ``data/cameras/statistical.json`` (``--fit``). Without it, drives with other seeds validate
the error model against frames. ``--keep FOLDER`` keeps the records of the frames.
"""

import argparse
import json
import math
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from perception_cases import LIFELIKE
from scenes import SceneCamera, ViewRecipe
from scenes.flight import TiltedFlight, draw_flight
from scipy.stats import ks_2samp, norm, rankdata

from treadline.core.angles import DEG
from treadline.core.camera_images import BASELINES_M, PinholeCamera
from treadline.core.rotations import Rotation, Vector3, rotation_x, rotation_y, rotation_z
from treadline.core.signals import HeadingMeasurement, StairMap
from treadline.core.step_sizes import RUN_M
from treadline.perception import DetectorConfig, StairDetector
from treadline.plant.sensors.camera import TEXTURES
from treadline.plant.sensors.statistical_camera import (
    COUNTS,
    DEPTHS_M,
    MARGINS_PX,
    WALL_SHARES,
    StatisticalCamera,
    cell_of,
    end_class,
    reported_cell,
)
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario, Sensors
from treadline.vehicle.staircase import Staircase
from treadline.vehicle.visibility import Geometry, Visibility, VisibleSide

AS_BUILT: dict[str, Any] = {name: value for name, value in LIFELIKE.items() if name != "worn_m"}
"""Imperfections of real frames: uneven steps, spatially correlated noise, residual distortion."""
SLOPE_DEG, RISE_M = (20.0, 32.0), (0.12, 0.18)
LENGTH_SPARE_M = 0.01
"""Margin of the nominal run to the detector's longest run [m], for uneven runs; the model needs no fit for this limit."""
STATION_M, NEIGHBOUR_M = 0.25, 0.03
"""Distance between stations along a traversal, and from a station to its neighbour frame [m]; two frames share the station."""
FLAT_M = 0.475
"""Half of the length of the belts' flat run [m]."""
TIP_M = 0.25
"""Distance of the chair's middle before the top over which the pitch decreases to zero [m]."""
GRAVITY_ERROR_RAD = 0.5 * DEG
"""Standard deviation of the IMU's tilt error [rad], constant over a drive."""
DOWN_W = np.array([0.0, 0.0, -1.0])
CHAIR = read_chair("wheelchair")
KINDS = ("up closed", "up open", "down closed", "down open")
HALF_GRID = (0.2, 0.4, 0.7, 1.0, 1.3, 1.65, 2.0, 2.3, 2.6, 3.0, 3.3, 4.0)
GRID = np.array([*(-score for score in reversed(HALF_GRID)), 0.0, *HALF_GRID])
"""Standard normal scores of the stored quantiles."""
SPARE = 1.15
"""Factor on the measured error quantiles: a hundred drives in each direction do not contain the worst case."""
LEAST_SAMPLES, LEAST_CHANCES = 60, 6
"""Least number of samples in a cell with its own quantiles, and with its own probability."""
ACCEPT_PX = (-30.0, -20.0, -10.0, -5.0, 0.0, 5.0, 10.0, 20.0, 40.0)
ACCEPT_AT_PX = [-35.0, -25.0, -15.0, -7.5, -2.5, 2.5, 7.5, 15.0, 30.0, 50.0]
"""Margins of the second best nosing [px]: middles of the cells of the acceptance probability."""
SAME_NOSING_M = 0.08
LAGS_M = (0.0, 0.001, 0.06, 0.35, 0.6, 1.1, 1.8)
LAG_AT_M = (0.25, 0.5, 0.8, 1.4)
"""Ways apart: from the same place, neighbours, three in between, and further along the drive."""
SHARED = (
    ("accept", "accept", True),
    ("heading", "error", False),
    ("sigma", "sigma", False),
    ("slope", "slope", False),
    ("pitch", "pitch", False),
    ("along", "along", False),
    ("height", "height", False),
    ("ends", "ends", True),
    ("left", "wall", True),
    ("right", "wall", True),
    ("where", "free", False),
    ("nosing declared", "told", True),
    ("nosing along", "along", False),
    ("nosing height", "height", False),
)
HELD_OUT = 5000
DRAWS = 3
ERRORS = (
    ("error", "°", 1.0 / DEG),
    ("sigma", "°", 1.0 / DEG),
    ("slope", "°", 1.0 / DEG),
    ("pitch", "mm", 1e3),
    ("along", "mm", 1e3),
    ("height", "mm", 1e3),
    ("free", "mm", 1e3),
)
DATA = Path(__file__).parents[1] / "src" / "treadline" / "data" / "cameras" / "statistical.json"
Record = dict[str, Any]


def stair_of(seed: int, *, rear: bool) -> tuple[TiltedFlight, ViewRecipe, np.random.Generator]:
    """Return a drive's stair, and the chance that goes on from it."""
    rng = np.random.default_rng([seed, int(rear)])
    slope, rise = rng.uniform(*SLOPE_DEG), rng.uniform(*RISE_M)
    while rise / math.tan(slope * DEG) > RUN_M[1] - LENGTH_SPARE_M:
        slope, rise = rng.uniform(*SLOPE_DEG), rng.uniform(*RISE_M)
    recipe = ViewRecipe(
        **AS_BUILT,
        rise_m=(rise, rise),
        run_m=(rise / math.tan(slope * DEG),) * 2,
        steps=(8, 20),
        open_risers=bool(rng.random() < 0.3),
    )
    return draw_flight(recipe, rng), recipe, rng


def drive(seed: int, kind: str, *, rear: bool) -> Iterator[Record]:
    """Yield ground truth and detection of each frame along one traversal."""
    flight, recipe, rng = stair_of(seed, rear=rear)
    calibration = calibration_of(kind, rear=rear)
    texture, light = str(rng.choice(TEXTURES)), float(rng.uniform(0.5, 1.6))
    camera = SceneCamera(
        flight.solids(),
        calibration,
        kind=kind,
        texture=texture,
        light=light,
        grain_px=recipe.grain_px,
        warp_px=recipe.warp_px,
        rng=rng,
    )
    geometry, detector = Geometry(flight.staircase, calibration), StairDetector(DetectorConfig(swept_half_m=CHAIR.swept_half_m))
    tilt = tilt_of(rng)
    about: Record = {
        "drive": seed,
        "rear": rear,
        "open": recipe.open_risers,
        "texture": texture,
        "light": light,
        "walls": flight.staircase.walls,
        "width_m": flight.staircase.width_m,
    }
    for s_m, scene, R_WB, p_WB in poses(flight, rng, rear=rear):
        R_WC = R_WB @ calibration.R_BC
        frame = camera.frame(0.0, R_WC, p_WB + R_WB @ np.array(calibration.mount_m))
        began = time.process_time()
        sight = detector.look(frame, R_WC.T @ tilt @ DOWN_W)
        seen = geometry.visibility(R_WB, p_WB)
        yield about | {
            "s": s_m,
            "scene": scene,
            "ms": 1e3 * (time.process_time() - began),
            "reason": sight.reason,
            "heading": sight.heading_rad,
            "sigma": sight.sigma_rad,
            "true": math.atan2(R_WB[1, 0], R_WB[1, 1]),
            "R": R_WB.tolist(),
            "p": p_WB.tolist(),
            "seen": None if seen is None else _plain(seen),
            "map": None if sight.stair_map is None else _plain(sight.stair_map),
        }


def calibration_of(kind: str, *, rear: bool) -> PinholeCamera:
    """Return a kind of camera as it is in the loop."""
    scenario = Scenario(sensors=Sensors(camera=kind))
    return scenario.read_chair().camera_at(scenario.sensors.rows_px, rear=rear)


def poses(flight: TiltedFlight, rng: np.random.Generator, *, rear: bool) -> Iterator[tuple[float, str, Rotation, Vector3]]:
    """Yield way, scene and pose along a traversal, up with the front camera, down with the rear one."""
    staircase = flight.staircase
    last = staircase.steps[-1]
    first_m, end_m = (-1.8, last.x_m + 0.1) if not rear else (-0.7, last.x_m + FLAT_M + 0.6)
    stations = np.arange(first_m, end_m, STATION_M)
    start, sway, phase = rng.uniform(-30.0, 30.0) * DEG, rng.uniform(0.0, 10.0) * DEG, rng.uniform(0.0, 2.0 * math.pi)
    lateral = float(rng.uniform(-0.15, 0.15))
    for station in stations[::-1] if rear else stations:
        done = float(abs(station - (end_m if rear else first_m)))
        for s in (station, station, station + NEIGHBOUR_M):
            heading = start * math.exp(-done / 1.5) + sway * math.sin(1.5 * float(s) + phase)
            R_WB, p_WB, scene = pose_at(staircase, float(s), lateral, heading)
            # It rocks with the step it stands on, and stands still in between.
            lean = np.random.default_rng([int(1e3 * (station + 10.0)), int(1e6 * abs(start))]).standard_normal(2)
            rock = AS_BUILT["rock_deg"] * DEG * lean * (scene != "level")
            yield done, scene, R_WB @ rotation_y(float(rock[0])) @ rotation_x(float(rock[1])), p_WB


def pose_at(staircase: Staircase, x_m: float, lateral_m: float, heading_rad: float) -> tuple[Rotation, Vector3, str]:
    """Return how a chair stands whose middle is at a place, and where that is: on the level, mounting, on the flight, tipping."""
    first, last = staircase.steps[0], staircase.steps[-1]
    slope, reach = staircase.slope_rad, FLAT_M * math.cos(heading_rad)
    foot = first.x_m - first.z_m / math.tan(slope)
    if x_m > last.x_m - TIP_M:
        pitch = slope * min(max((last.x_m - x_m) / TIP_M, 0.0), 1.0)
        z, scene = last.z_m + math.tan(pitch) * min(x_m - last.x_m, 0.0), "tip" if x_m < last.x_m else "level"
    else:
        rear = max(0.0, (x_m - reach - foot) * math.tan(slope))
        front = max(0.0, (x_m + reach - foot) * math.tan(slope))
        pitch, z = math.atan2(front - rear, 2.0 * reach), 0.5 * (front + rear)
        scene = "level" if front == 0.0 else "mount" if rear == 0.0 else "flight"
    return rotation_y(-pitch) @ rotation_z(heading_rad), np.array([x_m, lateral_m, z + 0.001]), scene


def tilt_of(rng: np.random.Generator) -> Rotation:
    """Return what the IMU makes of level: the same all drive."""
    way = rng.uniform(0.0, 2.0 * math.pi)
    return rotation_z(way) @ rotation_y(GRAVITY_ERROR_RAD * float(abs(rng.standard_normal()))) @ rotation_z(-way)


def _plain(declared: Visibility | StairMap) -> Record:
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in asdict(declared).items()}


def lines_of(seeds: range, kind: str, keep: Path | None) -> list[Record]:
    """Return all frames of some drives, from a file where they are kept."""
    if keep is not None and keep.exists():
        return [json.loads(line) for line in keep.read_text().splitlines()]
    records = [record for seed in seeds for rear in (False, True) for record in drive(seed, kind, rear=rear)]
    if keep is not None:
        keep.parent.mkdir(parents=True, exist_ok=True)
        keep.write_text("".join(json.dumps(record) + "\n" for record in records))
    return records


def look_of(record: Record) -> tuple[Visibility | None, StairMap | None]:
    """Return ground truth and detection of a record as their original types."""
    seen, declared = record["seen"], record["map"]
    if seen is not None:
        arrays = {name: np.array(seen[name]) for name in ("numbers", "nosings_B", "margins_px", "depths_m")}
        sides = tuple(VisibleSide(**side) for side in seen["sides"])
        seen = Visibility(**seen | arrays | {"sides": sides})
    if declared is not None:
        declared = StairMap(**declared | {"t_s": 0.0, "nosings_B": np.array(declared["nosings_B"])})
    return seen, declared


@dataclass(kw_only=True)
class Samples:
    """One quantity, frame by frame."""

    drives: list[int] = field(default_factory=list)
    places: list[list[float]] = field(default_factory=list)
    cells: list[tuple[int, ...]] = field(default_factory=list)
    frames: list[int] = field(default_factory=list)
    values: list[float] = field(default_factory=list)

    def add(self, record: Record, place: Vector3, cell: tuple[int, ...], value: float, number: int = 0) -> None:
        """Take one; ``number`` separates those that have no part in each other, as two nosings."""
        self.drives.append(1000 * (6 * int(record["drive"]) + 2 * int(record.get("chance", 0)) + int(record["rear"])) + number)
        self.places.append(place.tolist())
        self.cells.append(cell)
        self.frames.append(int(record["frame"]))
        self.values.append(float(value))

    def of(self, cell: tuple[int, ...], least: int = LEAST_SAMPLES) -> Float[np.ndarray, " n"]:
        """Return the values of a cell; of the cell nearest to it where there are too few."""
        known = Counter(self.cells)
        for enough in (least, 1):
            alike_ = [other for other, count in known.items() if other[:-1] == cell[:-1] and count >= enough]
            if alike_:
                nearest = min(alike_, key=lambda other: (abs(other[-1] - cell[-1]), other[-1]))
                return np.array([value for value, other in zip(self.values, self.cells, strict=True) if other == nearest])
        return np.zeros(1)

    def of_any(self, kinds: tuple[int, ...], cell: int) -> Float[np.ndarray, " n"]:
        """Return the values of a cell, kinds taken together."""
        return np.concatenate([self.of((kind, cell)) for kind in kinds])


def samples_of(records: list[Record]) -> dict[str, Samples]:
    """Return what the records say of each quantity, cells beginning with the kind of stair and direction."""
    found: dict[str, Samples] = defaultdict(Samples)
    for frame, line in enumerate(records):
        record = line | {"frame": frame}
        seen, declared = look_of(record)
        if seen is None:
            found["unseen"].add(record, np.zeros(3), (0,), declared is not None)
            continue
        kind = KINDS.index(f"{seen.direction} {'open' if record['open'] else 'closed'}")
        place = np.array(record["p"]) + np.array(record["R"])[:, 0]
        second = int(np.searchsorted(ACCEPT_PX, np.sort(seen.margins_px)[-2]))
        found["accept"].add(record, place, (kind, seen.acceptance_row, second), declared is not None)
        if declared is None:
            continue
        add = partial(_add, found, record, place)
        cell = cell_of(len(declared.nosings_B))
        add("error", (kind, cell), record["heading"] - seen.heading_rad)
        add("sigma", (kind, cell), record["sigma"])
        add("slope", (kind, cell), declared.slope_rad - math.atan2(seen.rise_m, seen.run_m))
        add("pitch", (kind, cell), math.hypot(declared.rise_m, declared.run_m) - math.hypot(seen.rise_m, seen.run_m))
        if declared.obstacle_m is None or not _ends_a_wall(record, declared.obstacle_m):
            add("obstacle", (kind,), declared.obstacle_m is not None)
        _add_nosings(add, kind, seen, declared)
        for number, side, free in zip((1, 0), seen.sides, (declared.left_wall_m, declared.right_wall_m), strict=True):
            if side.kind == "open":
                add("no wall", (kind,), free is not None, number)
                continue
            add("wall", (kind, int(np.searchsorted(WALL_SHARES, side.share))), free is not None, number)
            if free is not None:
                add("free", (kind,), free - side.end_m, number)
    return found


def _ends_a_wall(record: Record, obstacle_m: float) -> bool:
    """Return whether a chair at an angle before a stair would meet, straight on from its place, a side wall's end."""
    way = -1.0 if record["rear"] else 1.0
    corners_B = np.array([[way * obstacle_m, side * CHAIR.swept_half_m, 0.0] for side in (-1.0, 1.0)])
    y = (np.array(record["p"]) + corners_B @ np.array(record["R"]).T)[:, 1]
    walls = {"none": (), "left": (1.0,), "right": (-1.0,), "both": (1.0, -1.0)}[record["walls"]]
    return any(float((side * y).max()) > 0.5 * record["width_m"] for side in walls)


def _add(
    found: dict[str, Samples], record: Record, place: Vector3, name: str, cell: tuple[int, ...], value: float, number: int = 0
) -> None:
    found[name].add(record, place, cell, value, number)


def _add_nosings(add: Callable[..., None], kind: int, seen: Visibility, declared: StairMap) -> None:
    apart = np.array(declared.nosings_B)[:, None, ::2] - seen.nosings_B[None, :, ::2]
    gaps = np.linalg.norm(apart, axis=2)
    rows, columns = reported_cell(seen)
    away = -1.0 if seen.nosings_B[0, 0] < 0.0 else 1.0
    last = 0
    for k, number in enumerate(seen.numbers.tolist()):
        nearest = int(gaps[:, k].argmin())
        hit = bool(gaps[nearest, k] < SAME_NOSING_M)
        add("told", (kind, int(rows[k]), int(columns[k])), hit, number)
        if hit:
            last = number
            add("along", (kind, int(columns[k])), away * apart[nearest, k, 0], number)
            add("height", (kind, int(columns[k])), apart[nearest, k, 1], number)
    for alone in gaps.min(axis=1):
        add("false", (kind,), alone > SAME_NOSING_M)
    add("ends", (kind, end_class(seen, last)), declared.ends)


def fit(records: list[Record], about: Record) -> Record:
    """Return the numbers of the model."""
    found = samples_of(records)
    powers = [_power(found, kind) for kind in range(len(KINDS))]
    found["strain"] = Samples(
        drives=found["error"].drives,
        places=found["error"].places,
        cells=found["error"].cells,
        values=[
            error / sigma ** powers[cell[0]]
            for error, sigma, cell in zip(found["error"].values, found["sigma"].values, found["error"].cells, strict=True)
        ],
    )
    tables = {name: _table(found, kind, powers[kind]) for kind, name in enumerate(KINDS)}
    shared = {name: alike(found[source], binary=binary) for name, source, binary in SHARED}
    return {
        "about": about,
        "normal_grid": GRID.tolist(),
        "tables": tables,
        "shared": shared,
        "common": {name: _common(found[name]) for name in ("along", "height")},
    }


def _power(found: dict[str, Samples], kind: int) -> float:
    """Return how errors grow with what is declared: |error| ~ σ^power."""
    cells = [cell[0] == kind for cell in found["error"].cells]
    error, sigma = np.abs(np.array(found["error"].values)[cells]), np.log(np.array(found["sigma"].values)[cells])
    return float(np.clip(np.polyfit(sigma, np.log(np.maximum(error, 1e-4)), 1)[0], 0.0, 1.0)) if sigma.size > 1 else 0.0


def _table(found: dict[str, Samples], kind: int, power: float) -> Record:
    counts, depths = range(len(COUNTS)), range(len(DEPTHS_M) + 1)
    # Open or closed, which open stairs are too few to separate.
    either = (kind - kind % 2, kind - kind % 2 + 1)
    declared = [[_score(found["told"], (kind, row, column)) for column in depths] for row in range(len(MARGINS_PX) + 1)]
    seen = {cell[:2] for cell in found["accept"].cells}
    accept = []
    for warning in range(4):
        # No drive has a frame of some stairs: those with other risers count, then those with other walls, then other distances.
        others = ((one, warning ^ flip) for flip in (0, 2, 1, 3) for one in (kind, kind ^ 1))
        source = next((other for other in others if other in seen), (kind, warning))
        accept.append([_score(found["accept"], (*source, cell)) for cell in range(len(ACCEPT_PX) + 1)])
    return {
        "accept": {"margins_px": ACCEPT_AT_PX, "score": accept},
        "told": {"score": declared},
        "heading": [
            {
                "power": power,
                "strain": _quantiles(found["strain"].of((kind, cell)), even=True),
                "sigma": _quantiles(found["sigma"].of((kind, cell)), spare=1.0),
            }
            for cell in counts
        ],
        "slope": [_quantiles(found["slope"].of_any(either, cell)) for cell in counts],
        "pitch": [_quantiles(found["pitch"].of_any(either, cell)) for cell in counts],
        "along": [_quantiles(found["along"].of((kind, cell))) for cell in depths],
        "height": [_quantiles(found["height"].of((kind, cell))) for cell in depths],
        "ends": [_score(found["ends"], (kind, cell)) for cell in range(4)],
        "wall": {
            "score": [_score(found["wall"], (kind, cell)) for cell in range(len(WALL_SHARES) + 1)],
            "error": _quantiles(np.concatenate([found["free"].of((one,)) for one in either])),
        },
    }


def _score(samples: Samples, cell: tuple[int, ...]) -> float:
    """Return the normal number below which it happens."""
    values = samples.of(cell, least=LEAST_CHANCES)
    return round(float(norm.ppf(np.clip(values.mean(), 1e-4, 1.0 - 1e-4))), 3)


def _quantiles(values: Float[np.ndarray, " n"], *, spare: float = SPARE, even: bool = False) -> list[float]:
    values = np.concatenate([values, -values]) if even else values
    return [float(f"{value:.4g}") for value in spare * np.quantile(values, norm.cdf(GRID))]


def alike(samples: Samples, *, binary: bool) -> tuple[float, float, float]:
    """Return the variance that frames of a drive share, that which neighbours share besides, and over which way."""
    scores = np.zeros(len(samples.values))
    values = np.array(samples.values)
    keys = np.array([hash(cell) for cell in samples.cells])
    for key in np.unique(keys):
        cell = keys == key
        spread = values[cell]
        if binary:
            scores[cell] = spread - spread.mean()
        else:
            scores[cell] = norm.ppf((rankdata(spread) - 0.5) / spread.size)
    variance = float((scores**2).mean())
    products: dict[int, list[float]] = defaultdict(list)
    drives, places = np.array(samples.drives), np.array(samples.places)
    for one in np.unique(drives):
        its = np.flatnonzero(drives == one)
        i, j = np.triu_indices(its.size, 1)
        apart = np.linalg.norm(places[its[i]] - places[its[j]], axis=1)
        both = scores[its[i]] * scores[its[j]]
        for bin_, _ in enumerate(LAGS_M):
            there = both[np.searchsorted(LAGS_M, apart + 1e-6, side="right") - 1 == bin_]
            products[bin_] += [float(there.sum()), float(there.size)]
    if variance == 0.0:
        return 0.0, 0.0, 1.0
    sums = [np.array(products[bin_]).reshape(-1, 2).sum(axis=0) for bin_ in range(len(LAGS_M))]
    same = [float(np.clip(total / max(count, 1.0) / variance, 0.0, 1.0)) for total, count in sums]
    if binary:
        # A yes or no hides some of what two normal numbers have in common.
        same = [math.sin(0.5 * math.pi * value) for value in same]
    stays = min(same[-1], 0.95)
    changes = max(max(same[0], same[1]) - stays, 0.0)
    ways = [
        -at / math.log((value - stays) / changes)
        for at, value in zip(LAG_AT_M, same[2:-1], strict=True)
        if stays < value < stays + changes
    ]
    return round(stays, 3), round(changes, 3), round(float(np.clip(np.median(ways), 0.05, 3.0)), 3) if ways else 0.1


def _common(samples: Samples) -> float:
    """Return the variance that the nosings of one frame share."""
    frames: dict[int, list[float]] = defaultdict(list)
    for frame, value in zip(samples.frames, samples.values, strict=True):
        frames[frame].append(value)
    several = [np.array(values) for values in frames.values() if len(values) > 1]
    total = np.mean([np.mean(values**2) for values in several])
    pairs = np.mean([(values.sum() ** 2 - (values**2).sum()) / (values.size * (values.size - 1)) for values in several])
    return round(float(np.clip(pairs / total, 0.0, 0.95)), 3)


def modelled(records: list[Record], kind: str, chance: int) -> list[Record]:
    """Return the records with what the model says in place of what the detector said."""
    answers = []
    camera, at = None, None
    for record in records:
        drive_ = (record["drive"], record["rear"])
        if drive_ != at:
            flight = stair_of(record["drive"], rear=record["rear"])[0]
            calibration, rng = calibration_of(kind, rear=record["rear"]), np.random.default_rng([chance, *drive_])
            camera, at = StatisticalCamera(flight.staircase, calibration, rng, sensor=kind), drive_
        assert camera is not None  # noqa: S101 - for the type checker
        heading = sigma = stair = None
        for declared in camera.look(0.0, np.array(record["R"]), np.array(record["p"])):
            if isinstance(declared, HeadingMeasurement):
                heading, sigma = declared.heading_rad, declared.sigma_rad
            else:
                stair = _plain(declared)
        answers.append(record | {"chance": chance, "heading": heading, "sigma": sigma, "map": stair})
    return answers


def validate(records: list[Record], kind: str) -> None:
    """Print the errors of frames next to those of the model."""
    began = time.process_time()
    answers = [answer for chance in range(DRAWS) for answer in modelled(records, kind, chance)]
    spent_ms = 1e3 * (time.process_time() - began) / len(answers)
    frames, model = samples_of(records), samples_of(answers)
    drives = {(record["drive"], record["rear"]) for record in records}
    detector_ms = np.median([record["ms"] for record in records])
    print(
        f"{len(records)} held-out frames of {len(drives)} drives, seeds {min(drives)[0]} to {max(drives)[0]}; "
        f"model drawn {DRAWS} times, {spent_ms:.2f} ms a frame; detector {detector_ms:.1f} ms"
    )
    _print_errors(frames, model)
    _print_shares(frames, model, records, answers)
    _print_trust(frames, model)
    print("\n| alike: share all drive, share of neighbours besides, over how many metres | frames | model |\n| --- | --- | --- |")
    for name, source, binary in SHARED:
        print(f"| {name} | {' | '.join(str(alike(samples[source], binary=binary)) for samples in (frames, model))} |")


def _print_errors(frames: dict[str, Samples], model: dict[str, Samples]) -> None:
    print("\n| error | frames: n | p50, p95, p99, max | model: p50, p95, p99, max | model / frames | KS |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name, unit, scale in ERRORS:
        for kind in (None, *range(len(KINDS))):
            seen, made = (_of_kind(samples[name], kind) * scale for samples in (frames, model))
            parts = [np.quantile(np.abs(values), (0.5, 0.95, 0.99, 1.0)) for values in (seen, made)]
            ratio = parts[1][:3] / np.maximum(parts[0][:3], 1e-9)
            label = f"{name} ({unit}) {'**all**' if kind is None else KINDS[kind]}"
            cells = (_row(parts[0]), _row(parts[1]), _row(ratio), f"{ks_2samp(seen, made).statistic:.3f}")
            print(f"| {label} | {seen.size} | {' | '.join(cells)} |")


def _print_shares(frames: dict[str, Samples], model: dict[str, Samples], records: list[Record], answers: list[Record]) -> None:
    print("\n| how often | frames | model |\n| --- | --- | --- |")
    for kind, label in enumerate(KINDS):
        for name in ("accept", "told", "false", "ends", "wall", "no wall", "obstacle"):
            shares = [_of_kind(samples[name], kind) for samples in (frames, model)]
            print(f"| {name}, {label} | {' | '.join(f'{100 * s.mean():.2f} % of {s.size}' for s in shares)} |")
    for key in ("scene", "texture", "walls"):
        for one in sorted({record[key] for record in records}):
            for rear in (False, True):
                its = [
                    [r["map"] is not None for r in part if r[key] == one and r["rear"] == rear and r["seen"]]
                    for part in (records, answers)
                ]
                if its[0]:
                    cells = " | ".join(f"{100 * np.mean(part):.1f} % of {len(part)}" for part in its)
                    print(f"| accepted, {key} {one}, {'rear' if rear else 'front'} | {cells} |")
    unseen = frames["unseen"].values
    print(f"| accepted with fewer than two nosings near the image | {sum(unseen):.0f} of {len(unseen)} | 0 |")


def _print_trust(frames: dict[str, Samples], model: dict[str, Samples]) -> None:
    print("\n| errors by what is declared | frames: within 95 %, NEES, p99 | model |\n| --- | --- | --- |")
    for kind in range(len(KINDS)):
        for cell, count in enumerate(COUNTS):
            cells = []
            for samples in (frames, model):
                its = np.array([c == (kind, cell) for c in samples["error"].cells])
                strain = np.abs(np.array(samples["error"].values)[its] / np.array(samples["sigma"].values)[its])
                declared = (
                    f"{100 * np.mean(strain < 1.96):.1f} %, {np.mean(strain**2):.2f}, {np.quantile(strain, 0.99):.2f}"
                    if its.any()
                    else ""
                )
                cells.append(declared)
            print(f"| {KINDS[kind]}, {count} nosings or more | {' | '.join(cells)} |")


def _of_kind(samples: Samples, kind: int | None) -> Float[np.ndarray, " n"]:
    return np.array([v for v, cell in zip(samples.values, samples.cells, strict=True) if kind is None or cell[0] == kind] or [0.0])


def _row(values: Float[np.ndarray, " k"]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


def text_of(numbers: Record) -> str:
    """Return JSON with a line for each table: what a fit changes is seen in a diff."""
    kinds = []
    for kind, fitted in numbers.items():
        tables = ",\n".join(f"  {json.dumps(name)}: {json.dumps(table)}" for name, table in fitted["tables"].items())
        rest = [f"{json.dumps(name)}: {json.dumps(value)}" for name, value in fitted.items() if name != "tables"]
        kinds.append(f"{json.dumps(kind)}: {{\n" + ",\n".join(rest) + ',\n"tables": {\n' + tables + "\n}\n}")
    return "{\n" + ",\n".join(kinds) + "\n}\n"


def main() -> None:
    """Fit, or validate."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--camera", choices=list(BASELINES_M), default="kinect1", help="kind of camera")
    parser.add_argument("--drives", type=int, default=100, help="of each direction, to fit or to validate on")
    parser.add_argument("--seed", type=int, default=0, help="of the first drive to fit on; those to validate on start 5000 later")
    parser.add_argument("--fit", action="store_true", help=f"write the kind's numbers in {DATA.name}; else they are validated")
    parser.add_argument("--keep", type=Path, help="folder for the frames' records, so that they need not be rendered again")
    given = parser.parse_args()
    seeds, others = (range(start, start + given.drives) for start in (given.seed, given.seed + HELD_OUT))
    if given.fit:
        records = lines_of(seeds, given.camera, given.keep and given.keep / f"{given.camera}-fit.jsonl")
        calibration = calibration_of(given.camera, rear=False)
        about = {
            "made_by": f"benchmarks/statistical.py --camera {given.camera} --fit --drives {given.drives} --seed {given.seed}",
            "drives": 2 * given.drives,
            "seeds": [seeds.start, seeds.stop - 1],
            "frames": len(records),
            "accepted": sum(record["map"] is not None for record in records),
            "sensor": f"{given.camera}, {calibration.width_px} x {calibration.height_px}, on the mounts of the chair wheelchair",
            "stairs": {"slope_deg": SLOPE_DEG, "rise_m": RISE_M, "steps": (8, 20), "open": 0.3} | AS_BUILT,
            "gravity_error_deg": GRAVITY_ERROR_RAD / DEG,
            "errors_times": SPARE,
        }
        DATA.write_text(text_of(json.loads(DATA.read_text()) | {given.camera: fit(records, about)}))
        return
    validate(lines_of(others, given.camera, given.keep and given.keep / f"{given.camera}-held.jsonl"), given.camera)


if __name__ == "__main__":
    main()
