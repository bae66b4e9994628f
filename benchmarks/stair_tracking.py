"""Accuracy of the stair tracker on rendered drives: nosings, rise and run against ground truth, with and without refused frames.

Run: ``python benchmarks/stair_tracking.py [--drives N] [--seed S] [--kind kinect1|d455|rear]`` (about 10 s of CPU a drive). Each
drive is a chair that follows its path exactly over an as-built stair at 0.2 m/s with 10 frames per second: the detector sees
rendered frames, the tracker gets its maps, an IMU with a constant tilt error, and belts that slip. ``kinect1`` and ``d455`` climb
from 3.5 and 5.2 m before the flight, ``rear`` backs down from the landing.
"""

import argparse
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scenes import SceneCamera, ViewRecipe
from scenes.flight import draw_flight
from statistical import AS_BUILT, CHAIR, DOWN_W, FLAT_M, pose_at, tilt_of
from tables import table

from treadline.core.angles import DEG
from treadline.core.rotations import Vector3, quaternion_of, rotation_y
from treadline.core.signals import ImuSample, StairMap, TrackReading
from treadline.estimation.stair_tracker import StairTracker
from treadline.perception import StairDetector
from treadline.perception.detector import DetectorConfig
from treadline.vehicle.staircase import Staircase

FRAME_S, SPEED_M_S, TICKS = 0.1, 0.2, 10
SLOPE_DEG, RISE_M, STEPS = (24.0, 32.0), (0.14, 0.18), (8, 12)
HEADING_RAD, ASIDE_M = 3.0 * DEG, 0.1
HEADING_SIGMA_RAD, HEADING_FRAMES = 0.1 * DEG, 10
"""Standard deviation of the fused heading's error [rad], and frames over which it decays by 1/e."""
SLIP, SLIP_SIGMA, SLIP_FRAMES = (0.0, 0.03), 0.01, 10
"""Range of a drive's mean slip on the flight, standard deviation about the mean, and frames over which the deviation decays."""
FLOOR_SLIP = 0.3
"""Slip on the floor as a ratio of that on the flight."""
MOUNTS_M = 0.7
"""Distance of mid-track from the first nosing, or from the edge, at which the chair is about to drive onto the flight [m]."""
NEAR_M = 1.2
REFUSED = (0.0, 0.9)
SEED = 9100


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moment:
    """Ground truth and signals at one frame."""

    t_s: float
    travel_m: float
    pitch_rad: float
    imu_pitch_rad: float
    p_WB: Vector3
    scene: str
    stair_map: StairMap | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drive:
    """One recorded drive."""

    seed: int
    rear: bool
    heading_rad: float
    steps: Float[np.ndarray, "n 2"]
    moments: list[Moment]


def record(kind: str, seed: int) -> Drive:
    """Return the frames of one drive, rendered and detected."""
    rng, rear = np.random.default_rng([seed, 4711]), kind == "rear"
    slope, rise = float(rng.uniform(*SLOPE_DEG)), float(rng.uniform(*RISE_M))
    run = rise / math.tan(slope * DEG)
    flight = draw_flight(ViewRecipe(**AS_BUILT, rise_m=(rise, rise), run_m=(run, run), steps=STEPS), rng)
    stairs = flight.staircase
    calibration = CHAIR.camera_at(480 if kind == "d455" else 240, rear=rear)
    if kind == "d455":
        calibration = replace(calibration, fx_px=387.0, fy_px=387.0)
        camera = SceneCamera(flight.solids(), calibration, kind=kind, rng=rng)
    else:
        camera = SceneCamera(flight.solids(), calibration, grain_px=AS_BUILT["grain_px"], warp_px=AS_BUILT["warp_px"], rng=rng)
    detector, tilt = StairDetector(DetectorConfig()), tilt_of(rng)
    heading, aside = float(rng.uniform(-HEADING_RAD, HEADING_RAD)), float(rng.uniform(-ASIDE_M, ASIDE_M))
    slip = mean = float(rng.uniform(*SLIP))
    moments: list[Moment] = []
    for k, x_m in enumerate(_places(kind, stairs)):
        R_WB, p_WB, scene = pose_at(stairs, float(x_m), aside, heading)
        rock = AS_BUILT["rock_deg"] * DEG * math.sin(2.0 * math.pi * x_m / run) * (scene != "level")
        R_WB = R_WB @ rotation_y(rock)
        R_WC = R_WB @ calibration.R_BC
        frame = camera.frame(k * FRAME_S, R_WC, p_WB + R_WB @ np.array(calibration.mount_m))
        slip += (mean - slip) / SLIP_FRAMES + SLIP_SIGMA * math.sqrt(2.0 / SLIP_FRAMES) * float(rng.standard_normal())
        moved = float(np.linalg.norm(p_WB - moments[-1].p_WB)) if moments else 0.0
        belts = moved * (1.0 + max(slip, 0.0) * (FLOOR_SLIP if scene == "level" else 1.0))
        moments.append(
            Moment(
                t_s=frame.t_s,
                travel_m=-belts if rear else belts,
                pitch_rad=math.asin(R_WB[2, 0]),
                imu_pitch_rad=-math.asin(float((R_WB.T @ tilt @ DOWN_W)[0])),
                p_WB=p_WB,
                scene=scene,
                stair_map=detector.see(frame, R_WC.T @ tilt @ DOWN_W).stair_map,
            )
        )
    steps = np.array([(step.x_m, step.z_m) for step in stairs.steps])
    return Drive(seed=seed, rear=rear, heading_rad=heading, steps=steps, moments=moments)


