"""Frames without a stair: rejected with a reason, and never a NaN."""

import dataclasses
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from jaxtyping import Float32
from surfaces import CAMERA, frame_of

from treadline.core.angles import DEG
from treadline.perception import DetectorConfig, StairDetection, StairDetector
from treadline.perception._stair_map import map_of
from treadline.plant.sensors.camera.solids import solids_of, upright
from treadline.scenario.scenario import Stair
from treadline.vehicle.stair_solids import stair_boxes
from treadline.vehicle.staircase import build_staircase

ROBUST = StairDetector(DetectorConfig(method="robust"))
PAPER = StairDetector(DetectorConfig(method="paper"))
STAIR = Stair(slope_deg=28.0)


def assert_refused(sight: StairDetection) -> None:
    assert not sight.accepted
    assert sight.reason
    assert sight.heading_rad is sight.sigma_rad is sight.edge_direction_C is None


def test_a_camera_that_looks_along_gravity_yields_no_heading(view) -> None:
    frame, _ = view(4, 0.1, STAIR)
    assert_refused(ROBUST.look(frame, np.array([0.0, 0.0, 1.0])))


def test_without_gravity_and_treads_the_reason_says_so(view) -> None:
    frame, _ = view(5, 0.1, STAIR)
    disparity_px_m = 575.0 * 0.075
    disparity = disparity_px_m / 1.5 + 0.05 * np.random.default_rng(5).standard_normal(frame.depth_m.shape)
    wall = replace(frame, depth_m=(disparity_px_m / (np.round(8.0 * disparity) / 8.0)).astype(np.float32))
    assert "gravity" in (ROBUST.look(wall, None).reason or "")


def corrupted(depth_m: Float32[np.ndarray, "h w"], rng: np.random.Generator) -> Float32[np.ndarray, "h w"]:
    """Return depth with holes, nonsense values, a band gone, or all of it scaled."""
    worse = depth_m.copy()
    worse[rng.random(depth_m.shape) < rng.uniform(0.0, 0.9)] = rng.choice([np.nan, 0.0, np.inf, -np.inf, -2.0, 1e30])
    top = int(rng.integers(depth_m.shape[0]))
    worse[top : top + int(rng.integers(120))] = rng.choice([np.nan, 1.0, 2.0])
    return (worse * np.float32(rng.choice([1.0, 1.0, 0.5, 2.0]))).astype(np.float32)


def numbers(sight: StairDetection) -> list[float]:
    shape = [] if sight.shape is None else [x for x in dataclasses.astuple(sight.shape) if isinstance(x, float)]
    edge = [] if sight.edge_direction_C is None else sight.edge_direction_C.tolist()
    return [value for value in (sight.heading_rad, sight.sigma_rad, *shape, *edge) if value is not None]


@pytest.mark.parametrize("detector", [ROBUST, PAPER], ids=["robust", "paper"])
def test_no_output_is_ever_not_a_number(view, detector: StairDetector) -> None:
    rng = np.random.default_rng(6)
    for seed in range(16):
        frame, down = view(seed, float(rng.uniform(-0.6, 0.6)), STAIR)
        worse = replace(frame, depth_m=corrupted(frame.depth_m, rng))
        for gravity in (down, None):
            sight = detector.look(worse, gravity)
            assert np.isfinite(numbers(sight)).all()
            assert sight.accepted == (sight.reason is None)
            has_heading = sight.accepted or sight.unconfirmed
            assert has_heading == (sight.heading_rad is not None) == (sight.sigma_rad is not None)
            assert sight.sigma_rad is None or sight.sigma_rad > 0.0


def test_a_mission_sees_heading_and_map_at_once_and_makes_the_map_only_when_asked(view, monkeypatch: pytest.MonkeyPatch) -> None:
    made = Mock(wraps=map_of)
    monkeypatch.setattr("treadline.perception._robust_method.map_of", made)
    frame, down = view(7, 0.1, STAIR)
    seen = ROBUST.see(frame, down)
    assert seen.measurement == ROBUST.step(frame, down)
    assert (seen.measurement.t_s, seen.measurement.heading_rad) == (frame.t_s, ROBUST.look(frame, down).heading_rad)
    assert not made.called
    assert ROBUST.see(frame, down).stair_map is not None
    assert made.called
    assert seen.stair_map is seen.stair_map is not None
    blind = replace(frame, depth_m=np.full_like(frame.depth_m, np.nan))
    empty = ROBUST.see(blind, down)
    assert empty.measurement is empty.stair_map is ROBUST.step(blind, down) is None
    other_size = ROBUST.see(replace(frame, rgb=frame.rgb[::2, ::2], depth_m=frame.depth_m[::2, ::2]), down)
    assert other_size.measurement is other_size.stair_map is None


def test_the_same_frame_gets_the_same_answer(view) -> None:
    frame, down = view(8, 0.1, STAIR)
    first = ROBUST.look(frame, down)
    ROBUST.look(view(9, -0.4, STAIR)[0], down)
    assert ROBUST.look(frame, down).heading_rad == first.heading_rad


@pytest.mark.parametrize("turn_deg", [8.0, 12.0, 20.0])
def test_winders_yield_no_heading(turn_deg: float) -> None:
    steps = build_staircase(Stair(slope_deg=30.0, steps=8, walls="none"), np.random.default_rng(0))
    for first_deg in (-20.0, -8.0, 0.0):
        turned = tuple(replace(step, yaw_rad=(first_deg + turn_deg * step.index) * DEG) for step in steps.steps)
        frame, down = frame_of(replace(steps, steps=turned), CAMERA, np.eye(3), np.array([-1.0, 0.0, 0.0]), 11)
        assert not ROBUST.look(frame, down).accepted


@pytest.mark.parametrize(("place_m", "alike"), [(1.2, False), (1.3, False), (1.6, True), (1.7, True), (1.8, True), (1.9, True)])
def test_a_flight_is_unconfirmed_where_its_image_is_that_of_a_doorstep_before_a_wall(place_m: float, alike: bool) -> None:
    stair = build_staircase(Stair(slope_deg=30.0, steps=10, walls="none"), np.random.default_rng(1))
    first, second = stair.steps[:2]
    half = 0.5 * stair.width_m
    doorstep = [solid for solid in solids_of(stair_boxes(stair)) if solid.kind == "floor" or solid.index == 0]
    door = upright("wall", (second.x_m, -half, 0.0), (second.x_m + 0.1, half, 2.2))
    p_WB = np.array([first.x_m - place_m, 0.0, 0.0])
    (of_flight, down), (of_doorstep, _) = (frame_of(scene, CAMERA, np.eye(3), p_WB, 2) for scene in (stair, (*doorstep, door)))
    # Alike to the last bit, noise and all: no rule can take the one and refuse the other. Nearer, the second tread shows.
    assert np.array_equal(of_flight.depth_m, of_doorstep.depth_m, equal_nan=True) == alike
    assert ROBUST.look(of_flight, down).accepted != alike
    assert not ROBUST.look(of_doorstep, down).accepted
    assert StairDetector().see(of_doorstep, down).measurement is None
