"""Clouds of lidars before a flight: ``python benchmarks/lidars.py [--frames N] [--seed S]``.

Rays with the published geometry of a sensor are cast on the solids of ``scenes``; ranges have the sensor's noise. The sensor is on
a mast, level, 0.8 m above the floor and 1.2 m before the first nosing. Its clouds are those of its own frame (x forward, y left, z
up), with the direction of gravity.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from perception_cases import LIFELIKE
from scenes import ViewRecipe
from scenes.scores import percent
from scenes.views import draw_stage
from tables import frame_options, markdown, seeds_of

from treadline.core.angles import DEG
from treadline.io.frames import frame_of_points
from treadline.perception import StairDetector
from treadline.plant.sensors.camera.solids import SceneBox

Rays = Float[np.ndarray, "n 3"]
GOLDEN = 0.5 * (5.0**0.5 - 1.0)
"""Ratio of two rates whose pattern repeats last."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lidar:
    """Directions of the rays of one exposure in the sensor's frame, and the standard deviation of a range."""

    rays: Callable[[np.random.Generator], Rays]
    sigma_m: float
    scans: int = 1
    """Number of scans that are added up."""


def spinning(rows: int, field_deg: tuple[float, float], columns: int) -> Callable[[np.random.Generator], Rays]:
    """Return the rays of one turn of a lidar with equally spaced rows."""

    def rays(rng: np.random.Generator) -> Rays:
        azimuth = 2.0 * np.pi * (np.arange(columns) + rng.random()) / columns
        elevation = np.linspace(*field_deg, rows) * DEG
        return _directions(*np.meshgrid(azimuth, elevation))

    return rays


