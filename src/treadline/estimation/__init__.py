"""Heading between frames: vision, gyro and their disagreement."""
