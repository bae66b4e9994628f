"""The fit of one direction to treads and risers, and down from the treads."""

from dataclasses import replace

import numpy as np
import pytest
from surfaces import CAMERA, surface

from treadline.core.angles import DEG
from treadline.core.rotations import rotation_x, rotation_y
from treadline.perception._edge_fit import EdgeFit, fit_edges
from treadline.perception._gravity_direction import down_of_treads
from treadline.perception._step_parts import NosingObservation

DOWN = np.array([0.0, 1.0, 0.0])
TRUE_EDGE = rotation_y(20.0 * DEG) @ np.array([1.0, 0.0, 0.0])
START = np.array([1.0, 0.0, 0.0])
AHEAD = (5.0 * DEG, 70.0 * DEG)


def riser(turned_rad: float = 0.0, distance_m: float = 2.0) -> NosingObservation:
    plane = surface(rotation_y(20.0 * DEG + turned_rad) @ np.array([0.0, 0.0, 1.0]), distance_m=distance_m)
    return NosingObservation(step=0, ahead_m=distance_m, point=plane.centre, sides_m=(-0.5, 0.5), riser=plane, lines=())


def fit(risers: list[NosingObservation]) -> EdgeFit:
    return fit_edges(risers, [surface(DOWN), surface(DOWN)], DOWN, 0.5 * DEG, START, CAMERA)


def sigma_of(found: EdgeFit) -> float:
    """Return the standard deviation of the edge's angle about the vertical."""
    return found.sigma_of(found.ahead)


def off_rad(found: EdgeFit) -> float:
    """Return the angle between the found edge and the true one."""
    return float(np.arcsin(np.linalg.norm(np.cross(found.edge, TRUE_EDGE))))


def test_perfect_planes_give_the_exact_direction() -> None:
    assert off_rad(fit([riser(distance_m=distance) for distance in (1.0, 1.3, 1.6)])) < 1e-7


def test_one_surface_that_is_no_riser_has_little_say() -> None:
    good = [riser(distance_m=distance) for distance in (1.0, 1.3, 1.6, 1.9)]
    # The plain mean of five would be off by 2.4°.
    assert off_rad(fit([*good, riser(12.0 * DEG)])) < 0.6 * DEG


def turning(turn_deg: float, bend_deg: float = 0.0) -> EdgeFit:
    """Return the fit to six nosings, 1 to 2.5 m away, each turned to the left of the one before, one of them by another angle."""
    nosings = [riser(-k * turn_deg * DEG - (k == 3) * bend_deg * DEG, 1.0 + 0.3 * k) for k in range(6)]
    return fit([replace(nosing, step=k) for k, nosing in enumerate(nosings)])


@pytest.mark.parametrize("turn_deg", [1.5, -3.0, 5.5, -12.0])
def test_edges_that_turn_from_step_to_step_are_those_of_a_winding_flight(turn_deg: float) -> None:
    """Test: six risers, each turned by a further angle; one of them by 0.2° more.

    Expected result: a winding flight, its turn per step within 15 %, although single surfaces differ by up to 60°.
    """
    found = turning(turn_deg, 0.2)
    assert found.winding > 0.99
    assert found.turn_per_step_rad == pytest.approx(turn_deg * DEG, rel=0.15)
    assert found.agreeing == 1.0


def test_parallel_edges_are_those_of_a_straight_flight() -> None:
    assert turning(0.0).winding < 0.05
    assert turning(0.0, 0.3).winding < 0.1


def test_down_is_not_guessed_without_treads() -> None:
    wall = np.tile([0.0, 0.0, 1.0], (200, 1))
    assert down_of_treads(wall, AHEAD) is None
    assert down_of_treads(np.zeros((0, 3)), AHEAD) is None
    assert down_of_treads(np.tile(DOWN @ rotation_x(-30.0 * DEG), (5, 1)), AHEAD) is None
