"""The camera's exact depth against MuJoCo's rays, what of a stair it shows, and what worn steps are made of."""

from collections.abc import Sequence

import mujoco
import numpy as np
import pytest
from jaxtyping import Float
from scenes.clutter import worn_step

from treadline.core.angles import DEG
from treadline.core.rotations import quaternion_of, rotation_of, rotation_x, rotation_y, rotation_z
from treadline.plant.sensors.camera import Camera
from treadline.plant.sensors.camera.solids import SceneBox, beam, solids_of, upright
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Stair
from treadline.vehicle.stair_solids import stair_boxes
from treadline.vehicle.staircase import Staircase, build_staircase

CALIBRATION = read_chair("wheelchair").camera_at(240)
LEVEL = rotation_y(25.0 * DEG) @ CALIBRATION.R_BC
EYE = np.array([0.0, 0.0, 1.0])


def rays(solids: Sequence[SceneBox], R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "h w"]:
    """Return depth along the optical axis of each pixel by MuJoCo, NaN where nothing is hit."""
    geoms = "".join(
        f'<geom type="box" pos="{_words(box.centre_W)}" size="{_words(box.half_m)}" quat="{_words(quaternion_of(box.R_WK))}"/>'
        for box in solids
    )
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    u = (np.arange(CALIBRATION.width_px) - CALIBRATION.cx_px) / CALIBRATION.fx_px
    v = (np.arange(CALIBRATION.height_px) - CALIBRATION.cy_px) / CALIBRATION.fy_px
    across, down = np.meshgrid(u, v)
    seen = np.column_stack([across.ravel(), down.ravel(), np.ones(across.size)])
    length = np.linalg.norm(seen, axis=1)
    directions = (seen / length[:, None]) @ R_WC.T
    distance, hit = np.empty(len(seen)), np.empty(len(seen), dtype=np.int32)
    mujoco.mj_multiRay(model, data, p_WC, directions.ravel(), None, 1, -1, hit, distance, None, len(seen), 50.0)
    return np.where(hit >= 0, distance / length, np.nan).reshape(across.shape)


def _words(numbers: Float[np.ndarray, " n"]) -> str:
    return " ".join(repr(float(number)) for number in numbers)


Pose = tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]


def random_solid(rng: np.random.Generator) -> SceneBox:
    quaternion = rng.standard_normal(4)
    return SceneBox(
        kind="thing",
        centre_W=rng.uniform((0.8, -1.0, -0.5), (4.0, 1.0, 1.5)),
        half_m=rng.uniform(0.02, 0.5, size=3),
        R_WK=rotation_of(quaternion / np.linalg.norm(quaternion)),
    )


@pytest.mark.parametrize("seed", range(3))
def test_depth_of_boxes_turned_any_way_is_that_of_rays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    solids = [upright("floor", (-5.0, -5.0, -0.2), (8.0, 5.0, 0.0)), *(random_solid(rng) for _ in range(12))]
    R_WC = rotation_z(float(rng.uniform(-0.3, 0.3))) @ rotation_x(float(rng.uniform(-0.2, 0.2))) @ LEVEL
    seen = Camera(solids, CALIBRATION, rng=rng).exact(R_WC, EYE).depth_m
    truth = rays(solids, R_WC, EYE)
    near = truth < 6.0
    assert near.mean() > 0.3
    # Two thousandths are left for pixels whose centre falls on an edge: there are many edges.
    assert np.mean(np.abs(seen[near] - truth[near]) < 1e-4) >= 0.998
    assert np.mean(np.isnan(seen) == np.isnan(truth)) >= 0.998


def test_a_beam_reaches_from_one_point_to_the_other() -> None:
    start, end = np.array([0.3, -0.2, 0.9]), np.array([3.0, 0.4, 2.5])
    rail = beam("rail", start, end, (0.04, 0.06))
    ends = [rail.centre_W + sign * rail.R_WK[:, 0] * rail.half_m[0] for sign in (-1.0, 1.0)]
    np.testing.assert_allclose(ends, [start, end], atol=1e-12)
    np.testing.assert_allclose(rail.R_WK @ rail.R_WK.T, np.eye(3), atol=1e-12)
    # Its width lies level.
    assert rail.R_WK[2, 1] == pytest.approx(0.0, abs=1e-12)


