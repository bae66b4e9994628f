"""Render one noisy frame of a 28° stair and read the heading from it, both ways."""

import numpy as np

from treadline.angles import DEG, rotation_z
from treadline.mechanics.chair import read_chair
from treadline.mechanics.staircase import build_staircase
from treadline.perception import DetectorConfig, StairDetector
from treadline.scenario import Stair
from treadline.sim.camera import Camera

HEADING_DEG = 12.0

stair = build_staircase(Stair.model_validate({"slope_deg": 28.0}), np.random.default_rng(0))
calibration = read_chair("wheelchair").camera_at(240)
R_WB = stair.R_WS @ rotation_z(HEADING_DEG * DEG)
p_WB = stair.p_WS + stair.R_WS @ np.array([1.5, 0.0, 0.0])
R_WC = R_WB @ calibration.R_BC
frame = Camera(stair, calibration, rng=np.random.default_rng(1)).frame(0.0, R_WC, p_WB + R_WB @ np.array(calibration.mount_m))
gravity_C = R_WC.T @ np.array([0.0, 0.0, -1.0])

for method in ("robust", "paper"):
    sight = StairDetector(DetectorConfig(method=method)).look(frame, gravity_C)
    heading = "none" if sight.heading_rad is None else f"{sight.heading_rad / DEG:+.2f}°"
    print(f"{method}: {heading} (true {HEADING_DEG:+.2f}°), {sight.edge_count} edges")
