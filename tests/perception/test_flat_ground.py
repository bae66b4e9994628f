"""Obstacles on flat ground beyond a stair, from depth and gravity alone."""

import math

import numpy as np
import pytest
from jaxtyping import Float
from surfaces import LEG_HALF_M, frame_of

from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.core.rotations import rotation_y, rotation_z
from treadline.perception.free_ground import ground_ahead
from treadline.plant.sensors.camera.solids import SceneBox, solids_of
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Stair
from treadline.vehicle.stair_solids import stair_boxes
from treadline.vehicle.staircase import Staircase, build_staircase

CHAIR = read_chair("wheelchair")
BOX_HALF_M = np.array([0.125, 0.3, 0.25])
SEES_M = 0.05
"""Accuracy of a box's distance: the bin of the cluster plus the noise of its depth [m]."""


def seen(
    scene: list[SceneBox],
    pitch_rad: float,
    p_WB: Float[np.ndarray, " 3"],
    *,
    rear: bool = False,
    seed: int = 0,
    yaw_rad: float = 0.0,
) -> tuple[RgbdFrame, Float[np.ndarray, " 3"]]:
    """Return a frame from a chair that stands at a pose, and down in C."""
    return frame_of(scene, CHAIR.camera_at(240, rear=rear), rotation_z(yaw_rad) @ rotation_y(-pitch_rad), p_WB, seed)


def flight() -> Staircase:
    return build_staircase(Stair(slope_deg=28.0, steps=8, landing_m=4.0), np.random.default_rng(1))


def thing(x_m: float, y_m: float, floor_m: float, half_m: Float[np.ndarray, " 3"] = BOX_HALF_M) -> SceneBox:
    centre = np.array([x_m, y_m, floor_m + half_m[2]])
    return SceneBox(kind="bag", centre_W=centre, half_m=half_m, R_WK=np.eye(3), colour=(150.0, 40.0, 38.0), texture="dark")


def at_the_crest(staircase: Staircase, before_m: float) -> tuple[float, Float[np.ndarray, " 3"]]:
    """Return pitch and place of a chair on the flight, its middle ``before_m`` of the last nosing."""
    last, slope = staircase.steps[-1], staircase.slope_rad
    return slope, np.array([last.x_m - before_m * math.cos(slope), 0.0, last.z_m - before_m * math.sin(slope)])


