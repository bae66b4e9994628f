"""Colours, walls, ramps, ladders and turns shared by the scenes."""

import math
from dataclasses import replace

import numpy as np

from treadline.core.rotations import Vector3, rotation_y, rotation_z
from treadline.plant.sensors.camera.solids import Rgb, SceneBox, beam, upright

Section = tuple[float, float]

BEECH: Rgb = (176.0, 132.0, 84.0)
"""Colours of furniture (red, green, blue)."""
WHITE: Rgb = (205.0, 203.0, 198.0)
CARDBOARD: Rgb = (158.0, 124.0, 84.0)
WALL_M = 3.0
"""Height of walls [m]."""


def oblique_wall(middle_x_m: float, yaw_rad: float, *, y_m: float = 0.0, low_m: float = 0.0, half_m: float = 3.0) -> SceneBox:
    """Return a wall across the path, rotated about its middle."""
    centre = np.array([middle_x_m + 0.05 * math.cos(yaw_rad), y_m + 0.05 * math.sin(yaw_rad)])
    low = (centre[0] - 0.05, centre[1] - half_m, low_m - 0.2)
    high = (centre[0] + 0.05, centre[1] + half_m, low_m + WALL_M)
    return upright("wall", low, high, yaw_rad=yaw_rad)


def turned(solid: SceneBox, yaw_rad: float, about_m: tuple[float, float]) -> SceneBox:
    """Return a solid turned about a vertical axis."""
    turn = rotation_z(yaw_rad)
    pivot = np.array([*about_m, 0.0])
    return replace(solid, centre_W=pivot + turn @ (solid.centre_W - pivot), R_WK=turn @ solid.R_WK)


def incline(x_m: float, low_m: float, slope_rad: float, length_m: float, half_m: float, colour: Rgb | None = None) -> SceneBox:
    """Return a ramp that rises from a place ahead."""
    turn = rotation_y(-slope_rad)
    middle = np.array([x_m, 0.0, low_m]) + turn @ np.array([0.5 * length_m, 0.0, -0.1])
    return SceneBox(kind="ramp", centre_W=middle, half_m=np.array([0.5 * length_m, half_m, 0.1]), R_WK=turn, colour=colour)


def leaning_ladder(
    foot: Vector3, lean_rad: float, half_m: float, length_m: float, rungs_m: np.ndarray, rail: Section, rung: Section, colour: Rgb
) -> list[SceneBox]:
    """Return two rails that lean from a foot, and the rungs between them.

    Args:
        rungs_m: Places of the rungs along the rails.
        rail: Width and height of the section of a rail [m]; ``rung`` that of a rung.
    """
    along, aside = np.array([math.cos(lean_rad), 0.0, math.sin(lean_rad)]), np.array([0.0, half_m, 0.0])
    rails = [beam("ladder", foot + side, foot + side + length_m * along, rail, colour=colour) for side in (-aside, aside)]
    places = [foot + at * along for at in rungs_m]
    return [*rails, *(beam("ladder", place - aside, place + aside, rung, colour=colour) for place in places)]


def legged(x: float, y: float, half: tuple[float, float], top: float, leg: float, colour: Rgb) -> list[SceneBox]:
    """Return a plate on four legs: a table or a seat."""
    plate = upright("furniture", (x - half[0], y - half[1], top - 0.03), (x + half[0], y + half[1], top), colour=colour)
    legs = [
        upright("furniture", (cx - leg, cy - leg, 0.0), (cx + leg, cy + leg, top - 0.03), colour=colour)
        for cx in (x - half[0] + leg, x + half[0] - leg)
        for cy in (y - half[1] + leg, y + half[1] - leg)
    ]
    return [plate, *legs]
