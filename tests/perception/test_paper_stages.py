"""Algorithm 1 stage by stage: thresholds, abrupt depths, segments, merging, the answer of Eq. (2)."""

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.perception import DetectorConfig, StairDetector
from treadline.perception.paper.algorithm import BOX_COLOUR, run_steps
from treadline.perception.paper.edges import canny, grey_of, thresholds
from treadline.perception.paper.hough_segments import merged, slopes

CAMERA = PinholeCamera(width_px=320, height_px=240, fx_px=287.5, fy_px=287.5, cx_px=159.5, cy_px=119.5)
NOSINGS = (40, 80, 120, 160, 200)
PAPER = StairDetector(DetectorConfig(method="paper"))


def banded(heading_rad: float, rows: tuple[int, ...] = NOSINGS) -> RgbdFrame:
    """Return a level camera's view of a wall painted in bands, their edges level at some rows."""
    bands = 50 + 140 * (np.searchsorted(rows, np.arange(240), side="right") % 2)
    rgb = np.repeat(np.repeat(bands[:, None, None], 320, axis=1), 3, axis=2).astype(np.uint8)
    across = (np.arange(320)[None, :] - CAMERA.cx_px) / CAMERA.fx_px
    depth = np.repeat(2.0 / (1.0 + np.tan(heading_rad) * across), 240, axis=0).astype(np.float32)
    return RgbdFrame(t_s=0.0, rgb=rgb, depth_m=depth, camera=CAMERA)


@pytest.mark.parametrize(("heading_deg", "printed_deg"), [(0.0, 90.0), (-10.0, 79.8), (-30.0, 54.7), (10.0, 100.2)])
def test_equation_2_answers_90_degrees_to_a_square_chair(heading_deg: float, printed_deg: float) -> None:
    sight = PAPER.look(banded(heading_deg * DEG))
    # Ends of lines fall on whole pixels: 1° is three of 300 columns.
    assert sight.heading_rad / DEG == pytest.approx(printed_deg, abs=1.0)


def test_every_nosing_becomes_one_line_at_its_row_and_stages_only_take_away() -> None:
    steps = run_steps(banded(0.0))
    assert sorted(steps.nosings[:, 1].round()) == pytest.approx(NOSINGS, abs=2.0)
    assert np.abs(slopes(steps.nosings)).max() < 0.01
    # Across the whole image but for the blur at its border.
    assert (steps.nosings[:, 2] - steps.nosings[:, 0]).min() > 300
    turned = run_steps(banded(0.2))
    assert not np.any(turned.kept_edges & ~(turned.colour_edges | turned.depth_edges))
    assert len(turned.lines) >= len(turned.level_lines) >= len(turned.nosings) > 0


def test_the_answer_carries_box_count_and_six_pictures() -> None:
    sight = PAPER.look(banded(0.0), stages=True)
    assert sight.edge_count == len(NOSINGS)
    u0, v0, u1, v1 = sight.box_px
    assert (v0, v1) == pytest.approx((40, 200), abs=2)
    assert u1 - u0 > 300
    assert [picture.shape for picture in sight.stages] == [(240, 320, 3)] * 6
    assert (sight.stages[5] == BOX_COLOUR).all(axis=2).any()
    assert PAPER.look(banded(0.0)).stages is None


def test_a_picture_without_lines_is_refused_with_the_reason() -> None:
    sight = PAPER.look(banded(0.0, rows=()))
    assert not sight.accepted
    assert "line" in (sight.reason or "")


def test_lines_without_depth_are_refused_with_the_reason() -> None:
    frame = banded(0.0)
    frame.depth_m[:, :40] = np.nan
    # Edges with no depth are taken away with the abrupt ones, so the lines end where depth does.
    seen = run_steps(frame).nosings
    assert seen[:, 0].min() >= 40
    frame.depth_m[:] = np.nan
    assert not PAPER.look(frame).accepted


def test_the_median_rule_follows_the_brightness() -> None:
    grey = np.full((20, 20), 90, dtype=np.uint8)
    lower, upper = thresholds(grey, "median")
    assert (lower, upper) == pytest.approx((90 * 0.67, 90 * 1.33))
    # Holes are black and no part of the brightness.
    grey[:9] = 0
    assert thresholds(grey, "median") == (lower, upper)
    assert thresholds(np.full((20, 20), 250, dtype=np.uint8), "median")[1] == 255.0


def test_the_otsu_rule_parts_two_populations() -> None:
    grey = np.full((20, 20), 60, dtype=np.uint8)
    grey[:, 10:] = 180
    lower, upper = thresholds(grey, "otsu")
    assert 60 <= upper < 180
    assert lower == 0.5 * upper


@pytest.mark.parametrize("rule", ["rosin", "mad"])
@pytest.mark.parametrize("light", [1.0, 0.3])
def test_rules_on_the_gradient_find_a_step_in_dim_light_and_no_noise(rule: str, light: float) -> None:
    rng = np.random.default_rng(5)
    picture = np.full((120, 160), 60.0)
    picture[:, 80:] = 160.0
    grey = grey_of(
        np.repeat((light * (picture + 4.0 * rng.standard_normal(picture.shape)))[:, :, None], 3, axis=2).astype(np.uint8)
    )
    edges = canny(grey, rule)
    assert edges[:, 77:84].any(axis=1).mean() > 0.95
    # Five median deviations leave three noise pixels in a thousand; those next to them follow.
    assert edges[:, :70].mean() < 0.03
    assert edges[:, 90:].mean() < 0.03


@pytest.mark.parametrize("rule", ["median", "otsu", "rosin", "mad"])
def test_a_black_picture_has_no_edges(rule: str) -> None:
    assert not canny(np.zeros((40, 40), dtype=np.uint8), rule).any()


def test_lines_at_other_rows_or_slopes_stay_apart() -> None:
    level = [10.0, 50.0, 300.0, 50.0]
    assert len(merged(np.array([level, [10.0, 61.0, 300.0, 61.0]]), 320)) == 2
    assert len(merged(np.array([level, [10.0, 59.0, 300.0, 59.0]]), 320)) == 1
    # Both cross the middle at row 50; 0.03 is more than 2 rows in 100 columns.
    assert len(merged(np.array([level, [10.0, 45.5, 310.0, 54.5]]), 320)) == 2
