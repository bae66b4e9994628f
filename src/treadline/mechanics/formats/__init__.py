"""The chair and the stair written for others: URDF for ROS, SDF for Gazebo. MJCF is the simulator's own (``sim.scene``)."""

from treadline.mechanics.formats.sdf import sdf_model, sdf_world
from treadline.mechanics.formats.urdf import urdf

__all__ = ["sdf_model", "sdf_world", "urdf"]
