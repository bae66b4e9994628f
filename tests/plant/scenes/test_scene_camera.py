"""Rolling shutter, edge holes and water of the benchmark's camera."""

import numpy as np
import pytest
from scenes import SceneCamera, ViewRecipe, draw_view
from scenes.camera import Puddle, Sweep

from treadline.core.angles import DEG
from treadline.plant.sensors.camera.solids import upright
from treadline.scenario.chair import read_chair

CALIBRATION = read_chair("wheelchair").camera_at(240)
LEVEL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Camera axes (right, down, ahead) of a camera that looks along x."""


def wall_camera() -> SceneCamera:
    wall = upright("wall", (2.0, -5.0, -5.0), (2.1, 5.0, 5.0))
    return SceneCamera([wall], CALIBRATION, kind="ideal", rng=np.random.default_rng(0))


def test_a_camera_that_drives_at_a_wall_sees_the_lower_rows_nearer() -> None:
    sweep = Sweep(readout_s=0.03, velocity_W=np.array([0.5, 0.0, 0.0]), rate_W=np.zeros(3))
    depth = wall_camera().frame(0.0, LEVEL, np.zeros(3), sweep).depth_m
    expected = 2.0 - 0.5 * 0.03 * ((np.arange(240) + 0.5) / 240 - 0.5)
    # Bands of 10 rows share a pose: half a band is 0.3 mm.
    np.testing.assert_allclose(depth, np.broadcast_to(expected[:, None], depth.shape), atol=0.0004)


def test_a_camera_that_turns_sees_a_wall_turned_row_by_row() -> None:
    rate = 30.0 * DEG
    sweep = Sweep(readout_s=0.03, velocity_W=np.zeros(3), rate_W=np.array([0.0, 0.0, rate]))
    depth = wall_camera().frame(0.0, LEVEL, np.zeros(3), sweep).depth_m.astype(float)
    u = (np.arange(320) - CALIBRATION.cx_px) / CALIBRATION.fx_px
    for row in (5, 125, 235):
        turned = rate * 0.03 * ((row // 10 * 10 + 5.0) / 240 - 0.5)
        # After a left turn the wall's right side is nearer along the optical axis.
        slope = np.polyfit(u, 1.0 / depth[row], 1)[0]
        assert slope == pytest.approx(np.sin(turned) / 2.0, abs=1e-6)


def test_the_truth_belongs_to_the_middle_row() -> None:
    recipe = ViewRecipe(sensor="ideal", readout_s=0.03, speed_m_s=(0.5, 0.5), turn_rate_deg_s=10.0)
    seen = draw_view(np.random.default_rng(2), recipe)
    rows = slice(115, 125)
    shift = np.abs(seen.frame.depth_m[rows] - seen.exact.depth_m[rows])
    away = np.abs(seen.frame.depth_m[:10] - seen.exact.depth_m[:10])
    assert np.nanmedian(shift) < 0.25 * np.nanmedian(away)


def test_water_takes_depth_away_and_mirrors() -> None:
    solids = [upright("step", (0.0, -2.0, -0.2), (4.0, 2.0, 0.0))]
    puddle = Puddle(centre_W=(1.3, 0.0, 0.0), half_m=(0.15, 0.3))
    dry, wet = (
        SceneCamera(solids, CALIBRATION, puddles=puddles, rng=np.random.default_rng(1)).frame(
            0.0, CALIBRATION.R_BC, np.array([0.4, 0.0, 0.8])
        )
        for puddles in ((), (puddle,))
    )
    lost = np.isnan(wet.depth_m) & ~np.isnan(dry.depth_m)
    deeper = wet.depth_m > dry.depth_m
    assert 0.01 < lost.mean() < 0.2
    assert 0.0005 < deeper.mean() < lost.mean()
    elsewhere = ~(lost | deeper)
    np.testing.assert_array_equal(wet.depth_m[elsewhere], dry.depth_m[elsewhere])
