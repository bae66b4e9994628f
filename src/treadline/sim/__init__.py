"""MuJoCo plant with moving belt surfaces and sensor models."""

from treadline.devices.instruments import CAMERA_PERIOD_S
from treadline.sim.plant import MujocoPlant, open_plant

__all__ = ["CAMERA_PERIOD_S", "MujocoPlant", "open_plant"]
