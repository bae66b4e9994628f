"""Heading between frames: ``python benchmarks/fusion.py [--seeds N] [--seed S]``.

Compares three methods that fuse a 100 Hz gyro with 10 Hz vision on the same synthetic drives: the paper's offset as printed, the
offset with a gate of 5°, and the filter. Every call draws new seeds, which no tuning has used, and prints them, so a run can be
repeated.
"""

import argparse
import math
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG, wrap
from treadline.core.arrays import rms
from treadline.core.rotations import quaternion_of, rotation_of, rotation_y, rotation_z
from treadline.core.signals import TICK_S, HeadingEstimate, HeadingMeasurement, ImuSample, TrackReading
from treadline.estimation import HeadingFilter, OffsetEstimator
from treadline.estimation.offset import AberrationRule
from treadline.plant.sensors.imu import IMUS, Imu

SLOPE_RAD = 28.0 * DEG
VISION_SIGMA_RAD = 0.3 * DEG
FRAME_TICKS = 10
WALL_FROM_S, GAP_FROM_S, FAULT_FROM_S = 40.0, 90.0, 60.03
TURN_PER_BELT_RAD_M = 0.25 / 0.65
MPU6050_SHAKEN = IMUS["mpu6050"]
WHITE = replace(MPU6050_SHAKEN, vibration_rad_s=0.0, gyro_noise_rad_s_rthz=0.3 * DEG * math.sqrt(2.0 * TICK_S))


class Fusion(Protocol):
    """Any of the three."""

    def step(self, signal: ImuSample | HeadingMeasurement) -> HeadingEstimate | None:
        """Take one signal."""


