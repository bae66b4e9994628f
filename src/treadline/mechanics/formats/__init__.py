"""Export of chair and stair: URDF for ROS, SDF for Gazebo. MJCF is written by the simulator (``sim.scene``)."""

from treadline.mechanics.formats.sdf import sdf_model, sdf_world
from treadline.mechanics.formats.urdf import urdf

__all__ = ["sdf_model", "sdf_world", "urdf"]
