"""Sensor models of the simulated chair: IMU, encoders, rendered and statistical camera."""