@pytest.mark.parametrize("before_m", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("beyond_m", [1.2, 1.6, 2.0])
def test_a_box_on_the_landing_is_reported_from_the_flight_by_its_distance(before_m: float, beyond_m: float) -> None:
    staircase = flight()
    pitch, p_WB = at_the_crest(staircase, before_m)
    last = staircase.steps[-1]
    box = thing(p_WB[0] + beyond_m + BOX_HALF_M[0], 0.1, last.z_m)
    for seed in range(3):
        reported = ground_ahead(*seen([*solids_of(stair_boxes(staircase)), box], pitch, p_WB, seed=seed)).obstacle_m
        assert reported == pytest.approx(beyond_m, abs=SEES_M)


@pytest.mark.parametrize("before_m", [-0.2, 0.0, 0.3, 0.5, 0.8])
@pytest.mark.parametrize("yaw_deg", [-10.0, 0.0, 10.0])
def test_an_empty_landing_is_empty(before_m: float, yaw_deg: float) -> None:
    staircase = flight()
    pitch, p_WB = at_the_crest(staircase, before_m)
    for seed in range(3):
        frame = seen(solids_of(stair_boxes(staircase)), pitch, p_WB, seed=seed, yaw_rad=yaw_deg * DEG)
        assert ground_ahead(*frame).obstacle_m is None


@pytest.mark.parametrize("far_m", [0.9, 1.2, 1.5])
def test_a_leg_on_the_floor_behind_a_descending_chair_is_reported_and_no_step(far_m: float) -> None:
    staircase = flight()
    slope, first = staircase.slope_rad, staircase.steps[0]
    p_WB = np.array([first.x_m + 0.45 * math.cos(slope), 0.0, first.z_m + 0.45 * math.sin(slope)])
    solids = solids_of(stair_boxes(staircase))
    for seed in range(3):
        assert ground_ahead(*seen(solids, slope, p_WB, rear=True, seed=seed)).obstacle_m is None
        leg = thing(p_WB[0] - far_m - LEG_HALF_M[0], -0.2, 0.0, LEG_HALF_M)
        reported = ground_ahead(*seen([*solids, leg], slope, p_WB, rear=True, seed=seed)).obstacle_m
        # Its top, 0.8 m up, leans towards a chair that comes down pitched.
        leans_m = far_m - (far_m * math.cos(slope) - (2.0 * LEG_HALF_M[2] - p_WB[2]) * math.sin(slope))
        assert far_m - leans_m - SEES_M < reported < far_m + SEES_M


@pytest.mark.parametrize("walls", ["none", "both"])
@pytest.mark.parametrize("down_m", [-0.6, 0.0, 0.6, 1.2])
def test_a_flight_that_falls_away_behind_is_no_obstacle(walls: str, down_m: float) -> None:
    staircase = build_staircase(Stair.model_validate({"slope_deg": 28.0, "steps": 8, "walls": walls}), np.random.default_rng(2))
    solids = solids_of(stair_boxes(staircase))
    slope, last = staircase.slope_rad, staircase.steps[-1]
    level = down_m < 0.0
    p_WB = np.array([last.x_m - down_m * (1.0 if level else math.cos(slope)), 0.0, last.z_m - max(down_m, 0.0) * math.sin(slope)])
    for seed in range(3):
        assert ground_ahead(*seen(solids, 0.0 if level else slope, p_WB, rear=True, seed=seed)).obstacle_m is None


@pytest.mark.parametrize(("y_m", "half_m"), [(0.9, BOX_HALF_M), (0.0, np.array([0.3, 0.3, 0.03]))])
def test_what_is_beside_the_way_or_low_is_no_obstacle(y_m: float, half_m: Float[np.ndarray, " 3"]) -> None:
    staircase = flight()
    pitch, p_WB = at_the_crest(staircase, 0.3)
    aside = thing(p_WB[0] + 1.5, y_m, staircase.steps[-1].z_m, half_m)
    assert ground_ahead(*seen([*solids_of(stair_boxes(staircase)), aside], pitch, p_WB)).obstacle_m is None


@pytest.mark.parametrize(("model", "half_m"), [("wheelchair", 0.40), ("rescue", 0.345)])
def test_what_a_chair_passes_by_a_hair_is_no_obstacle_and_what_it_would_touch_is(model: str, half_m: float) -> None:
    """Test: either vehicle; a leg on the landing 2 cm inside the swept width, 2 cm outside. Expected result: a distance; None."""
    chair = read_chair(model)
    assert chair.swept_half_m == pytest.approx(half_m, abs=1e-12)
    staircase = flight()
    pitch, p_WB = at_the_crest(staircase, 0.3)
    for aside_m, met in ((-0.02, True), (0.02, False)):
        leg = thing(p_WB[0] + 1.5, half_m + aside_m + LEG_HALF_M[1], staircase.steps[-1].z_m, LEG_HALF_M)
        frame, down_C = seen([*solids_of(stair_boxes(staircase)), leg], pitch, p_WB)
        assert (ground_ahead(frame, down_C, chair.swept_half_m).obstacle_m is not None) is met


def test_without_ground_nothing_is_reported() -> None:
    """Test: no depth at all; a wall before the camera and nothing else. Expected result: None."""
    staircase = flight()
    frame, down_C = seen(solids_of(stair_boxes(staircase)), *at_the_crest(staircase, 0.3))
    frame.depth_m[:] = np.nan
    assert ground_ahead(frame, down_C).obstacle_m is None
    frame.depth_m[:] = 1.0
    assert ground_ahead(frame, np.array([0.0, 1.0, 0.0])).obstacle_m is None
