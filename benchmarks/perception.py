"""Heading error and time of both methods on fresh frames: ``python benchmarks/perception.py [--frames N] [--seed S]``.

Every call draws seeds that nobody has tuned on, and prints them, so that a run can be repeated. Frames are rendered with
Kinect 1 noise from within a flight. Algorithm 1 is judged by its answer as printed, and again with 90° taken off.
"""

import argparse
import secrets
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG, rotation_z
from treadline.mechanics.chair import read_chair
from treadline.mechanics.staircase import build_staircase
from treadline.perception import DetectorConfig, StairDetector
from treadline.scenario import Stair
from treadline.signals import RgbdFrame
from treadline.sim.camera import Camera
from treadline.sim.camera.camera import TEXTURES

SLOPES_DEG = (25.0, 28.0, 30.0)
HEADINGS_DEG = (0.0, 10.0, 20.0, 30.0, 35.0)
METHODS: tuple[tuple[str, Literal["paper", "robust"], float], ...] = (
    ("paper as printed", "paper", 0.0),
    ("paper, less 90°", "paper", 90.0),
    ("robust", "robust", 0.0),
)
GRAVITY_ERROR_DEG = 0.5
LEAST_SHARE = 0.15
"""Of the image that must be stair for a frame to count."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One row of the table."""

    label: str
    method: Literal["paper", "robust"] = "robust"
    taken_off_deg: float = 0.0
    """From the answer: 90° makes Eq. (2), which answers 90° to a chair that stands square, an arcsine."""
    knows_down: bool = True
    slopes_deg: tuple[float, ...] = SLOPES_DEG
    headings_deg: tuple[float, ...] | None = None
    """Sides are drawn; None draws |ψ| ≤ 35°."""
    stair: dict[str, object] = field(default_factory=dict)
    height_px: int = 240


def cases() -> Iterator[Case]:
    """Yield the rows."""
    for name, method, taken_off_deg in METHODS:
        for slope in SLOPES_DEG:
            label = f"{name} | {slope:.0f}° slope"
            yield Case(label=label, method=method, taken_off_deg=taken_off_deg, slopes_deg=(slope,))
        for heading in HEADINGS_DEG:
            label = f"{name} | ±{heading:.0f}° heading"
            yield Case(label=label, method=method, taken_off_deg=taken_off_deg, headings_deg=(heading,))
    yield Case(label="robust | 640×480", height_px=480)
    yield Case(label="robust | open risers", stair={"open_risers": True})
    yield Case(label="robust | nosings turned by 0.3°", stair={"nosing_yaw_jitter_deg": 0.3})
    yield Case(label="robust | nosings turned by 1°", stair={"nosing_yaw_jitter_deg": 1.0})
    yield Case(label="robust | gravity not known", knows_down=False)


def frame_of(case: Case, rng: np.random.Generator) -> tuple[RgbdFrame, Float[np.ndarray, " 3"], float, float]:
    """Return a frame, gravity with its error, the true heading and the stair's share of the image."""
    stair = Stair.model_validate(
        {
            "slope_deg": float(rng.choice(case.slopes_deg)),
            "texture": str(rng.choice(TEXTURES)),
            "light": float(rng.uniform(0.5, 1.6)),
            "walls": str(rng.choice(["none", "left", "right", "both"])),
        }
        | case.stair
    )
    heading_deg = rng.uniform(-35.0, 35.0) if case.headings_deg is None else rng.choice(case.headings_deg) * rng.choice([-1.0, 1.0])
    heading = float(heading_deg) * DEG
    staircase = build_staircase(stair, rng)
    calibration = read_chair("wheelchair").camera_at(case.height_px)
    camera = Camera(staircase, calibration, texture=stair.texture, light=stair.light, rng=rng)
    R_WB = staircase.R_WS @ rotation_z(heading)
    R_WC = R_WB @ calibration.R_BC
    along, lateral = rng.uniform(0.3, 3.0), rng.uniform(-0.25, 0.25)
    p_WC = staircase.p_WS + staircase.R_WS @ np.array([along, lateral, 0.0]) + R_WB @ np.array(calibration.mount_m)
    down = R_WC.T @ np.array([0.0, 0.0, -1.0])
    side = np.cross(down, rng.standard_normal(3))
    tilt = GRAVITY_ERROR_DEG * DEG
    gravity = np.cos(tilt) * down + np.sin(tilt) * side / np.linalg.norm(side)
    boxes = staircase.boxes()
    is_step = np.array([*(box.kind == "step" for box in boxes), False])
    face = camera.exact(R_WC, p_WC).face
    share = float(is_step[np.where(face >= 0, face // 6, len(boxes))].mean())
    return camera.frame(0.0, R_WC, p_WC), gravity, heading, share


def row(case: Case, seeds: range) -> str:
    """Return one row: what a method makes of some frames."""
    detector = StairDetector(DetectorConfig(method=case.method))
    errors, strains, spent_ms, count = [], [], [], 0
    for seed in seeds:
        frame, gravity, heading, share = frame_of(case, np.random.default_rng(seed))
        if share < LEAST_SHARE:
            continue
        count += 1
        started = time.process_time()
        sight = detector.look(frame, gravity if case.knows_down else None)
        spent_ms.append((time.process_time() - started) * 1e3)
        if sight.heading_rad is not None and sight.sigma_rad is not None:
            error = sight.heading_rad - case.taken_off_deg * DEG - heading
            errors.append(error / DEG)
            strains.append(error / sight.sigma_rad)
    if not errors:
        return f"| {case.label} | {count} | 0 % | | | | | |"
    size, inside = np.abs(errors), np.mean(np.abs(strains) < 1.96)
    return (
        f"| {case.label} | {count} | {100 * len(errors) / count:.0f} % | {np.sqrt(np.mean(size**2)):.3f}° | "
        f"{np.quantile(size, 0.95):.3f}° | {size.max():.3f}° | {100 * inside:.0f} % | {np.median(spent_ms):.1f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=60, help="per row")
    parser.add_argument("--seed", type=int, default=None, help="first seed; drawn if not given")
    arguments = parser.parse_args()
    first = secrets.randbelow(2**31) if arguments.seed is None else arguments.seed
    seeds = range(first, first + arguments.frames)
    print(f"Kinect 1 noise, gravity {GRAVITY_ERROR_DEG}° off, frames with more than {LEAST_SHARE:.0%} stair, one core (CPU time);")
    print(f"seeds {seeds.start} to {seeds.stop - 1}: repeat with --seed {first} --frames {arguments.frames}\n")
    print("| method | frames | n | accepted | RMSE | p95 | max | in declared 95 % | ms (median) |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for case in cases():
        print(row(case, seeds), flush=True)


if __name__ == "__main__":
    main()
