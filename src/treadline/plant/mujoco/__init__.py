"""MuJoCo plant with moving belt surfaces and sensor models."""

from treadline.plant.mujoco.mujoco_plant import MujocoPlant, open_plant
from treadline.plant.sensors.instruments import CAMERA_PERIOD_S

__all__ = ["CAMERA_PERIOD_S", "MujocoPlant", "open_plant"]
