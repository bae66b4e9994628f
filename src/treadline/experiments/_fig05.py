"""Fig. 5: the six stages of Algorithm 1 on one frame of the simulator.

Paper: Algorithm 1, Fig. 5, Eq. (1)-(4).
"""

from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.angles import DEG, degrees_or_none
from treadline.core.camera_images import RgbdFrame
from treadline.core.rotations import Vector3, rotation_of
from treadline.core.signals import ImuSample
from treadline.experiments.plan import FIG10_SLOPE, turn
from treadline.perception import DetectorConfig, StairDetector
from treadline.perception.overlay import write_stages
from treadline.plant.mujoco import open_plant

HEADING_DEG = 10


def see_stages(figures: Path, seed: int) -> dict[str, Any]:
    """Write the six stages as pictures and return the heading by both methods."""
    frame, gravity_C, true_heading_rad = first_frame(seed)
    printed = StairDetector(DetectorConfig(method="paper")).look(frame, gravity_C, stages=True)
    robust = StairDetector(DetectorConfig(method="robust")).look(frame, gravity_C)
    if printed.stages is not None:
        write_stages(printed.stages, figures)
    return {
        "heading_deg": degrees_or_none(printed.heading_rad),
        "robust_heading_deg": degrees_or_none(robust.heading_rad),
        "robust_sigma_deg": degrees_or_none(robust.sigma_rad),
        "true_heading_deg": true_heading_rad / DEG,
        "edges": printed.edge_count,
        "robust_edges": robust.edge_count,
        "reason": printed.reason,
        "conditions": f"{FIG10_SLOPE}° stair, {HEADING_DEG}° start heading, {frame.camera.width_px}×"
        f"{frame.camera.height_px}, Kinect 1 noise, seed {seed}",
    }


def first_frame(seed: int) -> tuple[RgbdFrame, Vector3, float]:
    """Return the figure's frame, gravity in the camera's frame, and the true heading [rad]."""
    with closing(open_plant(turn(FIG10_SLOPE, HEADING_DEG, 1.0), seed)) as plant:
        plant.start()
        plant.advance(0.0)
        readings = plant.read()
        true_heading_rad = plant.truth()[0].heading_rad
    frame = next(reading for reading in readings if isinstance(reading, RgbdFrame))
    imu = next(reading for reading in readings if isinstance(reading, ImuSample))
    return frame, frame.camera.R_BC.T @ rotation_of(imu.orientation).T @ np.array([0.0, 0.0, -1.0]), true_heading_rad
