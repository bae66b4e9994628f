"""Algorithm 1, step by step, each on a picture whose answer is known."""

import numpy as np
import pytest
from jaxtyping import Bool

from treadline.perception.paper.edges import canny, depth_image, grey_of, thresholds, without_abrupt_depth
from treadline.perception.paper.hough_segments import bounding_box, merged, most_frequent_slope, near_level, segments, slopes


def picture_of_a_line(v1: int, v2: int) -> Bool[np.ndarray, "h w"]:
    edges = np.zeros((120, 160), dtype=bool)
    columns = np.arange(20, 140)
    edges[np.round(v1 + (v2 - v1) * (columns - 20) / 119).astype(int), columns] = True
    return edges


def test_step_1_takes_colour_and_depth_and_shows_holes_as_black() -> None:
    assert grey_of(np.full((4, 4, 3), 90, dtype=np.uint8)).tolist() == [[90] * 4] * 4
    depth = np.array([[np.nan, 2.0], [4.0, 9.0]], dtype=np.float32)
    assert depth_image(depth).tolist() == [[0, 127], [255, 255]]


def test_step_2_the_thresholds_follow_the_picture() -> None:
    dark, bright = np.full((20, 20), 40, dtype=np.uint8), np.full((20, 20), 160, dtype=np.uint8)
    (dark_low, dark_high), (low, high) = thresholds(dark, "median"), thresholds(bright, "median")
    assert low / dark_low == pytest.approx(4.0)
    assert high / dark_high == pytest.approx(4.0)


def test_step_2_finds_the_edge_between_two_greys_and_nothing_else() -> None:
    grey = np.full((40, 60), 60, dtype=np.uint8)
    grey[20:] = 200
    edges = canny(grey, "median")
    assert set(np.nonzero(edges)[0].tolist()) <= {19, 20}
    assert edges[:, 5:55].any(axis=0).all()


def test_step_3_removes_edges_at_a_jump_of_depth_and_at_holes() -> None:
    depth = np.full((10, 10), 1.0, dtype=np.float32)
    depth[:, 5:] = 2.0
    depth[0:2, 0:2] = np.nan
    kept = without_abrupt_depth(np.ones((10, 10), dtype=bool), depth, 0.25)
    assert not kept[:, 4:6].any()
    assert not kept[0:2, 0:2].any()
    assert kept[5, 1:3].all()
    # A jump smaller than the limit is no jump.
    assert without_abrupt_depth(np.ones((10, 10), dtype=bool), depth, 1.2)[5, 4:6].all()


@pytest.mark.parametrize("rise", [0, 12, -12])
def test_step_4_finds_the_line_that_was_drawn(rise: int) -> None:
    found = segments(picture_of_a_line(60, 60 + rise))
    assert len(found) >= 1
    # One row in 120 columns is the raster's own grain.
    np.testing.assert_allclose(slopes(found), rise / 119, atol=0.02)


def test_step_4_keeps_near_level_lines_only() -> None:
    lines = np.array([[0.0, 0.0, 100.0, 30.0], [0.0, 0.0, 100.0, 40.0], [0.0, 0.0, 100.0, -30.0], [5.0, 0.0, 5.0, 80.0]])
    assert near_level(lines).tolist() == lines[[0, 2]].tolist()


def test_step_5_makes_one_line_of_two_pieces_of_one_edge() -> None:
    lines = np.array([[10.0, 50.0, 60.0, 50.0], [80.0, 51.0, 150.0, 51.0], [10.0, 90.0, 150.0, 90.0]])
    joined = merged(lines, 160)
    assert len(joined) == 2
    assert joined[0, [0, 2]].tolist() == [10.0, 150.0]


def test_step_5_keeps_the_most_frequent_slope() -> None:
    lines = np.array([[0.0, k, 100.0, k] for k in (10.0, 40.0, 70.0)] + [[0.0, 20.0, 100.0, 50.0]])
    assert most_frequent_slope(lines).tolist() == lines[:3].tolist()
    assert most_frequent_slope(np.zeros((0, 4))).shape == (0, 4)


def test_step_6_the_box_holds_every_end() -> None:
    lines = np.array([[12.0, 40.0, 130.0, 44.0], [8.0, 90.0, 150.0, 86.0]])
    assert bounding_box(lines) == (8, 40, 150, 90)
