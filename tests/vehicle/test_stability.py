"""Static stability, against plumb lines dropped in the world's frame."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.core.angles import DEG
from treadline.core.rotations import rotation_x, rotation_y, rotation_z
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair
from treadline.vehicle.bodies import centre_of_mass
from treadline.vehicle.tip_over_margin import Support, sideways_margins, tipping_margins

CHAIR = read_chair("wheelchair-fixed")
slopes = st.floats(5.0 * DEG, 40.0 * DEG)
headings = st.floats(-60.0 * DEG, 60.0 * DEG)


@given(
    point=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
    pitch=st.floats(-0.6, 0.6),
    roll=st.floats(-0.6, 0.6),
    height=st.floats(0.05, 1.5),
    edge=st.sampled_from(["uphill", "downhill", "left", "right"]),
)
def test_the_margin_is_zero_exactly_when_the_plumb_line_meets_the_edge(
    point: tuple[float, float], pitch: float, roll: float, height: float, edge: str
) -> None:
    support = Support(front_m=0.3, rear_m=0.3, left_m=0.35, right_m=0.35)
    x, y = point
    foot = {"uphill": (0.3, y, 0.0), "downhill": (-0.3, y, 0.0), "left": (x, 0.35, 0.0), "right": (x, -0.35, 0.0)}[edge]
    outwards = {"uphill": (1, 0, 0), "downhill": (-1, 0, 0), "left": (0, 1, 0), "right": (0, -1, 0)}[edge]
    up = (rotation_x(-roll) @ rotation_y(pitch))[2]
    com = np.array(foot) + height / up[2] * up

    def margin(beyond_m: float) -> float:
        moved = com + beyond_m * np.array(outwards)
        found = tipping_margins(triple(moved), triple(up), support)
        return float(getattr(found, edge))

    assert margin(0.0) == pytest.approx(0.0, abs=1e-12)
    assert margin(0.01) < 0.0 < margin(-0.01)


def triple(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return (x, y, z)


def sideways(slope_rad: float, heading_rad: float = 0.0, **loading: object) -> tuple[float, float]:
    """Return the margins to left and right of the chair on a flight, the seat levelled against its pitch."""
    up = (rotation_y(-slope_rad) @ rotation_z(heading_rad)).T @ np.array([0.0, 0.0, 1.0])
    com = centre_of_mass(CHAIR, Chair.model_validate(loading), math.asin(up[0]))
    return sideways_margins(CHAIR.tracks, com, triple(up))


def test_square_on_a_stair_the_margin_aside_is_to_the_belts_outer_edges() -> None:
    slope = 28.0 * DEG
    height = centre_of_mass(CHAIR, Chair(), slope)[2]
    # Up the slope the vertical leans back: in the plane across the chair only its part along the chair's z counts.
    outer_edge = 0.5 * 0.65 + 0.5 * 0.10
    left, right = sideways(slope)
    assert left == pytest.approx(math.atan2(outer_edge, height), abs=1e-12)
    assert right == pytest.approx(left, abs=1e-12)


@given(slope=slopes, heading=headings, payload=st.floats(0.0, 150.0), aside=st.floats(-0.3, 0.3))
def test_left_and_right_are_mirror_images(slope: float, heading: float, payload: float, aside: float) -> None:
    here = sideways(slope, heading, payload_kg=payload, payload_offset_m=[0.0, aside, 0.0])
    mirrored = sideways(slope, -heading, payload_kg=payload, payload_offset_m=[0.0, -aside, 0.0])
    assert here == pytest.approx(mirrored[::-1], abs=1e-12)


@given(angle=st.floats(-40.0 * DEG, 40.0 * DEG), payload=st.floats(0.0, 150.0), shift=st.floats(-0.3, 0.3))
def test_the_payload_turns_about_the_hinge(angle: float, payload: float, shift: float) -> None:
    loading = Chair(payload_kg=payload, seat_shift_m=shift)
    com = np.array(centre_of_mass(CHAIR, loading, angle))
    seat_kg, chassis_kg = CHAIR.empty_seat_kg + loading.payload_kg, CHAIR.masses.chassis_kg
    hinge = np.array(CHAIR.seat.hinge_m) + np.array([shift, 0.0, 0.0])
    # Forward is a positive turn about y: z towards x.
    seat = hinge + rotation_y(angle) @ np.array(CHAIR.seat.payload_com_m)
    expected = (chassis_kg * np.array(CHAIR.masses.chassis_com_m) + seat_kg * seat) / (chassis_kg + seat_kg)
    np.testing.assert_allclose(com, expected, atol=1e-12)
