"""``[[flight]]`` tables: flights with steps of their own, and landings on which they turn by any angle."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from treadline.core.rotations import rotation_z
from treadline.plant.sensors.statistical_camera import StatisticalCamera
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario
from treadline.vehicle.stair_solids import Box, landing_walls, stair_boxes
from treadline.vehicle.staircase import Staircase, as_designed

WIDTH_M = 1.2


def build(*flights: dict[str, Any], **stair: Any) -> Staircase:
    tables = {"stair": {"width_m": WIDTH_M} | stair, "flight": list(flights)}
    return as_designed(Scenario.model_validate(tables).stair)


def holds(box: Box, p_W: np.ndarray) -> bool:
    return bool((np.abs(box.R_WK.T @ (p_W - np.array(box.centre_W))) <= np.array(box.half_m) + 1e-9).all())


def sides_of(box: Box) -> tuple[float, float]:
    return box.centre_W[1] - box.half_m[1], box.centre_W[1] + box.half_m[1]


@pytest.mark.parametrize("turn", ["none", "left", "right"])
def test_the_short_form_is_a_list_of_equal_flights(turn: str) -> None:
    short = {"steps": 6, "flights": 3, "between_m": 2.4, "turn": turn, "rise_m": 0.17, "width_m": 1.4, "end_wall": True}
    deg = {"none": 0.0, "left": 90.0, "right": -90.0}[turn]
    others = {"steps": 6, "turn_deg": deg, "landing_depth_m": 2.4}
    own = build({"steps": 6}, others, others, rise_m=0.17, width_m=1.4, end_wall=True)
    assert own == as_designed(Scenario.model_validate({"stair": short}).stair)


turns = st.floats(-180.0, 180.0).filter(lambda turn: turn == 0.0 or abs(turn) > 1.0)


@given(turn=turns, wider=st.floats(0.0, 1.0), deeper=st.floats(0.0, 1.0))
def test_a_landing_bears_to_the_foot_of_the_next_flight_and_nothing_stands_on_it(turn: float, wider: float, deeper: float) -> None:
    c, s = math.cos(math.radians(turn)), abs(math.sin(math.radians(turn)))
    landing = {"landing_depth_m": max(WIDTH_M * s, 0.6) + deeper, "landing_width_m": WIDTH_M * max(1.0, 1.0 - c) + wider}
    staircase = build({"steps": 4}, {"steps": 5, "turn_deg": turn} | landing, walls="none")
    R_WF, p_WF = staircase.flight_frame(1)
    first, level_m, boxes = staircase.flights[1][0], staircase.flights[0][-1].z_m, stair_boxes(staircase)
    for aside in (-0.59, 0.0, 0.59):
        # Before the foot there is the landing and nothing higher, behind it the next flight's first tread.
        before, behind = (p_WF + R_WF @ np.array([first.x_m + out, aside, 0.0]) for out in (-0.004, 0.004))
        before[2], behind[2] = level_m - 1e-6, level_m + 1e-6
        assert any(box.kind == "landing" and holds(box, before) for box in boxes)
        assert not any(holds(box, before + np.array([0.0, 0.0, 0.5])) for box in boxes)
        assert any(box.kind == "step" and holds(box, behind) for box in boxes)


@given(turn=st.floats(5.0, 180.0), sign=st.sampled_from([-1.0, 1.0]))
def test_walls_stand_all_around_a_landing_and_leave_both_flights_open(turn: float, sign: float) -> None:
    """Test: places 2 cm outside the landing's three sides. Expected result: a wall at each, but where the next flight leaves."""
    landing = {"landing_depth_m": 2.0, "landing_width_m": 2.8, "landing_walls": ["left", "right", "far"]}
    staircase = build({"steps": 4}, {"steps": 5, "turn_deg": sign * turn} | landing, walls="none")
    (box,) = [box for box in stair_boxes(staircase) if box.kind == "landing" and box.index == 3]
    (right, left), x_m, far_m = sides_of(box), staircase.steps[3].x_m, staircase.steps[3].x_m + 2.0
    R_WF, p_WF = staircase.flight_frame(1)
    level_m, walls = staircase.steps[3].z_m, landing_walls(staircase)
    places = [(x, y) for y in (right - 0.02, left + 0.02) for x in np.linspace(x_m + 0.01, far_m - 0.01, 80)]
    places += [(far_m + 0.02, y) for y in np.linspace(right + 0.01, left - 0.01, 80)]
    for x, y in places:
        in_F = R_WF.T @ (np.array([x, y, 0.0]) - p_WF)
        if abs(abs(in_F[1]) - 0.5 * WIDTH_M) < 0.03 or abs(in_F[0]) < 0.03:
            continue  # the corner of a wall
        leaves = in_F[0] > 0.0 and abs(in_F[1]) < 0.5 * WIDTH_M
        # A flight that cuts a corner is next to the wall that begins beyond the corner.
        assert leaves or any(holds(wall, np.array([x, y, level_m + 0.5])) for wall in walls)
        assert not leaves or in_F[0] > 0.3 or not any(holds(wall, np.array([x, y, level_m + 0.5])) for wall in walls)


