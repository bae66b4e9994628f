"""The chair in Gazebo 11 (ODE): a second simulator behind the same port, with the tracks of the paper's reference [20].

Nothing here is needed to drive, and nothing is imported unless a Gazebo plant is asked for.
"""

from treadline.gazebo.environment import Environment, find_environment
from treadline.gazebo.plant import GazeboPlant, open_gazebo

__all__ = ["Environment", "GazeboPlant", "find_environment", "open_gazebo"]
