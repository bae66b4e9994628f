"""The compiled sums are those of the textbook, and of numpy."""

import math

import numpy as np
import pytest

from treadline.core.rotations import quaternion_of, rotation_of, rotation_x, rotation_y, rotation_z
from treadline.plant.sensors import _pose_kernels as kernels
from treadline.plant.sensors._instruments import chair_numbers, section_numbers
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


ROCKING = math.tan(math.radians(2.0))
"""Ground within 2° of turning is support."""


def test_a_chair_stands_on_nosings_that_it_meets_within_two_degrees_of_turning() -> None:
    # 0.2 m from the contact 2° are 7 mm. The second is further below the belts, the third beyond their end; roundings lift tops.
    edges = np.array([[0.4, 0.0, -0.0169, 0.01], [-0.4, 0.0, -0.0071, 0.0], [0.6, 0.0, 0.0, 0.0]])
    found = kernels.support(0.2, 0.2, edges, np.zeros(3), np.eye(3), 0.5, ROCKING)
    assert found == (0.4, 0.2)


def test_a_chair_in_the_air_stands_on_nothing() -> None:
    found = kernels.support(-math.inf, -math.inf, np.array([[0.4, 0.0, 0.0, 0.0]]), np.zeros(3), np.eye(3), 0.5, ROCKING)
    assert found == (-math.inf, -math.inf)


@pytest.mark.parametrize("gap_m", [0.0, 0.01, 0.2])
@pytest.mark.parametrize("pitch_deg", [0.0, 28.0])
def test_a_pulley_is_above_the_highest_tread_below_its_axis(gap_m: float, pitch_deg: float) -> None:
    # A tread of 0.3 m whose top is at 1.0 m, and a higher one above the tip that carries nothing.
    surfaces = np.array([[0.0, 0.0, 1.0, 0.0, 0.15, 0.6, 1.0, 0.0], [0.0, 0.0, 1.0, 0.0, 0.15, 0.6, 1.5, 0.0]])
    R = rotation_y(-pitch_deg * math.pi / 180.0)
    tip_B, radius = np.array([0.9, 0.325, 0.2]), 0.07
    axis_W = np.array([0.05, 0.325, 1.0 + radius + gap_m])
    place_m, found_m = kernels.pulley_gap(surfaces, 0.9, 0.2, 0.325, radius, axis_W - R @ tip_B, R)
    lowest_B = tip_B + R.T @ np.array([0.0, 0.0, -radius])
    assert (place_m, found_m) == (pytest.approx(lowest_B[0]), pytest.approx(gap_m, abs=1e-12))


def test_a_pulley_beyond_the_end_of_a_turned_tread_has_no_ground() -> None:
    c, s = math.cos(0.5), math.sin(0.5)
    surfaces = np.array([[0.0, 0.0, c, s, 0.15, 0.6, 1.0, 0.0]])
    for out_m, stands in ((0.149, True), (0.151, False)):
        p_WB = np.array([out_m * c - 0.9, out_m * s, 1.0])
        assert (kernels.pulley_gap(surfaces, 0.9, 0.07, 0.0, 0.07, p_WB, np.eye(3))[1] < math.inf) == stands


@pytest.mark.parametrize(("gap_deg", "margin_deg"), [(1.9, 26.6), (2.1, 0.0)])
def test_a_chair_upon_a_kerb_that_would_turn_onto_its_front_pulley_within_two_degrees_has_not_tipped(
    gap_deg: float, margin_deg: float
) -> None:
    """Test: a level chair balanced on an edge below its centre of mass, 0.5 m high, its front pulley 0.25 m ahead in the air."""
    numbers = kernels.ChairNumbers(half_run=0.25, hinge=(0.0, 0.0, 0.0), seat_kg=0.0, chassis_kg=50.0, chassis=(0.0, 0.0, 0.5))
    run = np.array([((-0.25, 0.07), 0.5, (0.07, 0.07), 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.5)], kernels.SECTION)
    floor = np.array([[0.25, 0.0, 1.0, 0.0, 0.1, 0.6, -0.25 * math.tan(math.radians(gap_deg)), 0.0]])
    found = kernels.truth(
        *(np.eye(3), np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3), 0.0, 0.0, np.array([0.0, 0.5, 9.0, 9.0]), -1),
        *(np.zeros((25, 4)), np.zeros((0, 4)), floor, numbers, run, np.zeros(3), np.zeros(3), ROCKING, (0.0, 0.0, 1.0)),
    )
    # arctan(0.25 m / 0.5 m) to the pulley, nothing to the edge.
    assert math.degrees(found[8]) == pytest.approx(margin_deg, abs=0.05)


@pytest.mark.parametrize("name", ["wheelchair", "wheelchair-fixed"])
def test_compiled_truth_agrees_with_the_mechanics_that_it_repeats(name: str) -> None:
    chair, loading = read_chair(name), Chair(model=name, payload_kg=80.0, seat_shift_m=0.03)
    rng = np.random.default_rng(3)
    payload, numbers = np.array(payload_com(chair, loading)), (chair_numbers(chair, loading), section_numbers(chair))
    for _ in range(20):
        seat_rad, flipper_rad, pitch, roll = rng.uniform(-0.4, 0.4, 4).tolist()
        R_WB, p_WB = rotation_y(pitch) @ rotation_x(roll), rng.normal(size=3)
        reach = rng.uniform(0.2, 0.6, 4)
        declared = kernels.truth(
            *(np.eye(3), np.zeros(3), R_WB, p_WB, np.zeros(3), seat_rad, flipper_rad, reach, -1),
            *(np.zeros((25, 4)), np.zeros((0, 4)), np.zeros((0, 8)), *numbers, payload, payload, ROCKING, (0.0, 0.0, 1.0)),
        )
        support = Support(front_m=reach[0], rear_m=reach[1], left_m=reach[2], right_m=reach[3])
        margins = tipping_margins(centre_of_mass(chair, loading, seat_rad, flipper_rad), tuple(R_WB[2].tolist()), support)
        # Without a turn of the stair, its coordinates are those of the world.
        np.testing.assert_allclose(declared[5:7], p_WB[:2], atol=1e-14)
        # The same sums in the same order: only the library of the trigonometric functions may differ.
        assert declared[8] == pytest.approx(min(margins.uphill, margins.downhill, margins.left, margins.right), abs=1e-14)
        place_W = p_WB + R_WB @ np.array(payload_place(chair, loading, seat_rad))
        np.testing.assert_allclose(declared[9:], place_W, atol=1e-14)
