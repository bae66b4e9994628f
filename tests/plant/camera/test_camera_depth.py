"""The camera's exact depth against MuJoCo's rays, and what of a stair it shows."""

import mujoco
import numpy as np
import pytest
from jaxtyping import Float

from treadline.core.angles import DEG, rotation_x, rotation_z
from treadline.plant.sensors.camera import Camera
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Stair
from treadline.vehicle.stair_solids import stair_boxes
from treadline.vehicle.staircase import Staircase, build_staircase

Pose = tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]
CALIBRATION = read_chair("wheelchair").camera_at(240)


def pose_on(staircase: Staircase, heading_rad: float, along_m: float, lateral_m: float, roll_rad: float = 0.0) -> Pose:
    R_WB = staircase.R_WS @ rotation_z(heading_rad) @ rotation_x(roll_rad)
    p_WB = staircase.p_WS + staircase.R_WS @ np.array([along_m, lateral_m, 0.0])
    return R_WB @ CALIBRATION.R_BC, p_WB + R_WB @ np.array(CALIBRATION.mount_m)


def rays(staircase: Staircase, pose: Pose) -> Float[np.ndarray, "h w"]:
    """Return depth along the optical axis of each pixel by MuJoCo, NaN where nothing is hit."""
    geoms = "".join(
        f'<geom type="box" pos="{_words(box.centre_W)}" size="{_words(box.half_m)}" euler="0 0 {box.yaw_rad!r}"/>'
        for box in stair_boxes(staircase)
    )
    model = mujoco.MjModel.from_xml_string(f'<mujoco><compiler angle="radian"/><worldbody>{geoms}</worldbody></mujoco>')
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    R_WC, p_WC = pose
    u = (np.arange(CALIBRATION.width_px) - CALIBRATION.cx_px) / CALIBRATION.fx_px
    v = (np.arange(CALIBRATION.height_px) - CALIBRATION.cy_px) / CALIBRATION.fy_px
    across, down = np.meshgrid(u, v)
    seen = np.column_stack([across.ravel(), down.ravel(), np.ones(across.size)])
    length = np.linalg.norm(seen, axis=1)
    directions = (seen / length[:, None]) @ R_WC.T
    distance, hit = np.empty(len(seen)), np.empty(len(seen), dtype=np.int32)
    mujoco.mj_multiRay(model, data, p_WC, directions.ravel(), None, 1, -1, hit, distance, None, len(seen), 50.0)
    return np.where(hit >= 0, distance / length, np.nan).reshape(across.shape)


def _words(numbers: tuple[float, ...]) -> str:
    return " ".join(repr(float(number)) for number in numbers)


@pytest.mark.parametrize(
    ("seed", "heading_deg", "lateral_m", "roll_deg", "stair"),
    [
        (0, 0.0, 0.0, 0.0, Stair(slope_deg=28.0)),
        (1, 33.0, -0.2, 3.0, Stair(slope_deg=25.0, walls="both", nosing_yaw_jitter_deg=1.0, rise_jitter_m=0.01)),
        (2, -35.0, 0.25, -5.0, Stair(slope_deg=30.0, open_risers=True, walls="none", missing_steps=(7,))),
    ],
)
def test_depth_is_that_of_rays(seed: int, heading_deg: float, lateral_m: float, roll_deg: float, stair: Stair) -> None:
    staircase = build_staircase(stair, np.random.default_rng(seed))
    pose = pose_on(staircase, heading_deg * DEG, 1.3, lateral_m, roll_deg * DEG)
    depth = Camera(staircase, CALIBRATION, rng=np.random.default_rng(seed)).exact(*pose).depth_m
    truth = rays(staircase, pose)
    near = truth < 6.0
    assert near.mean() > 0.2
    # A thousandth is left for pixels whose centre falls on an edge, where rounding decides between two faces.
    assert np.mean(np.abs(depth[near] - truth[near]) < 1e-4) >= 0.999


def test_the_chair_on_a_flight_sees_mostly_stair() -> None:
    shares = []
    for seed, heading_deg in enumerate((-35.0, -15.0, 0.0, 15.0, 35.0)):
        staircase = build_staircase(Stair(slope_deg=28.0), np.random.default_rng(seed))
        boxes = stair_boxes(staircase)
        view = Camera(staircase, CALIBRATION, rng=np.random.default_rng(seed)).exact(
            *pose_on(staircase, heading_deg * DEG, 1.5, 0.0)
        )
        is_step = np.array([box.kind == "step" for box in boxes] + [False])
        shares.append(is_step[np.where(view.face >= 0, view.face // 6, len(boxes))].mean())
    # The method is judged on frames with more than 15 % stair; the mount is chosen so that a chair on the flight has them.
    assert min(shares) > 0.15


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
