"""Statistical camera: exact reports match the stair, and errors match those on rendered frames."""

import math

import numpy as np
import pytest
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.rotations import rotation_z
from treadline.core.signals import HeadingMeasurement, StairMap
from treadline.perception import StairDetection, StairDetector
from treadline.plant.sensors.camera import Camera
from treadline.plant.sensors.statistical_camera import StatisticalCamera, fitted_numbers
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Stair
from treadline.vehicle.staircase import Staircase, build_staircase
from treadline.vehicle.visibility import Geometry

Pose = tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]
SEEN_M = 0.08
"""Tolerance of how far nosings are in view [m]: 0.06 at most in these poses, where points tested are 21 mm apart."""
DOWN_W = np.array([0.0, 0.0, -1.0])


def stair(**values: object) -> Staircase:
    return build_staircase(Stair.model_validate({"walls": "both"} | values), np.random.default_rng(1))


def on_the_flight(staircase: Staircase, along_m: float, heading_deg: float = 0.0, lateral_m: float = 0.0) -> Pose:
    R_WS = staircase.R_WS
    return R_WS @ rotation_z(heading_deg * DEG), staircase.p_WS + R_WS @ np.array([along_m, lateral_m, 0.0])


def on_the_level(x_m: float, z_m: float = 0.0, heading_deg: float = 0.0) -> Pose:
    return rotation_z(heading_deg * DEG), np.array([x_m, 0.0, z_m])


def poses(staircase: Staircase) -> dict[str, Pose]:
    last = staircase.steps[-1]
    return {
        "foot": on_the_level(-0.8, heading_deg=10.0),
        "flight": on_the_flight(staircase, 2.0, heading_deg=-12.0, lateral_m=0.1),
        "near the top": on_the_flight(staircase, 5.0, heading_deg=4.0),
        "above the foot": on_the_flight(staircase, 1.5, heading_deg=-3.0),
        "landing": on_the_level(last.x_m + 0.8, last.z_m, heading_deg=8.0),
    }


def camera(staircase: Staircase, *, rear: bool = False, seed: int = 5, exact: bool = False) -> StatisticalCamera:
    calibration = read_chair("wheelchair").camera_at(240, rear=rear)
    return StatisticalCamera(staircase, calibration, np.random.default_rng(seed), exact=exact)


def report(eye: StatisticalCamera, pose: Pose) -> tuple[HeadingMeasurement, StairMap]:
    return eye.look(1.5, *pose)


def rendered(staircase: Staircase, pose: Pose, *, rear: bool) -> StairDetection:
    calibration = read_chair("wheelchair").camera_at(240, rear=rear)
    R_WB, p_WB = pose
    R_WC = R_WB @ calibration.R_BC
    frame = Camera(staircase, calibration, rng=np.random.default_rng(2)).frame(
        1.5, R_WC, p_WB + R_WB @ np.array(calibration.mount_m)
    )
    return StairDetector().look(frame, R_WC.T @ DOWN_W)


@pytest.mark.parametrize(
    ("where", "rear"),
    [("foot", False), ("flight", False), ("near the top", False), ("flight", True), ("above the foot", True), ("landing", True)],
)
def test_exact_is_where_a_rendered_frame_sees_it(where: str, *, rear: bool) -> None:
    staircase = stair()
    pose = poses(staircase)[where]
    sight = rendered(staircase, pose, rear=rear)
    heading, stair_map = report(camera(staircase, rear=rear, exact=True), pose)
    assert heading.heading_rad == pytest.approx(sight.heading_rad, abs=0.5 * DEG)
    assert stair_map.direction == sight.stair_map.direction
    assert stair_map.ends == sight.stair_map.ends
    # The three nearest, used by a plan: farther nosings may be reported by one camera only.
    near = np.abs(np.array(stair_map.nosings_B)[:3, 0])
    apart = np.abs(near[:, None] - np.abs(np.array(sight.stair_map.nosings_B)[:, 0]))
    np.testing.assert_array_less(apart.min(axis=1), 0.010)
    for name in ("left_seen_m", "right_seen_m"):
        assert getattr(stair_map, name) == pytest.approx(getattr(sight.stair_map, name), abs=SEEN_M)


@pytest.mark.parametrize("rear", [False, True])
def test_a_mirrored_chair_sees_the_mirrored_stair(*, rear: bool) -> None:
    staircase = stair(walls="left")
    geometry, mirrored = (
        Geometry(s, read_chair("wheelchair").camera_at(240, rear=rear)) for s in (staircase, stair(walls="right"))
    )
    left = geometry.visibility(*on_the_flight(staircase, 2.0, heading_deg=9.0, lateral_m=0.1))
    right = mirrored.visibility(*on_the_flight(staircase, 2.0, heading_deg=-9.0, lateral_m=-0.1))
    assert left.heading_rad == pytest.approx(-right.heading_rad)
    np.testing.assert_allclose(left.nosings_B, right.nosings_B, atol=1e-12)
    np.testing.assert_allclose(left.margins_px, right.margins_px, atol=1e-9)
    assert left.sides[0].kind == right.sides[1].kind == "wall"
    assert left.sides[0].end_m == pytest.approx(right.sides[1].end_m)
    assert left.sides[1].kind == "open"


