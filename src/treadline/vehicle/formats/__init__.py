"""Export of chair and stair: URDF for ROS, SDF for Gazebo. MJCF is written by the simulator (``sim.scene``)."""

from treadline.vehicle.formats.sdf import sdf_model, sdf_world
from treadline.vehicle.formats.urdf import urdf

__all__ = ["sdf_model", "sdf_world", "urdf"]
