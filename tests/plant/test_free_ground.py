"""Ground ahead as the simulated camera measures it: ends by the stair's geometry, range by the camera's, noise by its own draws."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from treadline.core.rotations import rotation_z
from treadline.core.signals import FreeGround
from treadline.plant.sensors._free_ground import GroundAhead
from treadline.scenario.chair import Point, read_chair
from treadline.scenario.scenario import Scenario
from treadline.scenario.stair import Stair
from treadline.vehicle.staircase import as_designed

DEG = math.pi / 180.0
LAST_X_M, LAST_Z_M = 5 * 0.3, 6 * 0.16
"""Uppermost nosing of a flight of six steps of 160 by 300 mm."""


def seen(
    x_m: float, z_m: float, *, rear: bool = False, yaw_deg: float = 0.0, mount_m: Point | None = None, **stair: Any
) -> FreeGround:
    """Return the ground from mid-track at a place along the flight, on a landing 1.5 m deep."""
    staircase = as_designed(
        Stair.model_validate({"rise_m": 0.16, "run_m": 0.3, "steps": 6, "width_m": 1.4, "landing_m": 1.5} | stair)
    )
    chair = read_chair("wheelchair")
    camera = chair.camera_at(240, rear=rear)
    mounted = camera if mount_m is None else replace(camera, mount_m=mount_m)
    ground = GroundAhead(staircase, chair, mounted, np.random.default_rng(1), 1e-9)
    return ground.look(0.0, rotation_z(yaw_deg * DEG), np.array([x_m, 0.0, z_m]))


def test_the_floor_before_a_rising_flight_has_no_end_and_begins_below_the_image() -> None:
    """Test: on the floor. Expected: from the lower border of the image on, 40° + 22.7° below level from 0.80 m up, to 2 m."""
    for ground in (seen(-1.0, 0.0), seen(-2.5, 0.0, rear=True)):
        assert (ground.end_m, ground.direction_rad, ground.end_sigma_m) == (None, None, None)
        assert ground.seen_m == pytest.approx(2.0, abs=0.02)
    assert seen(-1.0, 0.0).blind_m == pytest.approx(0.40 + 0.80 / math.tan(62.7 * DEG), abs=0.02)


@pytest.mark.parametrize("yaw_deg", [0.0, 10.0, -15.0])
def test_a_landing_ends_at_its_rim_ahead_and_at_the_nosing_behind(yaw_deg: float) -> None:
    """Test: at an angle on a wide landing. Expected: the nearest point over the swept width, 0.4 m to each side; direction."""
    nearer_m = 0.4 * math.tan(abs(yaw_deg) * DEG)
    for x_m, straight_m, rear in ((0.3, 1.2, False), (1.3, 1.3, True)):
        ground = seen(LAST_X_M + x_m, LAST_Z_M, rear=rear, yaw_deg=yaw_deg, width_m=3.0)
        assert ground.end_m == ground.seen_m == pytest.approx(straight_m / math.cos(yaw_deg * DEG) - nearer_m, abs=0.012)
        assert ground.direction_rad == pytest.approx(-yaw_deg * DEG, abs=1.5 * DEG)


def test_an_edge_below_the_image_is_ground_not_seen() -> None:
    ground = seen(LAST_X_M + 0.7, LAST_Z_M, rear=True)
    assert (ground.end_m, ground.seen_m) == (None, ground.blind_m)


def test_a_pulley_beyond_the_edge_does_not_make_the_next_tread_the_level() -> None:
    """Test: a flight that falls by 0.3 m treads, the rear pulley 20 mm past its uppermost nosing. Expected: no ground is seen."""
    ground = seen(LAST_X_M + 0.455, LAST_Z_M, rear=True, mount_m=(-0.20, 0.0, 0.55))
    assert (ground.end_m, ground.seen_m) == (None, ground.blind_m)


@pytest.mark.parametrize("turn", ["left", "right"])
def test_a_quarter_landing_ends_ahead_of_the_first_flight(turn: str) -> None:
    """Test: the landing between turning flights, 2.4 m deep. Expected: its far rim, not a next flight straight on."""
    ground = seen(LAST_X_M + 0.9, LAST_Z_M, flights=2, turn=turn, between_m=2.4)
    assert ground.end_m == pytest.approx(1.5, abs=0.012)
    assert seen(LAST_X_M + 0.9, LAST_Z_M, flights=2, between_m=2.4).end_m is None


@pytest.mark.parametrize(("walls", "shown"), [(["far"], True), ([], False)])
def test_a_wall_whose_foot_is_below_the_image_is_a_side_in_view_and_an_edge_there_is_not(walls: list[str], shown: bool) -> None:
    """Test: on a quarter landing 2.2 m deep, 0.7 m before its far side; the image begins 0.8 m ahead."""
    turned = {"steps": 4, "turn_deg": 90.0, "landing_depth_m": 2.2, "landing_width_m": 2.2, "landing_walls": walls}
    staircase, chair = as_designed(Scenario.model_validate({"flight": [{"steps": 4}, turned]}).stair), read_chair("wheelchair")
    ground = GroundAhead(staircase, chair, chair.camera_at(240), np.random.default_rng(1), 1e-9)
    last = staircase.flights[0][-1]
    found = ground.look(0.0, np.eye(3), np.array([last.x_m + 1.5, 0.0, last.z_m])).sides_B
    off_m = [max(abs(x - 0.7), abs(to_x - 0.7)) for (x, *_), (to_x, *_) in zip(found[::2], found[1::2], strict=True)]
    assert (min(off_m, default=1.0) < 1e-6) == shown


def test_the_end_errs_by_its_deviation_and_each_frame_takes_as_many_draws() -> None:
    """Test: 400 frames before the rim. Expected: σ of 10 mm, and of the direction √2·10 mm over the width, within 12 %."""
    staircase, chair = as_designed(Stair(rise_m=0.16, run_m=0.3, steps=6, width_m=1.4, landing_m=1.5)), read_chair("wheelchair")
    ground = GroundAhead(staircase, chair, chair.camera_at(240), np.random.default_rng(3))
    place = np.array([LAST_X_M + 0.3, 0.0, LAST_Z_M])
    frames = [ground.look(0.1 * k, np.eye(3), place) for k in range(400)]
    ends, turns = np.array([(frame.end_m, frame.direction_rad) for frame in frames], dtype=float).T
    assert np.std(ends) == pytest.approx(0.010, rel=0.12)
    assert np.std(turns) == pytest.approx(math.sqrt(2.0) * 0.010 / 0.8, rel=0.12)
    assert {frame.end_sigma_m for frame in frames} == {0.010}
