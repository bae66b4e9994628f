"""Free ground, its end, and obstacles on it, from depth and gravity alone."""

import math
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float
from surfaces import LEG_HALF_M, frame_of, on_a_flight

from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.core.rotations import rotation_y, rotation_z
from treadline.core.signals import FreeGround
from treadline.perception.free_ground import ground_ahead
from treadline.plant.sensors.camera.solids import SceneBox, solids_of
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario, Stair
from treadline.vehicle.stair_solids import landing_sides, stair_boxes
from treadline.vehicle.staircase import Staircase, as_designed, build_staircase

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


def thing(x_m: float, y_m: float, floor_m: float, half_m: Float[np.ndarray, " 3"] = BOX_HALF_M) -> SceneBox:
    centre = np.array([x_m, y_m, floor_m + half_m[2]])
    return SceneBox(kind="bag", centre_W=centre, half_m=half_m, R_WK=np.eye(3), colour=(150.0, 40.0, 38.0), texture="dark")


def slab(x_m: tuple[float, float], z_m: float, y_m: tuple[float, float] = (-4.0, 4.0), *, deg: float = 0.0) -> SceneBox:
    """Return a floor between two places along the way, at a height; sloping from the first on, down if the slope is negative."""
    turn = rotation_y(-deg * DEG)
    half_m = np.array([0.5 * (x_m[1] - x_m[0]), 0.5 * (y_m[1] - y_m[0]), 0.1])
    start = np.array([x_m[0], 0.5 * (y_m[0] + y_m[1]), z_m])
    centre = start + turn @ np.array([half_m[0], 0.0, -half_m[2]])
    return SceneBox(kind="floor", centre_W=centre, half_m=half_m, R_WK=turn, colour=(90.0, 90.0, 90.0), texture="concrete")


GROUND = slab((-4.0, 8.0), 0.0)


def ground_of(scene: list[SceneBox], *, tilt_deg: float = 0.5, holes: float = 0.0, **pose: Any) -> FreeGround:
    """Return the free ground before a chair at the origin, with gravity off by an angle, and with missing pixels."""
    frame, down_C = seen(scene, pose.pop("pitch_rad", 0.0), np.zeros(3), **pose)
    frame.depth_m[np.random.default_rng(1).random(frame.depth_m.shape) < holes] = np.nan
    return ground_ahead(frame, rotation_y(tilt_deg * DEG) @ rotation_z(0.5 * tilt_deg * DEG) @ down_C).free


@pytest.mark.parametrize("edge_m", [1.0, 1.5, 2.0])
@pytest.mark.parametrize(
    ("yaw_deg", "drop_m", "rear"), [(-35.0, 0.10, False), (0.0, 0.16, True), (20.0, 1.0, True), (35.0, 1.0, False)]
)
def test_an_edge_is_reported_with_its_distance_and_direction(edge_m: float, yaw_deg: float, drop_m: float, rear: bool) -> None:
    """Test: a kerb, a riser, a dock, gravity 0.5° off, a fifth of the pixels missing. Expected result: its nearest point over the
    swept width within 5 cm and 2 %, inside 3 σ; its direction within 2°, where it crosses the whole width in view."""
    before_m = edge_m * math.cos(yaw_deg * DEG) + 0.4 * math.sin(abs(yaw_deg) * DEG)
    scene = [slab((-4.0, before_m), 0.0), slab((-8.0, 9.0), -drop_m)]
    turn = 180.0 if rear else 0.0
    ground = ground_of(scene, holes=0.2, rear=rear, yaw_rad=(yaw_deg + turn) * DEG)
    assert ground.view == ("rear" if rear else "front")
    assert ground.end_m == ground.seen_m == pytest.approx(edge_m, abs=0.05 + 0.02 * edge_m)
    assert abs(ground.end_m - edge_m) < 3.0 * ground.end_sigma_m
    if edge_m < 2.0:
        assert ground.direction_rad == pytest.approx(-yaw_deg * DEG, abs=2.0 * DEG)


@pytest.mark.parametrize(
    "scene",
    [
        [GROUND],
        [slab((-4.0, 1.2), 0.0), slab((1.2, 6.0), 0.0, deg=4.8)],
        [slab((-4.0, 1.2), 0.0), slab((1.2, 6.0), 0.0, deg=-4.8)],
        [slab((-4.0, 1.3), 0.0), slab((1.3, 6.0), -0.02)],
        [slab((-4.0, 1.3), 0.0), slab((1.5, 6.0), 0.0), slab((-4.0, 6.0), -1.0)],
        [GROUND, thing(1.4, 0.0, 0.0, np.array([0.05, 1.0, 0.02]))],
    ],
    ids=["floor", "ramp up", "ramp down", "lip of 2 cm", "gap of 20 cm", "threshold"],
)
@pytest.mark.parametrize("tilt_deg", [-0.5, 0.5])
def test_floors_ramps_thresholds_and_narrow_gaps_are_ground(scene: list[SceneBox], tilt_deg: float) -> None:
    ground = ground_of(scene, tilt_deg=tilt_deg, holes=0.2)
    assert (ground.end_m, ground.seen_m) == (None, 2.0)
    assert ground.blind_m == pytest.approx(0.82, abs=0.02)  # 22.5° below the axis, which is 40° down, from 0.8 m above