def mirror(points: int, field_deg: tuple[float, float], beams: int = 4) -> Callable[[np.random.Generator], Rays]:
    """Return the rays of a turning mirror that nods at an unrelated rate: a full circle that does not repeat."""

    def rays(rng: np.random.Generator) -> Rays:
        t_s = np.arange(points // beams) / (points // beams)
        low, high = field_deg
        swing = np.arccos(np.cos(2.0 * np.pi * (97.0 + GOLDEN) * t_s[:, None] + 2.0 * np.pi * np.arange(beams) / beams)) / np.pi
        azimuth = 2.0 * np.pi * (10.0 * (1.0 + GOLDEN) * t_s + rng.random())[:, None] + 0.0 * swing
        return _directions(azimuth.ravel(), ((low + (high - low) * swing) * DEG).ravel())

    return rays


def rosette(points: int, half_deg: tuple[float, float]) -> Callable[[np.random.Generator], Rays]:
    """Return the rays of two prisms that turn against each other."""

    def rays(rng: np.random.Generator) -> Rays:
        t_s = np.arange(points) / points
        first, second = (2.0 * np.pi * (rate * t_s + rng.random()) for rate in (121.57, -77.73))  # 7294 and 4664 turns a minute
        x, y = 0.5 * (np.cos(first) + np.cos(second)), 0.5 * (np.sin(first) + np.sin(second))
        return _directions(x * half_deg[0] * DEG, y * half_deg[1] * DEG)

    return rays


LIDARS = {
    "OS1-64, one scan": Lidar(rays=spinning(64, (-22.5, 22.5), 1024), sigma_m=0.01),
    "VLP-16, 20 scans": Lidar(rays=spinning(16, (-15.0, 15.0), 1800), sigma_m=0.03, scans=20),
    "Mid-360, 1 s": Lidar(rays=mirror(200_000, (-52.0, 7.0)), sigma_m=0.02),
    "Avia, 1 s": Lidar(rays=rosette(240_000, (35.2, 38.6)), sigma_m=0.02),
}
"""Sensors: rows, field of view, points a second and range noise of the data sheets (Ouster OS1 gen 2: 45° and 1 cm; Velodyne
VLP-16: 30°, 0.2° at 10 Hz and 3 cm; Livox Mid-360: -7 to 52° and 2 cm; Livox Avia: 70.4° × 77.2° and 2 cm, with the rates of the
prisms of a Mid-40). A Mid-360 is mounted upside down on a chair, so that it sees the floor."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LidarView:
    """Scans before a flight, and its ground truth."""

    clouds: list[Float[np.ndarray, "n 3"]]
    """Points of each scan in the sensor's frame (x forward, y left, z up) [m]."""
    poses: list[tuple[float, ...]]
    """Pose of the sensor at each scan in odometry: x, y, z [m], roll, pitch, yaw [deg]."""
    heading_rad: float
    """Heading of the chair at the last scan."""
    rise_m: float


def draw_lidar(seed: int, lidar: Lidar, *, ahead_m: float = 1.2, travel_m: float = 1.0, lifelike: bool = True) -> LidarView:
    """Return the scans of a chair that drives straight to ``ahead_m`` before a random flight, the last one there."""
    rng = np.random.default_rng(seed)
    recipe = ViewRecipe(scenes=("foot",), place_m=(ahead_m + 0.4, ahead_m + 0.4), **(LIFELIKE if lifelike else {}))
    stage, pose = draw_stage(rng, recipe)
    assert stage.flight is not None  # noqa: S101 - for the type checker
    clouds, poses = [], []
    for back_m in np.linspace(travel_m if lidar.scans > 1 else 0.0, 0.0, lidar.scans):
        p_WB = pose.p_WB - back_m * pose.R_WB[:, 0]
        clouds.append(scan(stage.solids, lidar, pose.R_WB, p_WB + pose.R_WB @ np.array(stage.true.mount_m), rng))
        poses.append((-float(back_m), 0.0, 0.0, 0.0, 0.0, 0.0))
    right_B = pose.R_WB.T @ np.array([0.0, -1.0, 0.0])
    staircase = stage.flight.staircase
    return LidarView(
        clouds=clouds,
        poses=poses,
        heading_rad=float(np.arctan2(-right_B[0], -right_B[1])),
        rise_m=float(staircase.pitch_m * np.sin(staircase.slope_rad)),
    )


def scan(
    solids: list[SceneBox], lidar: Lidar, R_WL: np.ndarray, p_WL: np.ndarray, rng: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    """Return the points of one scan in the sensor's frame; rays without a hit are left out."""
    rays = lidar.rays(rng)
    range_m = np.full(len(rays), np.inf)
    for solid in solids:
        near = _may_hit(rays @ (R_WL.T @ (solid.centre_W - p_WL)), solid, p_WL)
        origin, along = solid.R_WK.T @ (p_WL - solid.centre_W), rays[near] @ R_WL.T @ solid.R_WK
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = np.stack([-solid.half_m - origin, solid.half_m - origin])[:, None] / along[None]
        enter, leave = sides.min(axis=0).max(axis=1), sides.max(axis=0).min(axis=1)
        hit = near[(enter <= leave) & (enter > 0.0)]
        range_m[hit] = np.minimum(range_m[hit], enter[(enter <= leave) & (enter > 0.0)])
    known = np.isfinite(range_m)
    noisy = range_m[known] + lidar.sigma_m * rng.standard_normal(int(known.sum()))
    return np.asarray((noisy[:, None] * rays[known]).astype(np.float32))


def _may_hit(along_m: np.ndarray, solid: SceneBox, p_WL: np.ndarray) -> np.ndarray:
    """Return the rays that pass through the sphere around a solid, by the distance along each ray to its nearest place."""
    away_2 = float(np.sum((solid.centre_W - p_WL) ** 2))
    return np.flatnonzero((away_2 - along_m**2 <= float(solid.half_m @ solid.half_m)) & ((along_m > 0.0) | (away_2 < 25.0)))


def _directions(azimuth_rad: np.ndarray, elevation_rad: np.ndarray) -> Rays:
    azimuth_rad, elevation_rad = np.ravel(azimuth_rad), np.ravel(elevation_rad)
    level = np.cos(elevation_rad)
    return np.stack([level * np.cos(azimuth_rad), level * np.sin(azimuth_rad), np.sin(elevation_rad)], axis=1)


def row(name: str, seeds: range) -> str:
    """Return what the detector makes of the clouds of one sensor."""
    lidar, errors = LIDARS[name], []
    for seed in seeds:
        view = draw_lidar(seed, lidar)
        several = lidar.scans > 1
        points = view.clouds if several else view.clouds[0]
        named = frame_of_points(points, poses=view.poses if several else None, axes="ros", gravity=[0.0, 1.0, 0.0])
        assert named.frame is not None  # noqa: S101 - for the type checker
        sight = StairDetector().look(named.frame, named.gravity_C)
        if sight.accepted and sight.heading_rad is not None and sight.sigma_rad is not None:
            errors.append(((sight.heading_rad - view.heading_rad) / DEG, sight.sigma_rad / DEG))
    inside = sum(abs(error) <= 1.96 * sigma for error, sigma in errors)
    rms = float(np.sqrt(np.mean([error**2 for error, _ in errors]))) if errors else float("nan")
    return f"| {name} | {percent(len(errors), len(seeds))} | {rms:.2f}° | {percent(inside, len(errors))} |"


def main() -> None:
    """Print the table."""
    seeds = seeds_of(frame_options(__doc__, 30, "per sensor").parse_args())
    markdown("| | accepted | RMSE | in the 95 % interval |", (row(name, seeds) for name in LIDARS))


if __name__ == "__main__":
    main()
