"""Chair in Gazebo 11 (ODE): a second simulator with the same interface, using the track model of the paper's reference [20].

Driving does not need this package; it is imported only if a Gazebo plant is requested.
"""

from treadline.plant.gazebo._gazebo_plant import GazeboPlant, open_gazebo
from treadline.plant.gazebo._gzserver import Environment, find_environment

__all__ = ["Environment", "GazeboPlant", "find_environment", "open_gazebo"]
