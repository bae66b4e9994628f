"""The robust estimator against the simulator's truth, and frames without a stair."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float

from treadline.angles import DEG, rms, rotation_x, rotation_z
from treadline.mechanics.chair import read_chair
from treadline.mechanics.staircase import build_staircase
from treadline.perception import DetectorConfig, StairDetector
from treadline.scenario import Stair
from treadline.signals import RgbdFrame
from treadline.sim.camera import Camera

TEXTURES = ("wood", "concrete", "carpet", "terrazzo", "dark")
ROBUST = StairDetector(DetectorConfig(method="robust"))


def view(
    seed: int, heading_rad: float, stair: Stair, *, kind: str = "kinect1", height_px: int = 240
) -> tuple[RgbdFrame, Float[np.ndarray, " 3"]]:
    """Return a frame from within the flight, and down in C."""
    rng = np.random.default_rng(seed)
    staircase = build_staircase(stair, rng)
    calibration = read_chair("wheelchair").camera_at(height_px)
    camera = Camera(staircase, calibration, kind=kind, texture=stair.texture, light=stair.light, rng=rng)
    R_WB = staircase.R_WS @ rotation_z(heading_rad)
    p_WB = staircase.p_WS + staircase.R_WS @ np.array([rng.uniform(0.3, 3.0), rng.uniform(-0.2, 0.2), 0.0])
    R_WC = R_WB @ calibration.R_BC
    frame = camera.frame(0.0, R_WC, p_WB + R_WB @ np.array(calibration.mount_m))
    return frame, R_WC.T @ np.array([0.0, 0.0, -1.0])


@pytest.mark.parametrize("open_risers", [False, True])
def test_heading_error_on_noisy_frames_stays_below_a_fifth_of_a_degree(open_risers: bool) -> None:
    errors = []
    for seed in range(4100, 4130):
        rng = np.random.default_rng(seed)
        heading = float(rng.uniform(-35.0, 35.0)) * DEG
        stair = Stair(
            slope_deg=float(rng.uniform(25.0, 30.0)),
            run_m=0.3,
            texture=TEXTURES[seed % 5],
            light=float(rng.uniform(0.5, 1.6)),
            walls=("left", "none")[seed % 2],
            open_risers=open_risers,
        )
        sight = ROBUST.look(*view(seed, heading, stair))
        if sight.heading_rad is not None:
            errors.append(sight.heading_rad - heading)
    # 95 % of the frames, all of which show more than 15 % stair; 0.2° is the design's aim, 3° its worst case.
    assert len(errors) >= 0.95 * 30
    assert rms(np.array(errors)) < 0.2 * DEG
    assert max(abs(error) for error in errors) < 3.0 * DEG


def test_the_simulated_depth_is_noisy() -> None:
    stair = Stair(slope_deg=28.0, run_m=0.3)
    noisy, _ = view(4200, 0.1, stair)
    clean, _ = view(4200, 0.1, stair, kind="ideal")
    # Kinect 1 noise is about 1.4 mm at 1 m: without it the figures above would mean nothing.
    assert np.nanmedian(np.abs(noisy.depth_m - clean.depth_m)) > 5e-4


def test_a_larger_image_gives_the_same_heading() -> None:
    sight = ROBUST.look(*view(4201, -0.3, Stair(slope_deg=28.0, run_m=0.3), height_px=480))
    assert sight.heading_rad == pytest.approx(-0.3, abs=0.2 * DEG)


def test_a_degree_of_gravity_error_costs_less_than_a_degree_of_heading() -> None:
    frame, down = view(4202, 0.2, Stair(slope_deg=28.0, run_m=0.3))
    sight = ROBUST.look(frame, rotation_x(DEG) @ rotation_z(DEG) @ down)
    assert sight.heading_rad == pytest.approx(0.2, abs=1.0 * DEG)


def test_the_yaw_of_the_mount_passes_one_to_one() -> None:
    frame, down = view(4203, 0.0, Stair(slope_deg=28.0, run_m=0.3))
    plain = ROBUST.look(frame, down).heading_rad
    turned = ROBUST.look(replace(frame, camera=replace(frame.camera, mount_yaw_rad=0.1)), down).heading_rad
    assert plain is not None
    assert turned is not None
    # Exact: the same edge expressed in axes turned by the mount's yaw.
    assert turned - plain == pytest.approx(-0.1, abs=1e-9)


def test_the_mirrored_image_flips_the_heading() -> None:
    frame, down = view(4204, 0.25, Stair(slope_deg=28.0, run_m=0.3, walls="none"))
    mirrored = replace(frame, rgb=frame.rgb[:, ::-1].copy(), depth_m=frame.depth_m[:, ::-1].copy())
    heading = ROBUST.look(mirrored, down * np.array([-1.0, 1.0, 1.0])).heading_rad
    # The same pixels: only the order of sums differs.
    assert heading == pytest.approx(-(ROBUST.look(frame, down).heading_rad or 0.0), abs=0.01 * DEG)


def test_frames_without_a_stair_yield_no_heading() -> None:
    frame, down = view(4205, 0.0, Stair(slope_deg=28.0, run_m=0.3))
    camera = frame.camera
    v = (np.arange(camera.height_px)[:, None] - camera.cy_px) / camera.fy_px
    u = (np.arange(camera.width_px)[None, :] - camera.cx_px) / camera.fx_px
    floor = 1.0 / (down[0] * u + down[1] * v + down[2])
    nothing = np.full_like(frame.depth_m, np.nan)
    wall = np.full_like(frame.depth_m, 1.5)
    for depth in (np.where(floor > 0.0, floor, np.nan), nothing, wall):
        sight = ROBUST.look(replace(frame, depth_m=depth.astype(np.float32)), down)
        assert not sight.accepted
        assert sight.reason
        assert sight.heading_rad is None


def test_without_gravity_the_treads_tell_down() -> None:
    frame, down = view(4206, 0.2, Stair(slope_deg=28.0, run_m=0.3))
    # Both see the same risers, which alone fix the heading but for the tilt of the edge: 0.1° bounds what that costs.
    assert ROBUST.look(frame, None).heading_rad == pytest.approx(ROBUST.look(frame, down).heading_rad, abs=0.1 * DEG)


def test_without_gravity_and_treads_a_frame_is_refused_with_the_reason() -> None:
    frame, _ = view(4206, 0.0, Stair(slope_deg=28.0, run_m=0.3))
    wall = np.full_like(frame.depth_m, 1.5)
    assert "gravity" in (ROBUST.look(replace(frame, depth_m=wall), None).reason or "")