def flight(*, open_risers: bool) -> Staircase:
    return build_staircase(Stair(slope_deg=28.0, open_risers=open_risers, nosing_yaw_jitter_deg=0.5), np.random.default_rng(0))


@pytest.mark.parametrize("open_risers", [False, True])
@pytest.mark.parametrize("worn_m", [0.005, 0.02])
def test_wear_takes_from_a_step_but_its_front_edge(open_risers: bool, worn_m: float) -> None:
    """Test: depth of a worn flight less that of a sharp one. Expected: never nearer, as before but close to the nosings."""
    sharp = solids_of(stair_boxes(flight(open_risers=open_risers)))
    steps = [solid for solid in sharp if solid.kind == "step"]
    rng = np.random.default_rng(1)
    worn = [part for solid in steps for part in worn_step(solid, open_risers, worn_m, rng)]
    pose = (rotation_y(10.0 * DEG) @ CALIBRATION.R_BC, np.array([-0.8, 0.1, 1.1]))
    before = Camera(steps, CALIBRATION, rng=np.random.default_rng(2)).exact(*pose).depth_m
    after = Camera(worn, CALIBRATION, rng=np.random.default_rng(2)).exact(*pose).depth_m
    both = np.isfinite(before) & np.isfinite(after)
    deeper = after[both] - before[both]
    assert both.mean() > 0.3
    assert deeper.min() > -1e-9
    assert 0.005 < np.mean(deeper > 1e-6) < 0.35
    assert np.mean(np.isfinite(after) & ~np.isfinite(before)) == 0.0


def test_a_worn_nosing_is_worn_unevenly() -> None:
    step = next(solid for solid in solids_of(stair_boxes(flight(open_risers=False))) if solid.kind == "step")
    parts = worn_step(step, open_risers=False, worn_m=0.02, rng=np.random.default_rng(3))
    sizes = {round(float(part.half_m[0]), 9) for part in parts if abs(part.R_WK[2, 0]) > 0.5}
    assert len(sizes) >= 5
    # A face of a radius r cut at 45° is r·√2 wide.
    assert max(sizes) <= 0.02 * np.sqrt(0.5) + 1e-9


def pose_on(staircase: Staircase, heading_rad: float, along_m: float, lateral_m: float, roll_rad: float = 0.0) -> Pose:
    R_WB = staircase.R_WS @ rotation_z(heading_rad) @ rotation_x(roll_rad)
    p_WB = staircase.p_WS + staircase.R_WS @ np.array([along_m, lateral_m, 0.0])
    return R_WB @ CALIBRATION.R_BC, p_WB + R_WB @ np.array(CALIBRATION.mount_m)


def test_faces_name_the_boxes_of_the_staircase() -> None:
    staircase = build_staircase(Stair(slope_deg=28.0, steps=40, walls="left"), np.random.default_rng(0))
    R_WC, p_WC = pose_on(staircase, 0.0, 6.0, 0.0)
    view = Camera(staircase, CALIBRATION, rng=np.random.default_rng(0)).exact(R_WC, p_WC)
    v, u = CALIBRATION.height_px // 2, CALIBRATION.width_px // 2
    ray = np.array([(u - CALIBRATION.cx_px) / CALIBRATION.fx_px, (v - CALIBRATION.cy_px) / CALIBRATION.fy_px, 1.0])
    point = p_WC + R_WC @ ray * view.depth_m[v, u]
    box = stair_boxes(staircase)[view.face[v, u] // 6]
    # On the surface of the named box: no axis is exceeded, one is reached.
    excess = np.abs(point - np.array(box.centre_W)) - np.array(box.half_m)
    assert np.max(excess) == pytest.approx(0.0, abs=1e-9)