@pytest.mark.parametrize("exact", [True, False])
def test_with_fewer_than_two_nosings_in_view_nothing_is_reported(*, exact: bool) -> None:
    staircase = stair()
    last = staircase.steps[-1]
    for pose in (on_the_level(-4.0), on_the_level(last.x_m + 0.5, last.z_m), on_the_level(-1.0, heading_deg=60.0)):
        assert camera(staircase, exact=exact).look(0.0, *pose) == ()


def test_the_edge_of_the_landing_hides_what_is_below() -> None:
    staircase = stair()
    geometry, last = Geometry(staircase, read_chair("wheelchair").camera_at(240, rear=True)), staircase.steps[-1]
    # The eye 0.8 m above the landing and 2 m behind its edge looks down at 22°, the flight falls at 28°.
    seen = geometry.visibility(*on_the_level(last.x_m + 2.5, last.z_m))
    assert seen is None or seen.seen.sum() <= 1


def test_a_missing_step_ends_the_row() -> None:
    staircase = stair(missing_steps=(8,))
    _, stair_map = report(camera(staircase, exact=True), on_the_flight(staircase, 1.0))
    whole = report(camera(stair(), exact=True), on_the_flight(staircase, 1.0))[1]
    assert 2 <= len(stair_map.nosings_B) < len(whole.nosings_B)


def test_steps_too_long_for_the_detector_are_too_long_for_the_model() -> None:
    staircase = stair(rise_m=0.17, run_m=0.53)
    assert camera(staircase).look(0.0, *on_the_flight(staircase, 1.5)) == ()


def test_no_nosing_is_reported_beyond_the_sensors_range() -> None:
    staircase = stair()
    for along in np.arange(0.5, 5.0, 0.3):
        answer = camera(staircase, exact=True).look(0.0, *on_the_flight(staircase, float(along)))
        assert all(abs(np.array(part.nosings_B)[-1, 0]) < 4.0 + 0.5 for part in answer if isinstance(part, StairMap))


def test_errors_are_correlated_within_a_run_and_independent_between_runs() -> None:
    staircase = stair()
    near, apart = [], []
    for seed in range(120):
        eye = camera(staircase, seed=seed)
        errors = [report(eye, on_the_flight(staircase, along))[0].heading_rad for along in (1.5, 1.5, 3.5)]
        near.append((errors[0], errors[1]))
        apart.append((errors[0], errors[2]))
    assert np.corrcoef(np.array(near).T)[0, 1] > 0.4
    assert np.corrcoef(np.array(apart).T)[0, 1] < 0.6


def test_errors_are_no_smaller_than_on_frames_outside_the_fit() -> None:
    errors: dict[str, list[float]] = {"frames": [], "model": []}
    for seed in range(8):
        rng = np.random.default_rng(90_000 + seed)
        staircase = stair(rise_jitter_m=0.002, nosing_yaw_jitter_deg=0.15, rise_m=float(rng.uniform(0.14, 0.18)), walls="none")
        eye = camera(staircase, seed=seed)
        for along in rng.uniform(0.3, 3.0, 5):
            pose = on_the_flight(staircase, float(along), heading_deg=float(rng.uniform(-15.0, 15.0)))
            truth = math.atan2(pose[0][1, 0], pose[0][1, 1])
            sight = rendered(staircase, pose, rear=False)
            errors["frames"].append(abs(sight.heading_rad - truth))
            errors["model"].append(abs(report(eye, pose)[0].heading_rad - truth))
    # These stairs are truer and this depth is not warped: the model, fitted on worse, errs more.
    for share in (0.5, 0.95):
        assert np.quantile(errors["model"], share) > 0.85 * np.quantile(errors["frames"], share)


@pytest.mark.parametrize("sensor", ["kinect1", "kinect2", "d435", "d455", "tof"])
@pytest.mark.parametrize("stair", ["up closed", "up open", "down closed", "down open"])
def test_every_kind_of_stair_is_accepted_where_two_nosings_are_well_in_the_image(sensor: str, stair: str) -> None:
    """Test: the second best nosing 50 px inside the image. Expected result: half of the frames at least, also of a kind of stair of
    which no drive of the fit had a frame; of rendered frames 27 of 28 or more were accepted."""
    rows = fitted_numbers()[sensor]["tables"][stair]["accept"]["score"]
    assert min(row[-1] for row in rows) > 0.0
