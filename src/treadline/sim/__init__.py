"""A MuJoCo plant with native track surfaces and honest sensors."""

from treadline.sim.plant import CAMERA_PERIOD_S, MujocoPlant, open_plant

__all__ = ["CAMERA_PERIOD_S", "MujocoPlant", "open_plant"]
