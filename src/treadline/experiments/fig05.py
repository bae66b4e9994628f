"""Fig. 5: the six stages of Algorithm 1 on one frame of the simulator.

Paper: Algorithm 1, Fig. 5, Eq. (1)-(4).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from treadline.angles import DEG, rotation_of
from treadline.experiments.plan import FIG10_SLOPE, turn
from treadline.perception import DetectorConfig, StairDetector
from treadline.perception.pictures import write_stages
from treadline.signals import ImuSample, RgbdFrame
from treadline.sim import open_plant

HEADING_DEG = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class StagesJob:
    """The figure's frame."""

    name: str
    figures: Path
    seed: int

    def run(self) -> dict[str, Any]:
        """Look at it and return the figure's numbers."""
        return see_stages(self.figures, self.seed)


def see_stages(figures: Path, seed: int) -> dict[str, Any]:
    """Write the six stages as pictures and return what both modes make of the frame."""
    scenario = turn(FIG10_SLOPE, HEADING_DEG, 1.0)
    plant = open_plant(scenario, seed)
    try:
        plant.start()
        plant.advance(0.0)
        readings = plant.read()
        true_heading = plant.truth()[0].heading_rad
    finally:
        plant.close()
    frame = next(reading for reading in readings if isinstance(reading, RgbdFrame))
    imu = next(reading for reading in readings if isinstance(reading, ImuSample))
    gravity_C = frame.camera.R_BC.T @ rotation_of(imu.orientation).T @ np.array([0.0, 0.0, -1.0])
    printed = StairDetector(DetectorConfig(method="paper")).look(frame, gravity_C, stages=True)
    robust = StairDetector(DetectorConfig(method="robust")).look(frame, gravity_C)
    if printed.stages is not None:
        write_stages(printed.stages, figures)
    return {
        "heading_deg": _degrees(printed.heading_rad),
        "robust_heading_deg": _degrees(robust.heading_rad),
        "robust_sigma_deg": _degrees(robust.sigma_rad),
        "true_heading_deg": true_heading / DEG,
        "edges": printed.edge_count,
        "robust_edges": robust.edge_count,
        "reason": printed.reason,
        "conditions": f"{FIG10_SLOPE}° stair, {HEADING_DEG}° start heading, {frame.camera.width_px}×"
        f"{frame.camera.height_px}, Kinect 1 noise, seed {seed}",
    }


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else angle_rad / DEG
