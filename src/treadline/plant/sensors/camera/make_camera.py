"""Camera of a scenario: ``ChairState -> readings``, independent of the simulator."""

from collections.abc import Sequence

import numpy as np

from treadline.core.ports import Reading
from treadline.core.signals import FrameQuality
from treadline.plant.sensors.camera.ray_camera import Camera
from treadline.plant.sensors.instruments import ChairState
from treadline.plant.sensors.statistical_camera import StatisticalCamera
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Scenario
from treadline.vehicle.staircase import Staircase

CameraModel = Camera | StatisticalCamera
"""Rendered or statistical camera."""


def make_camera(
    scenario: Scenario,
    staircase: Staircase,
    chair: ChairDescription,
    *,
    statistical_rng: np.random.Generator,
    render_rng: np.random.Generator,
) -> CameraModel:
    """Return the camera of a scenario: a rendering camera, or a statistical model of the detector output.

    Args:
        statistical_rng: Random numbers of the statistical camera.
        render_rng: Random numbers of the rendering camera.
    """
    sensors, stair, vision = scenario.sensors, scenario.stair, scenario.control.vision
    calibration = chair.camera_at(sensors.image_height_px, rear=scenario.drive.direction == "down")
    if vision == "truth" or sensors.camera == "statistical":
        return StatisticalCamera(staircase, calibration, statistical_rng, exact=vision == "truth")
    return Camera(staircase, calibration, kind=sensors.camera, texture=stair.texture, light=stair.light, rng=render_rng)


def look(camera: CameraModel, state: ChairState) -> Sequence[Reading]:
    """Return the readings of the camera at the state of the chair."""
    t_s, R_WB, p_WB = state.t_s, state.R_WB, state.p_WB
    if isinstance(camera, StatisticalCamera):
        arrived = FrameQuality(t_s=t_s, fingerprint=state.tick, brightness=0.5, contrast=0.2, valid_share=1.0)
        return [arrived, *camera.look(t_s, R_WB, p_WB)]
    calibration = camera.calibration
    return [camera.frame(t_s, R_WB @ calibration.R_BC, p_WB + R_WB @ np.array(calibration.mount_m))]