@pytest.mark.parametrize("sign", [-1, 1])
def test_after_a_half_turn_the_next_flight_rises_beside_the_last(sign: int) -> None:
    staircase = build({"steps": 4}, {"steps": 3, "turn_deg": 180.0 * sign, "landing_depth_m": 1.6, "landing_width_m": 2.6})
    lower, upper = staircase.nosings_W[:4], staircase.nosings_W[4:]
    np.testing.assert_allclose(upper[0] - lower[-1], [0.0, sign * 1.4, 0.16], atol=1e-12)
    np.testing.assert_allclose(np.diff(upper, axis=0), [[-0.3, 0.0, 0.16]] * 2, atol=1e-12)


def test_flights_have_rises_and_runs_of_their_own() -> None:
    """Test: three flights in line, then one that turns. Expected result: each as given, the landing between them as deep."""
    sizes = [(0.15, 0.32), (0.18, 0.25), (0.16, 0.30), (0.17, 0.28)]
    flights = [{"steps": 3, "rise_m": rise, "run_m": run, "landing_depth_m": 1.7} for rise, run in sizes]
    flights[3]["turn_deg"] = 90.0
    staircase = build(*flights)
    assert [list(course) for course in staircase.courses] == [[0, 1, 2], [3]]
    for k, ((rise, run), steps) in enumerate(zip(sizes, staircase.flights, strict=True)):
        np.testing.assert_allclose([step.rise_m for step in steps], rise, atol=1e-12)
        np.testing.assert_allclose(np.diff([step.x_m for step in steps]), run, atol=1e-12)
        if 0 < k < 3:
            assert steps[0].x_m - staircase.flights[k - 1][-1].x_m == pytest.approx(1.7, abs=1e-12)
        R_WS, p_WS, along_m = staircase.stair_frame(k)
        start = staircase.courses[staircase.course_of(k)].start
        np.testing.assert_allclose(R_WS[:, 0] @ [0.0, 0.0, 1.0], math.sin(math.atan2(*sizes[start])), atol=1e-12)
        assert (p_WS[0], along_m) == (0.0, 0.0) or k == 3
    # At the corner of the middle lines the place along the stair is the same for both courses.
    corner = np.array([staircase.flights[2][-1].x_m + 1.7 - 0.6, 0.0, staircase.flights[2][-1].z_m])
    frames = [staircase.stair_frame(k) for k in (0, 3)]
    below, above = (along_m + R_WS[:, 0] @ (corner - p_WS) for R_WS, p_WS, along_m in frames)
    assert above - below == pytest.approx(0.6 * (math.cos(math.atan2(0.15, 0.32)) - math.cos(math.atan2(0.17, 0.28))), abs=1e-12)


def test_the_statistical_camera_sees_the_next_flight_once_the_chair_has_turned() -> None:
    staircase = build({"steps": 4}, {"steps": 8, "turn_deg": 180.0, "landing_depth_m": 1.6, "landing_width_m": 2.6, "rise_m": 0.18})
    camera = StatisticalCamera(staircase, read_chair("wheelchair").camera_at(240), np.random.default_rng(0), exact=True)
    middle = staircase.nosings_W[3] + np.array([1.0, 1.4, 0.0])
    found = camera.look(0.0, rotation_z(math.radians(175.0)), middle)
    assert [type(signal).__name__ for signal in found] == ["HeadingMeasurement", "StairMap"]
    assert math.degrees(found[0].heading_rad) == pytest.approx(-5.0, abs=0.3)
    assert found[1].rise_m == pytest.approx(0.18, abs=1e-9)