def test_ground_without_depth_or_behind_an_object_is_neither_seen_nor_an_end() -> None:
    """Test: no depth above 38.5° below the horizon, as on a black floor; a box across the way. Expected: seen up to there."""
    frame, down_C = seen([GROUND], 0.0, np.zeros(3))
    frame.depth_m[:112] = np.nan
    black = ground_ahead(frame, down_C).free
    boxed = ground_of([GROUND, thing(1.5, 0.0, 0.0, np.array([0.2, 1.0, 0.3]))])
    assert black.end_m is boxed.end_m is None
    assert black.seen_m == pytest.approx(0.4 + 0.8 / math.tan(38.5 * DEG), abs=0.03)
    assert 1.2 < boxed.seen_m < 1.75


@pytest.mark.parametrize(("edge_m", "drop_m"), [(1.0, 0.055), (1.5, 0.06), (2.0, 0.07)])
def test_a_low_kerb_is_no_ramp_although_the_road_behind_it_goes_on(edge_m: float, drop_m: float) -> None:
    assert ground_of([slab((-4.0, edge_m), 0.0), slab((-4.0, 8.0), -drop_m)]).end_m == pytest.approx(edge_m, abs=0.05)


@pytest.mark.parametrize("edge_m", [0.3, 0.45, 0.6, 0.75])
def test_a_chair_over_an_edge_below_the_image_does_not_take_the_lower_ground_for_its_own(edge_m: float) -> None:
    """Test: the front pulley, at 0.475 m, over the edge of a flight or before it. Expected result: nothing is seen."""
    for drop_m in (0.16, 1.0):
        ground = ground_of([slab((-4.0, edge_m), 0.0), slab((-4.0, 8.0), -drop_m)])
        assert (ground.end_m, ground.seen_m) == (None, ground.blind_m)


def test_steps_that_rise_bear_and_only_part_of_a_wide_edge_has_no_direction() -> None:
    """Test: the foot of a flight; a corner whose left half falls away. Expected result: no end; the corner's distance alone."""
    staircase = flight()
    first = staircase.steps[0]
    frame, down_C = seen(solids_of(stair_boxes(staircase)), 0.0, np.array([first.x_m - 1.0, 0.0, 0.0]))
    assert (ground_ahead(frame, down_C).free.end_m, ground_ahead(frame, down_C).free.seen_m > 1.5) == (None, True)
    corner = ground_of([slab((-4.0, 8.0), 0.0, (-4.0, 0.0)), slab((-4.0, 1.4), 0.0), slab((-4.0, 8.0), -1.0)])
    assert (corner.end_m, corner.direction_rad) == (pytest.approx(1.4, abs=0.05), None)


def flight() -> Staircase:
    return build_staircase(Stair(slope_deg=28.0, steps=8, landing_m=4.0), np.random.default_rng(1))


def at_the_crest(staircase: Staircase, before_m: float) -> tuple[float, Float[np.ndarray, " 3"]]:
    """Return pitch and place of a chair on the flight, its middle ``before_m`` of the last nosing."""
    last, slope = staircase.steps[-1], staircase.slope_rad
    return slope, np.array([last.x_m - before_m * math.cos(slope), 0.0, last.z_m - before_m * math.sin(slope)])


@pytest.mark.parametrize("slope_deg", [25.0, 28.0])
def test_treads_above_open_risers_end_no_ground_before_the_flight(slope_deg: float) -> None:
    """Test: a chair that mounts, its rear on the floor, its front pulley on the first nosing; rays pass the gaps to the floor.
    Expected result: no end before that nosing, 0.5 m ahead, and none at all once the chair is pitched as on no ramp."""
    staircase = build_staircase(Stair(slope_deg=slope_deg, steps=12, open_risers=True), np.random.default_rng(1))
    for pitch_deg in (0.0, 3.0, 5.0, 6.5, 8.0, 12.0, 16.0, 20.0):
        pitch = pitch_deg * DEG
        p_WB = np.array([staircase.steps[0].x_m - 0.5 * math.cos(pitch), 0.0, 0.475 * math.sin(pitch)])
        end_m = ground_ahead(*seen([*solids_of(stair_boxes(staircase)), GROUND], pitch, p_WB)).free.end_m
        assert end_m is None or (pitch_deg < 7.0 and end_m > 0.5)


@pytest.mark.parametrize("lip_m", [0.06, 0.08, 0.12])
def test_a_drop_behind_a_low_lip_is_an_end(lip_m: float) -> None:
    lip = thing(1.5, 0.0, 0.0, np.array([0.05, 1.0, 0.5 * lip_m]))
    ground = ground_of([slab((-4.0, 1.6), 0.0), slab((-4.0, 8.0), -1.0), lip])
    assert ground.end_m == pytest.approx(1.5, abs=0.15)


