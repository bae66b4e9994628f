"""The compiled sums are those of the textbook, and of numpy."""

import math

import numpy as np
import pytest

from treadline.angles import quaternion_of, rotation_of, rotation_x, rotation_y, rotation_z
from treadline.devices import kernels


def turned(seed: int) -> np.ndarray:
    """Return a rotation by any angles."""
    a, b, c = np.random.default_rng(seed).uniform(-math.pi, math.pi, 3)
    return rotation_z(a) @ rotation_y(b) @ rotation_x(c)


@pytest.mark.parametrize("seed", range(40))
def test_rotations_and_quaternions_are_those_of_angles(seed: int) -> None:
    R = turned(seed)
    q = kernels.quaternion(R)
    # The same sums; the norm's root alone may be rounded otherwise.
    np.testing.assert_allclose(q, quaternion_of(R), rtol=0.0, atol=1e-15)
    back = np.empty((3, 3))
    kernels.rotation(*q.tolist(), back)
    np.testing.assert_array_equal(back, rotation_of(q))


def test_a_product_rounds_each_term_once() -> None:
    # (1 + e)(1 - e) - 1 = -e², which a product that is rounded before it is added loses.
    small = 2.0**-30
    assert kernels.dot(np.array([-1.0, 1.0 + small]), np.array([1.0, 1.0 - small])) == -(small**2)
    A, B = turned(1), turned(2)
    np.testing.assert_allclose(kernels.product(A, B), A @ B, rtol=0.0, atol=1e-15)


def test_a_chair_stands_on_what_it_touched_and_on_nosings_that_it_rocks_onto() -> None:
    reaches = np.array([[0.1, 0.2, 0.3, 0.3], [0.2, 0.1, 0.3, 0.4]])
    # Under the belts, too far below them, beyond their end.
    nosings = np.array([[0.35, 0.0, -0.01], [-0.4, 0.0, -0.02], [0.6, 0.0, 0.0]])
    found = kernels.support(reaches, nosings, np.zeros(3), np.eye(3), 0.5, 0.015)
    assert found == (0.35, 0.2, 0.3, 0.4)
