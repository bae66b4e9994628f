"""Robust detector against simulator ground truth."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.arrays import rms
from treadline.core.errors import ImageError, ShapeMismatch
from treadline.perception import DetectorConfig, StairDetection, StairDetector
from treadline.scenario.scenario import Stair

TEXTURES = ("wood", "concrete", "carpet", "terrazzo", "dark")
ROBUST = StairDetector(DetectorConfig(method="robust"))
STAIR = Stair(slope_deg=28.0, run_m=0.3)


def stair_of(seed: int, **others: object) -> Stair:
    """Return one of the stairs that the method is judged on."""
    rng = np.random.default_rng(seed + 50_000)
    tables = {
        "slope_deg": float(rng.uniform(25.0, 30.0)),
        "texture": TEXTURES[seed % 5],
        "light": float(rng.uniform(0.5, 1.6)),
        "walls": ("left", "none", "both")[seed % 3],
    }
    return Stair.model_validate(tables | others)


def heading_of(seed: int) -> float:
    return float(np.random.default_rng(seed + 60_000).uniform(-35.0, 35.0)) * DEG


def tilted(down: Float[np.ndarray, " 3"], angle_rad: float, seed: int) -> Float[np.ndarray, " 3"]:
    """Return a direction that is off by an angle, to a side drawn from the seed."""
    side = np.cross(down, np.random.default_rng(seed + 70_000).standard_normal(3))
    return np.cos(angle_rad) * down + np.sin(angle_rad) * side / np.linalg.norm(side)


@pytest.mark.parametrize("open_risers", [False, True])
def test_without_gravity_the_heading_error_stays_below_a_tenth_of_a_degree(view, open_risers: bool) -> None:
    errors = []
    for seed in range(4100, 4120):
        frame, _ = view(seed, heading_of(seed), stair_of(seed, open_risers=open_risers))
        sight = ROBUST.look(frame, None)
        if sight.heading_rad is not None:
            errors.append(sight.heading_rad - heading_of(seed))
    # 95 % of the frames, all of which show more than 15 % stair; measured are 0.02 to 0.04°, the design asks for 0.2°.
    assert len(errors) >= 0.95 * 20
    assert rms(np.array(errors)) < 0.1 * DEG
    assert max(abs(error) for error in errors) < 0.5 * DEG


def test_a_stair_that_is_less_regular_is_declared_less_sure(view) -> None:
    def sigma(jitter_deg: float) -> float:
        sights = [ROBUST.look(*view(seed, 0.1, stair_of(seed, nosing_yaw_jitter_deg=jitter_deg))) for seed in range(4400, 4410)]
        return float(np.mean([sight.sigma_rad for sight in sights]))

    assert sigma(0.0) < 0.7 * sigma(0.3) < 0.7**2 * sigma(1.0)


def test_half_a_degree_of_gravity_error_moves_the_heading_by_less_than_a_fifth_and_its_length_does_not(view) -> None:
    for seed in range(4210, 4215):
        frame, down = view(seed, heading_of(seed), stair_of(seed))
        true, off = ROBUST.look(frame, down).heading_rad, ROBUST.look(frame, tilted(down, 0.5 * DEG, seed)).heading_rad
        assert off == pytest.approx(true, abs=0.2 * DEG)
    assert ROBUST.look(frame, 9.81 * down).heading_rad == pytest.approx(true, abs=1e-9)


def test_gravity_so_wrong_that_no_tread_is_level_is_refused(view) -> None:
    reasons = []
    for seed in range(4210, 4214):
        frame, down = view(seed, heading_of(seed), stair_of(seed))
        for angle in (20.0 * DEG, 23.0 * DEG):
            sight = ROBUST.look(frame, tilted(down, angle, seed))
            # What risers alone say under such a gravity is ten degrees off.
            assert sight.heading_rad is None or sight.heading_rad == pytest.approx(heading_of(seed), abs=1.0 * DEG)
            reasons.append(sight.reason or "")
    assert any("gravity is wrong" in reason and "° off the IMU's" in reason for reason in reasons)


def test_the_yaw_of_the_mount_passes_one_to_one(view) -> None:
    frame, down = view(4203, 0.0, STAIR)
    plain = ROBUST.look(frame, down).heading_rad
    turned = ROBUST.look(replace(frame, camera=replace(frame.camera, mount_yaw_rad=0.1)), down).heading_rad
    # Exact: the same edge expressed in axes turned by the mount's yaw.
    assert turned - plain == pytest.approx(-0.1, abs=1e-9)


def test_a_missing_step_does_not_bend_the_heading(view) -> None:
    for seed in range(4240, 4245):
        frame, down = view(seed, heading_of(seed), stair_of(seed, missing_steps=(4, 8)))
        sight = ROBUST.look(frame, down)
        if sight.heading_rad is not None:
            assert sight.heading_rad == pytest.approx(heading_of(seed), abs=0.5 * DEG)


def test_steep_headings_are_refused_or_right(view) -> None:
    for seed in range(4260, 4270):
        heading = (1.0 if seed % 2 else -1.0) * float(np.random.default_rng(seed).uniform(36.0, 80.0)) * DEG
        sight: StairDetection = ROBUST.look(*view(seed, heading, stair_of(seed)))
        if sight.heading_rad is None:
            assert sight.reason
        else:
            assert sight.heading_rad == pytest.approx(heading, abs=1.0 * DEG)


@pytest.mark.usefixtures("without_shape_checks")
def test_gravity_may_be_a_list_and_must_be_three_numbers(view) -> None:
    frame, down = view(4202, 0.2, STAIR)
    assert ROBUST.look(frame, down.tolist()).heading_rad == ROBUST.look(frame, down).heading_rad
    for look in (ROBUST.step, ROBUST.look):
        with pytest.raises(ShapeMismatch, match=r"gravity_C is of shape \(4,\); wanted three numbers x, y, z"):
            look(frame, np.append(down, 0.0))


@pytest.mark.parametrize(
    ("gravity_C", "message"), [([0.0] * 3, "(0, 0, 0)"), ([0.0, np.nan, 1.0], "(0, nan, 1)"), ([np.inf, 0.0, 0.0], "(inf, 0, 0)")]
)
def test_gravity_without_a_direction_is_no_gravity(view, gravity_C: list[float], message: str) -> None:
    sight = ROBUST.look(view(4202, 0.2, STAIR)[0], np.array(gravity_C))
    assert (sight.accepted, sight.heading_rad, sight.reason) == (False, None, f"gravity is not a direction but {message}")


@pytest.mark.usefixtures("without_shape_checks")
def test_depth_must_be_an_image_of_the_cameras_size(view) -> None:
    frame, _ = view(4202, 0.2, STAIR)
    for depth_m, message in (
        (frame.depth_m[:, 1:], "depth is 319×240 pixels, its calibration is for 320×240"),
        (frame.depth_m[::2, ::2], "depth is 160×120 pixels, its calibration is for 320×240"),
        (frame.depth_m.ravel(), r"depth is no image but an array of shape \(76800,\); its calibration is for 320×240 pixels"),
        (frame.depth_m.tolist(), "depth is no image but a list; its calibration is for 320×240 pixels"),
    ):
        with pytest.raises(ImageError, match=message):
            ROBUST.look(replace(frame, depth_m=depth_m))
    with pytest.raises(ImageError, match="320×240"):
        StairDetector(DetectorConfig(method="paper")).look(replace(frame, depth_m=frame.depth_m[::2, ::2]))
