"""Lifecycle nodes for ROS 2 around the shells of ``treadline.ros``."""
