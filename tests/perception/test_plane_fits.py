"""Planes fitted to sums over pixels: what they find, how well it is known, and which pixels have none."""

import numpy as np
import pytest
from jaxtyping import Float

from treadline.perception import _plane_segmentation_kernels as surface_kernels

FOCAL_PX = 285.0
PLANE = np.array([0.02, 0.45, 0.31])
"""w = n·(x, y, 1): a tread 2 m ahead."""
NOISE = 1e-3


def sums_of(rows: range, columns: range, seed: int = 0) -> Float[np.ndarray, "10"]:
    """Return the sums over some pixels that see the plane, in an image of 320×240."""
    rng = np.random.default_rng(seed)
    sums = np.zeros(10)
    for v in rows:
        for u in columns:
            x, y = (u - 159.5) / FOCAL_PX, (v - 119.5) / FOCAL_PX
            w = PLANE @ (x, y, 1.0) + rng.normal(0.0, NOISE)
            sums += (1.0, x, y, x * x, x * y, y * y, w, x * w, y * w, w * w)
    return sums


@pytest.mark.parametrize(("rows", "columns"), [(range(200, 240), range(320)), (range(238, 240), range(0, 320, 3))])
def test_a_plane_is_found_within_what_its_covariance_says(
    rows: range,
    columns: range,
) -> None:
    """Test: a tread over forty rows, and over two at the image's border. Expected result: in twenty draws the plane's squared error
    is three times its covariance in the mean, within twice the scatter of that (0.55)."""
    squares = []
    for seed in range(20):
        plane, inverse = np.empty(3), np.empty((3, 3))
        assert surface_kernels.solved_plane(sums_of(rows, columns, seed), plane, inverse) > 0.0
        assert np.linalg.eigvalsh(inverse).min() > 0.0
        off = plane - PLANE
        squares.append(off @ np.linalg.solve(inverse * NOISE**2, off))
    assert np.mean(squares) == pytest.approx(3.0, abs=1.1)


@pytest.mark.parametrize("at", [3, 120, 239])
def test_pixels_in_one_row_or_column_have_no_plane(at: int) -> None:
    """Test: what is left of their squares about the mean is rounding, of either sign. Expected result: none, instead of one whose
    variance is negative."""
    for rows, columns in ((range(at, at + 1), range(320)), (range(240), range(at, at + 1))):
        for last in range(30, 240, 7):
            plane, inverse = np.empty(3), np.empty((3, 3))
            sums = sums_of(rows[:last], columns[:last])
            assert np.isnan(surface_kernels.solved_plane(sums, plane, inverse))
