"""The compiled sums are those of the textbook, and of numpy."""

import math

import numpy as np
import pytest

from treadline.core.rotations import quaternion_of, rotation_of, rotation_x, rotation_y, rotation_z
from treadline.plant.sensors import _pose_kernels as kernels
from treadline.plant.sensors._instruments import chair_numbers
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair
from treadline.vehicle.bodies import centre_of_mass, payload_com, payload_place
from treadline.vehicle.tip_over_margin import Support, tipping_margins


def turned(seed: int) -> np.ndarray:
    """Return a rotation by any angles."""
    a, b, c = np.random.default_rng(seed).uniform(-math.pi, math.pi, 3)
    return rotation_z(a) @ rotation_y(b) @ rotation_x(c)


@pytest.mark.parametrize("seed", range(12))
def test_rotations_and_quaternions_are_those_of_angles(seed: int) -> None:
    R = turned(seed)
    q = kernels.quaternion(R)
    # The same sums; the norm's root alone may be rounded otherwise.
    np.testing.assert_allclose(q, quaternion_of(R), rtol=0.0, atol=1e-15)
    back = np.empty((3, 3))
    kernels.rotation(*q.tolist(), back)
    np.testing.assert_array_equal(back, rotation_of(q))


def test_a_chair_stands_on_what_it_touched_and_on_nosings_that_it_rocks_onto() -> None:
    reaches = np.array([[0.1, 0.2, 0.3, 0.3], [0.2, 0.1, 0.3, 0.4]])
    # Under the belts, too far below them, beyond their end.
    nosings = np.array([[0.35, 0.0, -0.01], [-0.4, 0.0, -0.02], [0.6, 0.0, 0.0]])
    found = kernels.support(reaches, nosings, np.zeros(3), np.eye(3), 0.5, 0.015)
    assert found == (0.35, 0.2, 0.3, 0.4)


@pytest.mark.parametrize(("gap_m", "counts"), [(0.0, True), (0.0099, True), (0.011, False)])
@pytest.mark.parametrize("pitch_deg", [0.0, 28.0])
def test_a_tip_within_ten_millimetres_of_a_tread_is_support_below_its_axis(gap_m: float, counts: bool, pitch_deg: float) -> None:
    # A tread of 0.3 m whose top is at 1.0 m, and a higher one above the tip that carries nothing.
    surfaces = np.array([[0.0, 0.0, 1.0, 0.0, 0.15, 0.6, 1.0, 0.0], [0.0, 0.0, 1.0, 0.0, 0.15, 0.6, 1.5, 0.0]])
    R = rotation_y(-pitch_deg * math.pi / 180.0)
    tip_B, radius = np.array([0.9, 0.325, 0.2]), 0.07
    axis_W = np.array([0.05, 0.325, 1.0 + radius + gap_m])
    found = kernels.tip_support(surfaces, 0.9, 0.2, 0.325, radius, axis_W - R @ tip_B, R, 0.010)
    lowest_B = tip_B + R.T @ np.array([0.0, 0.0, -radius])
    assert found == (pytest.approx(lowest_B[0]) if counts else -math.inf)


def test_a_tip_beyond_the_end_of_a_turned_tread_is_no_support() -> None:
    c, s = math.cos(0.5), math.sin(0.5)
    surfaces = np.array([[0.0, 0.0, c, s, 0.15, 0.6, 1.0, 0.0]])
    for out_m, counts in ((0.149, True), (0.151, False)):
        p_WB = np.array([out_m * c - 0.9, out_m * s, 1.0])
        assert (kernels.tip_support(surfaces, 0.9, 0.07, 0.0, 0.07, p_WB, np.eye(3), 0.01) > 0.0) == counts


@pytest.mark.parametrize("name", ["wheelchair", "wheelchair-fixed"])
def test_compiled_truth_agrees_with_the_mechanics_that_it_repeats(name: str) -> None:
    chair, loading = read_chair(name), Chair(model=name, payload_kg=80.0, seat_shift_m=0.03)
    rng = np.random.default_rng(3)
    payload, numbers = np.array(payload_com(chair, loading)), chair_numbers(chair, loading)
    for _ in range(20):
        seat_rad, flipper_rad, pitch, roll = rng.uniform(-0.4, 0.4, 4).tolist()
        R_WB, p_WB = rotation_y(pitch) @ rotation_x(roll), rng.normal(size=3)
        reach = rng.uniform(0.2, 0.6, 4)
        declared = kernels.truth(
            *(np.eye(3), np.zeros(3), R_WB, p_WB, np.zeros(3), seat_rad, flipper_rad, reach, -1),
            *(np.zeros((25, 4)), np.zeros((0, 3)), np.zeros((0, 7)), numbers, payload, payload, (0.015, 0.01), (0.0, 0.0, 1.0)),
        )
        support = Support(front_m=reach[0], rear_m=reach[1], left_m=reach[2], right_m=reach[3])
        margins = tipping_margins(centre_of_mass(chair, loading, seat_rad, flipper_rad), tuple(R_WB[2].tolist()), support)
        # The same sums in the same order: only the library of the trigonometric functions may differ.
        assert declared[8] == pytest.approx(margins.worst, abs=1e-14)
        place_W = p_WB + R_WB @ np.array(payload_place(chair, loading, seat_rad))
        np.testing.assert_allclose(declared[9:], place_W, atol=1e-14)
