"""The camera that a scenario asks for: ``ChairState -> readings``, whichever simulator moved the chair."""

from collections.abc import Sequence

import numpy as np

from treadline.devices.instruments import ChairState
from treadline.devices.statistical import StatisticalCamera
from treadline.mechanics.chair import ChairDescription
from treadline.mechanics.staircase import Staircase
from treadline.scenario import Scenario
from treadline.signals import FrameQuality, Reading
from treadline.sim.camera.camera import Camera

Eye = Camera | StatisticalCamera


def open_eye(
    scenario: Scenario, staircase: Staircase, chair: ChairDescription, *, says: np.random.Generator, draws: np.random.Generator
) -> Eye:
    """Return the camera in use: one that draws frames, or one that says what a detector would say of them.

    Args:
        says: Chance of the one that says …
        draws: … and of the one that draws.
    """
    sensors, stair, vision = scenario.sensors, scenario.stair, scenario.control.vision
    calibration = chair.camera_at(sensors.image_height_px, rear=scenario.drive.direction == "down")
    if vision == "truth" or sensors.camera == "statistical":
        return StatisticalCamera(staircase, calibration, says, exact=vision == "truth")
    return Camera(staircase, calibration, kind=sensors.camera, texture=stair.texture, light=stair.light, rng=draws)


def look(eye: Eye, state: ChairState) -> Sequence[Reading]:
    """Return what a camera on the chair tells of this instant."""
    t_s, R_WB, p_WB = state.t_s, state.R_WB, state.p_WB
    if isinstance(eye, StatisticalCamera):
        arrived = FrameQuality(t_s=t_s, fingerprint=state.tick, brightness=0.5, contrast=0.2, valid_share=1.0)
        return [arrived, *eye.look(t_s, R_WB, p_WB)]
    camera = eye.calibration
    return [eye.frame(t_s, R_WB @ camera.R_BC, p_WB + R_WB @ np.array(camera.mount_m))]
