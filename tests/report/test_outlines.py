"""Silhouettes of meshes: closed lines around what faces the viewer, for convex solids, rings and the shipped chairs."""

import math

import numpy as np
import pytest
from drawings.paper_figures import ABOVE

from treadline.core.rotations import rotation_x, rotation_z
from treadline.report.side_view import SIDE, area_m2, silhouettes
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair
from treadline.vehicle.appearance import body_poses, chair_parts
from treadline.vehicle.appearance._mesh import Mesh, band, box, merged, part


def _of(mesh: Mesh, **more: object) -> list:
    return silhouettes([part("solid", "chair", [mesh], "frame")], **more)


def test_the_area_of_a_turned_box_is_the_sum_of_its_visible_faces() -> None:
    """Test: edges a, b, c turned about two axes. Expected: faces times the cosines of their normals to the view (Cauchy)."""
    size, R = (0.2, 0.3, 0.5), rotation_z(0.4) @ rotation_x(0.7)
    (shape,) = _of(box((0.0, 0.0, 0.0), size).moved((0.0, 0.0, 0.0), R))
    faces = np.array([size[1] * size[2], size[0] * size[2], size[0] * size[1]])
    # Vertices are kept in single precision.
    assert max(map(area_m2, shape.loops)) == pytest.approx(float(faces @ np.abs(R[1])), rel=1e-5)


def test_a_ring_has_an_outer_line_and_a_hole_that_runs_the_other_way() -> None:
    angle = np.linspace(0.0, 2.0 * math.pi, 60, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    (shape,) = _of(band(circle, 0.8 * circle, -0.1, 0.1, closed=True))
    areas = sorted(0.5 * float(x @ np.roll(z, -1) - z @ np.roll(x, -1)) for x, z in (loop.T for loop in shape.loops))
    polygon = 30.0 * math.sin(2.0 * math.pi / 60.0)  # area of a regular polygon with 60 corners on the unit circle
    assert areas == pytest.approx([-0.64 * polygon, polygon], rel=1e-5)


def test_solids_are_sorted_from_the_farthest_and_moved_with_their_body() -> None:
    near, far = box((0.0, -1.0, 0.0), (1.0, 1.0, 1.0)), box((0.0, 1.0, 0.0), (1.0, 1.0, 1.0))
    X = np.eye(4)
    X[:3, 3] = (5.0, 0.0, 0.0)
    shapes = silhouettes([part("pair", "seat", [merged([near, far])], "frame")], poses={"seat": X})
    assert [shape.depth_m for shape in shapes] == pytest.approx([-1.0, 1.0])
    assert all(shape.loops[0][:, 0].mean() == pytest.approx(5.0) for shape in shapes)


@pytest.mark.parametrize("name", ["wheelchair", "rescue"])
def test_the_silhouettes_of_a_chair_fill_the_extent_of_its_meshes(name: str) -> None:
    chair, loading = read_chair(name), Chair(model=name)
    parts, poses = chair_parts(chair, loading), body_poses(chair, loading)
    placed = np.concatenate([p.vertices_m @ poses[p.body][:3, :3].T + poses[p.body][:3, 3] for p in parts])
    for view in (SIDE, ABOVE):
        lines = np.concatenate([loop for shape in silhouettes(parts, view, poses) for loop in shape.loops])
        seen = placed @ view[:2].T
        np.testing.assert_allclose(lines.min(axis=0), seen.min(axis=0), atol=1e-6)
        np.testing.assert_allclose(lines.max(axis=0), seen.max(axis=0), atol=1e-6)
