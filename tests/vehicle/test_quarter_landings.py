"""Flights turning at their landings: positions of the solids, and the flight assigned to a chair."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from treadline.core.rotations import rotation_z
from treadline.core.signals import SeatCommand, TrackCommand
from treadline.plant.mujoco import open_plant
from treadline.run.resolve import checked as check
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario, Stair, Start
from treadline.vehicle.stair_solids import Box, stair_boxes
from treadline.vehicle.staircase import Staircase, as_designed
from treadline.vehicle.start_pose import standing

KEYS: dict[str, Any] = {"rise_m": 0.16, "run_m": 0.30, "steps": 6, "flights": 3, "between_m": 2.4, "width_m": 1.4, "landing_m": 3.0}


def build(turn: str, **keys: Any) -> Staircase:
    return as_designed(Stair.model_validate(KEYS | {"turn": turn} | keys))


def holds(box: Box, p_W: np.ndarray, spare_m: float = 1e-9) -> bool:
    return bool((np.abs(box.R_WK.T @ (p_W - np.array(box.centre_W))) <= np.array(box.half_m) + spare_m).all())


@pytest.mark.parametrize(("turn", "sign"), [("left", 1), ("right", -1)])
def test_each_flight_goes_a_quarter_further(turn: str, sign: int) -> None:
    staircase = build(turn)
    nosings = staircase.nosings_W.reshape(3, 6, 3)
    for k, course in enumerate(([1, 0], [0, sign], [-1, 0])):
        steps = np.diff(nosings[k], axis=0)
        np.testing.assert_allclose(steps, [[0.3 * course[0], 0.3 * course[1], 0.16]] * 5, atol=1e-12)
    # Each next flight begins one rise above the landing, in the middle of a width flush with its far end, at its side.
    first = nosings[1, 0] - nosings[0, -1]
    np.testing.assert_allclose(first, [2.4 - 0.7, sign * 0.7, 0.16], atol=1e-12)


@pytest.mark.parametrize("turn", ["left", "right"])
def test_every_nosing_lies_on_the_front_edge_of_its_own_box(turn: str) -> None:
    staircase = build(turn)
    treads = {box.index: box for box in stair_boxes(staircase) if box.kind in ("step", "landing")}
    assert len(treads) == 18
    for index, nosing_W in enumerate(staircase.nosings_W):
        box = treads[index]
        in_box = box.R_WK.T @ (nosing_W - np.array(box.centre_W))
        np.testing.assert_allclose(in_box, [-box.half_m[0], 0.0, box.half_m[2]], atol=1e-12)


@pytest.mark.parametrize("turn", ["left", "right"])
def test_a_landing_reaches_to_the_next_flight_and_is_not_built_over(turn: str) -> None:
    staircase = build(turn, walls="both")
    boxes = stair_boxes(staircase)
    for landing, following in pairwise(range(3)):
        R_WF, p_WF = staircase.flight_frame(following)
        level_m = staircase.flights[landing][-1].z_m
        for aside in (-0.69, 0.0, 0.69):
            foot = p_WF + R_WF @ np.array([-0.001, aside, 0.0])
            foot[2] = level_m - 1e-6
            assert any(box.kind == "landing" and holds(box, foot) for box in boxes)
            # Nothing stands above the landing where the next flight is entered.
            above = foot + np.array([0.0, 0.0, 0.5])
            assert not any(holds(box, above) for box in boxes)


def test_places_along_the_stair_go_on_where_a_chair_turns() -> None:
    """Test: at the corner of the flights' middle lines, relative to either. Expected: the same place along, heading 90° apart."""
    staircase = build("left")
    corner = np.array([staircase.flights[0][-1].x_m + 2.4 - 0.7, 0.0, staircase.flights[0][-1].z_m])
    along = []
    for k in (0, 1):
        R_WS, p_WS, offset_m = staircase.stair_frame(k)
        along.append(offset_m + R_WS[:, 0] @ (corner - p_WS))
    assert along[0] == pytest.approx(along[1], abs=1e-12)
    straight = as_designed(Stair.model_validate(KEYS))
    assert staircase.last_nosing_m == pytest.approx(straight.last_nosing_m, abs=1e-12)


def test_a_chair_on_a_landing_is_on_the_flight_to_which_it_is_turned() -> None:
    staircase = build("left")
    level_m = staircase.flights[0][-1].z_m
    corner = np.array([staircase.flights[0][-1].x_m + 1.7, 0.0, level_m])
    found = [staircase.flight_at(corner, rotation_z(math.radians(yaw))) for yaw in (0, 40, 50, 90, 130)]
    assert found == [0, 0, 1, 1, 1]  # the third flight is a storey up
    assert staircase.flight_at(np.array([-1.0, 0.0, 0.0]), rotation_z(math.radians(80))) == 0


@pytest.mark.parametrize("turn", ["left", "right"])
def test_a_chair_backs_down_the_last_flight_as_down_a_straight_one(turn: str) -> None:
    """Test: from the upper landing, which lies a half turn round. Expected result: heading zero, and a metre down in 5 s."""
    tables = {
        "stair": KEYS | {"turn": turn},
        "start": {"place": "landing"},
        "drive": {"direction": "down"},
        "control": {"vision": "truth"},
    }
    scenario = Scenario.model_validate(tables)
    # The landing is as wide as the stair, too narrow to turn: check refuses, the plant does not.
    (reason,) = check(scenario, read_chair("wheelchair")).reasons
    assert reason.startswith("the landing at step 5 is 1.40 m, this chair needs 1.")
    assert reason.endswith(" m to turn by 90°; take another way")
    plant = open_plant(scenario, 0)
    plant.start()
    plant.write(TrackCommand(t_s=0.0, left_m_s=-0.2, right_m_s=-0.2), SeatCommand(t_s=0.0, rate_m_s=0.0))
    plant.advance(2.0)
    truth = plant.truth()
    assert abs(truth[0].heading_rad) < 1e-3
    assert abs(truth[-1].y_m) < 0.01
    cosine = math.cos(math.atan2(0.16, 0.30))
    assert truth[0].x_m - truth[-1].x_m == pytest.approx((2.0 - 0.15) * 0.2 * cosine, rel=0.03)
    # The camera that looks back sees the last flight's nosings, square to it.
    seen = [reading for reading in plant.read() if type(reading).__name__ == "HeadingMeasurement"]
    assert seen
    assert max(abs(reading.heading_rad) for reading in seen) < 0.01


def test_a_start_on_the_landing_is_relative_to_the_last_flight() -> None:
    staircase = build("left")
    tracks = read_chair("wheelchair").tracks
    put = standing(staircase, tracks, Start(place="landing", heading_deg=10.0))
    np.testing.assert_allclose(put.R_WB, rotation_z(math.radians(190.0)), atol=1e-12)
