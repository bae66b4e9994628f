"""Simulated chairs behind the ``Plant`` port: MuJoCo and Gazebo, with shared actuators, sensors and faults.

Contract: ``treadline.plant.mujoco.open_plant(scenario, seed)``.
"""
