"""Actuator and sensor models of a simulated chair, independent of the simulator.

``sim`` (MuJoCo) and ``gazebo`` supply the state of the chair; all other models are common to both simulators.
"""