METHODS: dict[str, Callable[[], Fusion]] = {
    "offset, as printed": lambda: OffsetEstimator(AberrationRule(jump_rad=math.inf)),
    "offset, 5° gate": OffsetEstimator,
    "filter": HeadingFilter,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """One row of the table."""

    label: str
    seconds: float = 120.0
    gap_s: float = 0.0
    """Duration of the interval without vision at the end of the drive [s]."""
    burst_s: float = 0.0
    """Duration of a burst of false headings [s] at the start of every ten seconds, except the first ten."""
    burst_rad: float = 12.0 * DEG
    bias_step_rad_s: float = 0.0
    gyro_jump_rad: float = 0.0
    turn_in_gap_rad: float = 0.0
    wall: bool = False
    """Whether vision measures a wall at a heading error of up to 20° for 14 s, from 40 s on, after up to 3 s without vision."""
    white: bool = False
    """Whether the gyro has white noise of 0.3 °/s instead of vibration."""
    crest: bool = False
    """Whether the chair tips onto the landing half-way through the interval without vision."""


CONDITIONS = (
    Condition(label="vision σ 0.3°"),
    Condition(label="the same, white gyro noise of 0.3 °/s", white=True),
    Condition(label="30 s without vision", gap_s=30.0),
    Condition(label="the same, white gyro noise of 0.3 °/s", gap_s=30.0, white=True),
    Condition(label="30° turned in 30 s without vision", gap_s=30.0, turn_in_gap_rad=30.0 * DEG),
    Condition(label="bursts of 2 s, 12° off", burst_s=2.0),
    Condition(label="gyro bias steps by 1 °/s", seconds=90.0, bias_step_rad_s=1.0 * DEG),
    Condition(label="gyro bias steps by 3 °/s", seconds=90.0, bias_step_rad_s=3.0 * DEG),
    Condition(label="gyro jumps by 15°", seconds=90.0, gyro_jump_rad=15.0 * DEG),
    Condition(label="a wall, 0–20° of heading, for 14 s", seconds=57.0, wall=True),
    Condition(label="over the crest, 14 s without vision", seconds=100.0, gap_s=14.0, crest=True),
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drive:
    """What the sensors say of one drive, and the truth."""

    heading: Float[np.ndarray, " n"]
    samples: list[ImuSample]
    frames: dict[int, HeadingMeasurement]
    belts: list[TrackReading]


def drive_of(condition: Condition, seed: int) -> Drive:
    """Return one drive: 30° off, turned square in a few seconds, then swaying by a degree."""
    rng = np.random.default_rng(seed)
    ticks = round(condition.seconds / TICK_S)
    t = TICK_S * np.arange(ticks)
    phase = rng.uniform(0.0, 2.0 * np.pi, size=2)
    heading = DEG * (30.0 * np.exp(-t / 2.0) + 0.5 * np.sin(2.0 * np.pi * t + phase[0]) + np.sin(t / 5.0 + phase[1]))
    from_s = condition.seconds - condition.gap_s
    heading += condition.turn_in_gap_rad / (1.0 + np.exp(-(t - from_s - 15.0) / 0.7))
    tip = np.clip((t - from_s - 0.5 * condition.gap_s) / 1.5, 0.0, 1.0) if condition.crest else np.zeros(ticks)
    imu = Imu(WHITE if condition.white else MPU6050_SHAKEN, 0.5 * DEG, rng)
    samples, still, before = [], np.zeros(3), rotation_y(-SLOPE_RAD) @ rotation_z(float(heading[0]))
    for k in range(ticks):
        R_WB = rotation_y(-SLOPE_RAD * (1.0 - float(tip[k]))) @ rotation_z(float(heading[k]))
        turn = before.T @ R_WB
        rate = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / (2.0 * TICK_S)
        before = R_WB
        samples.append(_faulty(imu.sample(float(t[k]), R_WB, rate, still, moving=True), condition))
    turned = np.gradient(heading, TICK_S) / TURN_PER_BELT_RAD_M
    belts = [
        TrackReading(t_s=float(at), left_m_s=0.2, right_m_s=0.2 + float(by), brake_on=False)
        for at, by in zip(t, turned, strict=True)
    ]
    return Drive(heading=heading, samples=samples, frames=_frames(condition, heading, rng), belts=belts)


def _faulty(sample: ImuSample, condition: Condition) -> ImuSample:
    """Return what a faulty gyro says; its yaw goes with it."""
    since = sample.t_s - FAULT_FROM_S
    if since <= 0.0:
        return sample
    jump = condition.gyro_jump_rad * min(since / 0.1, 1.0)
    extra = condition.bias_step_rad_s + (condition.gyro_jump_rad / 0.1 if since <= 0.1 else 0.0)
    R = rotation_z(condition.bias_step_rad_s * since + jump) @ rotation_of(sample.orientation)
    return replace(
        sample,
        orientation=quaternion_of(R),
        angular_velocity_rad_s=sample.angular_velocity_rad_s + np.array([0.0, 0.0, extra]),
    )


def _frames(condition: Condition, heading: Float[np.ndarray, " n"], rng: np.random.Generator) -> dict[int, HeadingMeasurement]:
    at_an_angle = float(rng.uniform(-20.0 * DEG, 20.0 * DEG))
    wall_s = WALL_FROM_S + float(rng.uniform(0.0, 3.0))
    frames = {}
    for k in range(0, len(heading), FRAME_TICKS):
        t_s = k * TICK_S
        seen = float(heading[k]) + VISION_SIGMA_RAD * float(rng.standard_normal())
        if t_s >= condition.seconds - condition.gap_s or (condition.wall and WALL_FROM_S <= t_s < wall_s):
            continue
        if condition.wall and t_s >= wall_s:
            seen += at_an_angle
        if t_s >= 10.0 and t_s % 10.0 < condition.burst_s - 1e-6:
            seen += condition.burst_rad
        frames[k] = HeadingMeasurement(t_s=t_s, heading_rad=wrap(seen), sigma_rad=VISION_SIGMA_RAD, edge_count=6)
    return frames


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """What one method made of one drive."""

    errors_rad: Float[np.ndarray, " n"]
    sigmas_rad: Float[np.ndarray, " n"]
    found_s: float
    """Time of the first fault report after the onset of the fault [s]; infinity without a report."""
    alarms: int


def outcome_of(drive: Drive, fusion: Fusion) -> Outcome:
    """Run one method over one drive."""
    ticks = len(drive.samples)
    errors, sigmas = np.full(ticks, np.nan), np.full(ticks, np.nan)
    declared: set[float] = set()
    for k, sample in enumerate(drive.samples):
        if isinstance(fusion, HeadingFilter):
            fusion.step(drive.belts[k])
        estimate = fusion.step(sample)
        if k in drive.frames:
            estimate = fusion.step(drive.frames[k])
            if isinstance(fusion, HeadingFilter) and fusion.health is not None and fusion.health.since_s is not None:
                declared.add(fusion.health.since_s)
        if estimate is not None:
            errors[k] = wrap(estimate.heading_rad - float(drive.heading[k]))
            sigmas[k] = estimate.sigma_rad
    after = [at_s for at_s in declared if at_s >= FAULT_FROM_S]
    return Outcome(errors_rad=errors, sigmas_rad=sigmas, found_s=min(after, default=math.inf), alarms=len(declared))


def table(seeds: list[int]) -> None:
    """Print RMS and largest error of each method; two seconds are what averaging takes at the start."""
    print("| condition | " + " | ".join(f"{name}: RMS / max °" for name in METHODS) + " | normalised² | alarms | found s |")
    print("| --- |" + " --- |" * (len(METHODS) + 3))
    for condition in CONDITIONS:
        drives = [drive_of(condition, seed) for seed in seeds]
        cells = []
        for make in METHODS.values():
            outcomes = [outcome_of(drive, make()) for drive in drives]
            skip = round(2.0 / TICK_S)
            errors = np.concatenate([outcome.errors_rad[skip:] for outcome in outcomes])
            cells.append(f"{rms(errors) / DEG:.2f} / {np.abs(errors).max() / DEG:.2f}")
        # The last method is the filter.
        squares = np.concatenate([np.square(outcome.errors_rad[skip:] / outcome.sigmas_rad[skip:]) for outcome in outcomes])
        faulty = condition.bias_step_rad_s != 0.0 or condition.gyro_jump_rad != 0.0
        found = [outcome.found_s - FAULT_FROM_S for outcome in outcomes]
        when = f"{np.median(found):.2f}, at worst {max(found):.2f}" if faulty else "–"
        alarms = sum(outcome.alarms for outcome in outcomes)
        print(f"| {condition.label} | {' | '.join(cells)} | {squares.mean():.2f} | {alarms} | {when} |", flush=True)


def main() -> None:
    """Read the arguments and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--seed", type=int, default=None, help="the first; drawn when left out")
    arguments = parser.parse_args()
    first = secrets.randbelow(1_000_000) if arguments.seed is None else arguments.seed
    print(f"seeds {first} to {first + arguments.seeds - 1}\n")
    started = time.process_time()
    table(list(range(first, first + arguments.seeds)))
    print(f"\n{time.process_time() - started:.0f} s of CPU")


if __name__ == "__main__":
    main()
