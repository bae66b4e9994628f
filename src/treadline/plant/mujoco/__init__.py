"""MuJoCo plant with moving belt surfaces and sensor models.

Contract: ``open_plant(scenario, seed)``; ``model_xml`` for export; ``Physics`` are the numerical settings of the contacts.
"""

from treadline.plant.mujoco._mjcf_scene import model_xml
from treadline.plant.mujoco.contact._coulomb_kernels import TOLERANCE_M_S2
from treadline.plant.mujoco.contact._parameters import NOMINAL, Physics
from treadline.plant.mujoco.mujoco_plant import MujocoPlant, open_plant

__all__ = ["NOMINAL", "TOLERANCE_M_S2", "MujocoPlant", "Physics", "model_xml", "open_plant"]
