"""Nosings as lines in the image."""

import numpy as np
import pytest
from surfaces import CAMERA, ends_at, surface

from treadline.perception._plane_segmentation import Line

FIRST, LAST, SLOPE = 150, 280, 0.05


def line_of(*beside: tuple[int, int, float]) -> Line:
    """Return the nosing of a level tread, with what else ends at its level: first and last column, rows above the line."""
    parts = [(FIRST, LAST, 0.0), *beside]
    columns = np.concatenate([np.arange(first, last + 1) for first, last, _ in parts])
    above = np.concatenate([np.full(last + 1 - first, rows) for first, last, rows in parts])
    order = np.argsort(columns)
    rows = np.round(180.0 + SLOPE * (columns - CAMERA.cx_px) - above)
    centre = np.array([0.0, 0.5, 1.0])
    plane = surface(np.array([0.0, 1.0, 0.0]), 0.5, 5e-5, centre=centre, lower=ends_at(columns[order], rows[order]))
    found = plane.line("lower", CAMERA)
    assert found is not None
    return found


def test_a_line_reaches_from_the_first_to_the_last_column_of_the_nosing() -> None:
    found = line_of()
    u, v, _ = (found.ends_m / found.ends_m[:, 2:]).T
    assert CAMERA.fx_px * u + CAMERA.cx_px == pytest.approx([FIRST, LAST], abs=1e-6)
    assert CAMERA.fy_px * (v[1] - v[0]) / (LAST - FIRST) == pytest.approx(SLOPE, abs=0.005)
    assert found.count == LAST + 1 - FIRST


@pytest.mark.parametrize("beside", [(20, 60, 15.0), (290, 310, -12.0)], ids=["left", "right"])
def test_a_ledge_behind_a_side_wall_does_not_make_a_nosing_wider(beside: tuple[int, int, float]) -> None:
    alone, found = line_of(), line_of(beside)
    assert found.count == alone.count
    assert found.ends_m.tolist() == alone.ends_m.tolist()
    assert np.allclose(found.covariance, alone.covariance)