def _places(kind: str, stairs: Staircase) -> Float[np.ndarray, " n"]:
    last_m, step_m = stairs.steps[-1].x_m, SPEED_M_S * FRAME_S
    if kind == "rear":
        return np.arange(last_m + FLAT_M + 0.6, -0.7, -step_m)
    return np.arange(-5.2 if kind == "d455" else -3.5, last_m + 0.1, step_m)


def replay(drive: Drive, refused: float) -> Iterator[tuple[Moment, StairTracker]]:
    """Yield the tracker after each frame, with a share of the frames refused at random."""
    rng, tracker, wander = np.random.default_rng(drive.seed), StairTracker(), 0.0
    before = drive.moments[0].imu_pitch_rad
    for moment in drive.moments:
        wander += -wander / HEADING_FRAMES + HEADING_SIGMA_RAD * math.sqrt(2.0 / HEADING_FRAMES) * float(rng.standard_normal())
        tracker.heading_rad = drive.heading_rad + wander
        speed = moment.travel_m / FRAME_S
        for tick in range(1, TICKS + 1):
            t_s = moment.t_s + FRAME_S * (tick / TICKS - 1.0)
            pitch = before + (moment.imu_pitch_rad - before) * tick / TICKS
            tracker.update(
                ImuSample(
                    t_s=t_s,
                    orientation=quaternion_of(rotation_y(-pitch)),
                    angular_velocity_rad_s=np.zeros(3),
                    linear_acceleration_m_s2=np.array([0.0, 0.0, 9.81]),
                )
            )
            tracker.update(TrackReading(t_s=t_s, left_m_s=speed, right_m_s=speed, brake_on=False))
        before = moment.imu_pitch_rad
        if moment.stair_map is not None and rng.random() >= refused:
            tracker.update(moment.stair_map)
        yield moment, tracker


def scores_of(drive: Drive, refused: float) -> dict[str, list[float]]:
    """Return the errors of one drive by quantity [m], and squared errors over declared variances."""
    found: dict[str, list[float]] = defaultdict(list)
    edge_m = drive.steps[-1, 0] if drive.rear else drive.steps[0, 0]
    way, about_to_mount = -1.0 if drive.rear else 1.0, False
    for moment, tracker in replay(drive, refused):
        ahead = np.array(tracker.ahead_m())
        if len(ahead) < 2:
            continue
        offset = drive.steps - moment.p_WB[[0, 2]]
        truth = offset @ [math.cos(moment.pitch_rad) / math.cos(drive.heading_rad), math.sin(moment.pitch_rad)]
        number = np.abs(ahead[:, None] - truth).argmin(axis=1)
        built = np.polyfit(number, drive.steps[number], 1)[0]
        error, near = ahead - truth[number], np.abs(truth[number]) < NEAR_M
        if "first seen" not in found:
            found["first seen"].append(way * (edge_m - moment.p_WB[0]))
            found["first rise"].append(tracker.rise_m - built[1])
            found["first run"].append(tracker.run_m - built[0])
        if not about_to_mount and way * (edge_m - moment.p_WB[0]) < MOUNTS_M:
            about_to_mount = True
            found["before mounting"].extend(error)
            found["rise"].append(tracker.rise_m - built[1])
            found["run"].append(tracker.run_m - built[0])
            for name, off, sigma in (
                ("rise", found["rise"][-1], tracker.rise_sigma_m),
                ("run", found["run"][-1], tracker.run_sigma_m),
            ):
                found[f"NEES {name}"].append((off / sigma) ** 2)
        if about_to_mount and moment.scene in ("mount", "flight"):
            found["on the flight"].extend(error[near])
        sigma = np.array(tracker.ahead_sigma_m())
        found["NEES before" if not about_to_mount else "NEES flight"].extend(((error / sigma) ** 2)[near & np.isfinite(sigma)])
    return found


def main() -> None:
    """Print one row for each camera and share of refused frames."""
    parser = argparse.ArgumentParser(description="Measure the stair tracker on rendered drives.")
    parser.add_argument("--drives", type=int, default=12, help="number of drives of each kind")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the first drive")
    parser.add_argument("--kind", choices=("kinect1", "d455", "rear"), action="append", help="camera; all when left out")
    options = parser.parse_args()
    names = ("before mounting", "on the flight", "first rise", "first run", "rise", "run")
    rows = []
    for kind in options.kind or ("kinect1", "d455", "rear"):
        drives = [record(kind, options.seed + k) for k in range(options.drives)]
        for refused in REFUSED:
            scores = [scores_of(drive, refused) for drive in drives]
            rows.append(
                [
                    f"{kind}, {100 * refused:.0f} % refused",
                    f"{np.mean(_all(scores, 'first seen')):.2f} m",
                    *(f"{1e3 * math.sqrt(np.mean(np.square(_all(scores, name)))):.2f}" for name in names),
                    *(_mean(_all(scores, f"NEES {name}")) for name in ("before", "flight", "rise", "run")),
                ]
            )
    title = f"{options.drives} drives each, seeds {options.seed} to {options.seed + options.drives - 1}; RMS errors in mm"
    table(title, ["", "known from", *names, "NEES before", "NEES flight", "NEES rise", "NEES run"], rows)


def _mean(values: Sequence[float]) -> str:
    return f"{np.mean(values):.2f}" if values else "–"


def _all(scores: Sequence[dict[str, list[float]]], name: str) -> list[float]:
    return [value for score in scores for value in score[name]]


if __name__ == "__main__":
    main()