@pytest.mark.parametrize("before_m", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("beyond_m", [1.2, 1.6, 2.0])
def test_a_box_on_the_landing_is_reported_from_the_flight_by_its_distance(before_m: float, beyond_m: float) -> None:
    staircase = flight()
    pitch, p_WB = at_the_crest(staircase, before_m)
    last = staircase.steps[-1]
    box = thing(p_WB[0] + beyond_m + BOX_HALF_M[0], 0.1, last.z_m)
    for seed in range(2):
        reported = ground_ahead(*seen([*solids_of(stair_boxes(staircase)), box], pitch, p_WB, seed=seed)).obstacle_m
        assert reported == pytest.approx(beyond_m, abs=SEES_M)


@pytest.mark.parametrize("before_m", [-0.2, 0.0, 0.3, 0.5, 0.8])
@pytest.mark.parametrize("yaw_deg", [-10.0, 0.0, 10.0])
def test_an_empty_landing_is_empty(before_m: float, yaw_deg: float) -> None:
    staircase = flight()
    pitch, p_WB = at_the_crest(staircase, before_m)
    for seed in range(2):
        frame = seen(solids_of(stair_boxes(staircase)), pitch, p_WB, seed=seed, yaw_rad=yaw_deg * DEG)
        assert ground_ahead(*frame).obstacle_m is None


@pytest.mark.parametrize("far_m", [0.9, 1.2, 1.5])
def test_a_leg_on_the_floor_behind_a_descending_chair_is_reported_and_no_step(far_m: float) -> None:
    staircase = flight()
    slope, first = staircase.slope_rad, staircase.steps[0]
    p_WB = np.array([first.x_m + 0.45 * math.cos(slope), 0.0, first.z_m + 0.45 * math.sin(slope)])
    solids = solids_of(stair_boxes(staircase))
    for seed in range(2):
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
    for seed in range(2):
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


@pytest.mark.parametrize("kind", ["kinect1", "d435", "tof"])
def test_on_a_flight_the_next_step_is_no_obstacle_on_a_tread(kind: str) -> None:
    """Test: the middle of a long flight, with and without noise that hides the further treads. Expected result: no obstacle."""
    assert [ground_ahead(*on_a_flight(seed, 0.0, kind=kind)).obstacle_m for seed in range(4)] == [None] * 4


def test_without_ground_nothing_is_reported() -> None:
    """Test: no depth at all; a wall before the camera and nothing else. Expected result: None."""
    staircase = flight()
    frame, down_C = seen(solids_of(stair_boxes(staircase)), *at_the_crest(staircase, 0.3))
    frame.depth_m[:] = np.nan
    assert ground_ahead(frame, down_C).obstacle_m is None
    frame.depth_m[:] = 1.0
    assert ground_ahead(frame, np.array([0.0, 1.0, 0.0])).obstacle_m is None


@pytest.mark.parametrize("rear", [False, True])
def test_the_sides_of_a_landing_are_reported_where_they_are(*, rear: bool) -> None:
    """Test: a chair at 12 poses on landings of 1.7 to 2.3 m with walls and drops, noise of a Kinect. Expected result: the ends of
    what is reported lie within 3 cm of the line of an edge, a wall or a riser; some side in view in two thirds of the frames."""
    rng, shown = np.random.default_rng(60), 0
    for seed in range(12):
        size_m, walls = rng.uniform(1.7, 2.3), [side for side in ("far", "left", "right") if rng.random() < 0.5]
        landing = {"steps": 4, "turn_deg": 90.0, "landing_depth_m": size_m, "landing_width_m": size_m, "landing_walls": walls}
        staircase = as_designed(Scenario.model_validate({"stair": {"width_m": 1.3}, "flight": [{"steps": 4}, landing]}).stair)
        top, yaw_rad = staircase.flights[0][-1], rng.uniform(-20.0, 110.0) * DEG + math.pi * rear
        p_WB = np.array([top.x_m + rng.uniform(0.6, size_m - 0.6), rng.uniform(-0.3, 0.3), top.z_m])
        ground = ground_ahead(*seen(solids_of(stair_boxes(staircase)), 0.0, p_WB, rear=rear, seed=seed, yaw_rad=yaw_rad)).free
        sides = p_WB[:2] + np.array(ground.sides_B).reshape(-1, 2, 3)[:, :, :2] @ rotation_z(yaw_rad)[:2, :2].T
        lines = [(ends[0, :2], (ends[1] - ends[0])[:2] / np.linalg.norm(ends[1] - ends[0])) for ends, _ in landing_sides(staircase)]
        for side in sides:
            assert min(np.abs((side - start) @ (-along[1], along[0])).max() for start, along in lines) < 0.03
        shown += len(sides) > 0
    assert shown >= 8
