"""Static stability, against plumb lines dropped in the world's frame."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from treadline.vehicle.verdict import static_margins

from treadline.core.angles import DEG
from treadline.core.rotations import rotation_x, rotation_y, rotation_z
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.scenario.scenario import Chair
from treadline.vehicle.bodies import centre_of_mass
from treadline.vehicle.tip_over_margin import Margins, Support, tipping_margins, worst_support

CHAIR = read_chair("wheelchair-fixed")
RUN_M = 0.30
slopes = st.floats(5.0 * DEG, 40.0 * DEG)
headings = st.floats(-60.0 * DEG, 60.0 * DEG)


def pitch_of(slope_rad: float) -> float:
    return RUN_M / math.cos(slope_rad)


def margins(slope_rad: float, heading_rad: float = 0.0, chair: ChairDescription = CHAIR, **loading: object) -> Margins:
    return static_margins(chair, Chair.model_validate(loading), slope_rad, pitch_of(slope_rad), heading_rad)


def downhill_margin_by_plumb_line(slope_rad: float, payload_kg: float) -> float:
    """Return the angle between the vertical and the line from the rear edge of support to the centre of mass.

    In the vertical plane of the flight, axes horizontal and up: a level seat has its payload right above the hinge.
    """
    along = np.array([math.cos(slope_rad), math.sin(slope_rad)])
    normal = np.array([-math.sin(slope_rad), math.cos(slope_rad)])
    hinge = CHAIR.seat.hinge_m[0] * along + CHAIR.seat.hinge_m[2] * normal
    payload = hinge + np.array([CHAIR.seat.payload_com_m[0], CHAIR.seat.payload_com_m[2]])
    chassis = CHAIR.masses.chassis_com_m[0] * along + CHAIR.masses.chassis_com_m[2] * normal
    seat_kg = CHAIR.empty_seat_kg + payload_kg
    com = (CHAIR.masses.chassis_kg * chassis + seat_kg * payload) / (CHAIR.masses.chassis_kg + seat_kg)
    rear_edge = (pitch_of(slope_rad) - 0.5 * CHAIR.tracks.flat_run_m) * along
    across, up = com - rear_edge
    return math.atan2(across, up)


@pytest.mark.parametrize(("slope_deg", "margin_deg"), [(25, 12.0), (28, 9.5), (30, 7.8)])
def test_the_shipped_chair_keeps_these_margins_downhill(slope_deg: int, margin_deg: float) -> None:
    found = margins(slope_deg * DEG).downhill
    assert found == pytest.approx(downhill_margin_by_plumb_line(slope_deg * DEG, 50.0), abs=1e-12)
    assert found / DEG == pytest.approx(margin_deg, abs=0.05)


@given(slope=slopes, payload=st.floats(0.0, 200.0))
def test_the_margin_downhill_is_the_plumb_lines(slope: float, payload: float) -> None:
    found = margins(slope, payload_kg=payload).downhill
    assert found == pytest.approx(downhill_margin_by_plumb_line(slope, payload), abs=1e-12)


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


@given(slope=slopes, heading=headings)
def test_at_a_heading_the_plumb_line_is_the_worlds_vertical_in_the_chair_frame(slope: float, heading: float) -> None:
    up = (rotation_y(-slope) @ rotation_z(heading)).T @ np.array([0.0, 0.0, 1.0])
    com = centre_of_mass(CHAIR, Chair(), math.asin(up[0]))
    expected = tipping_margins(com, triple(up), worst_support(CHAIR, pitch_of(slope)))
    found = margins(slope, heading)
    for side in ("uphill", "downhill", "left", "right"):
        assert getattr(found, side) == pytest.approx(getattr(expected, side), abs=1e-12)


def test_square_on_a_stair_the_margin_aside_is_to_the_belts_outer_edges() -> None:
    slope = 28.0 * DEG
    height = centre_of_mass(CHAIR, Chair(), slope)[2]
    # Up the slope the vertical leans back: in the plane across the chair only its part along the chair's z counts.
    outer_edge = 0.5 * 0.65 + 0.5 * 0.10
    found = margins(slope)
    assert found.left == pytest.approx(math.atan2(outer_edge, height), abs=1e-12)
    assert found.right == pytest.approx(found.left, abs=1e-12)


@given(slope=slopes, heading=headings, payload=st.floats(0.0, 150.0), aside=st.floats(-0.3, 0.3))
def test_left_and_right_are_mirror_images(slope: float, heading: float, payload: float, aside: float) -> None:
    here = margins(slope, heading, payload_kg=payload, payload_offset_m=[0.0, aside, 0.0])
    mirrored = margins(slope, -heading, payload_kg=payload, payload_offset_m=[0.0, -aside, 0.0])
    assert here.left == pytest.approx(mirrored.right, abs=1e-12)
    assert here.right == pytest.approx(mirrored.left, abs=1e-12)
    assert here.uphill == pytest.approx(mirrored.uphill, abs=1e-12)
    assert here.downhill == pytest.approx(mirrored.downhill, abs=1e-12)


@given(pitch=st.floats(0.2, 0.45), share=st.floats(0.0, 1.0))
def test_the_support_lies_within_the_nosings_touched_at_every_phase(pitch: float, share: float) -> None:
    half, phase = 0.5 * CHAIR.tracks.flat_run_m, share * pitch
    touched = np.arange(-half + phase, half, pitch)
    support = worst_support(CHAIR, pitch)
    # Nowhere less, and (below) as little at the worst phase of either end.
    assert touched[0] <= -support.front_m + 1e-12
    assert touched[-1] >= support.front_m - 1e-12


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
