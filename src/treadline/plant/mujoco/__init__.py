"""MuJoCo plant with moving belt surfaces and sensor models.

Contract: ``open_plant(scenario, seed)``; ``model_xml`` for export; ``Physics`` are the numerical settings of the contacts.
"""

from treadline.plant.mujoco._mjcf_scene import model_xml
from treadline.plant.mujoco.contact._coulomb_kernels import TOLERANCE_M_S2
from treadline.plant.mujoco.contact._parameters import FAST, NOMINAL, Physics
from treadline.plant.mujoco.mujoco_plant import MujocoPlant, open_plant
from treadline.plant.sensors._instruments import ChairState

__all__ = ["FAST", "NOMINAL", "TOLERANCE_M_S2", "ChairState", "MujocoPlant", "Physics", "model_xml", "open_plant"]
