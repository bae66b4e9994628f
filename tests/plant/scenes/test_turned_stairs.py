"""Frames of turned stairs: ground truth and depth belong together."""

import pytest
from turned_stairs import STAIRS, draw_frame, plan_axes

from treadline.core.angles import DEG


@pytest.mark.parametrize("name", [*STAIRS, "winding 3", "kerb", "drop"])
def test_the_depth_at_a_visible_edge_is_that_of_the_ground_truth(name: str) -> None:
    view = draw_frame(7, name, before=2 if name in STAIRS else None, sensor="exact")
    camera, depth_m = view.frame.camera, view.frame.depth_m
    ahead, left = plan_axes(camera, view.true_gravity_C) @ camera.R_BC
    shown = [step for step in view.steps if step.visible > 0.9 or step.kind in ("kerb", "drop")]
    for step in shown:
        aside, forward = step.edge.mean(axis=0)
        point = forward * ahead - aside * left + (view.camera_at[2] - step.height_m) * view.true_gravity_C
        u, v = (round(float(place)) for place in camera.point_to_pixel(point))
        # One pixel further the depth is that of what lies behind the edge.
        assert depth_m[v - 2 : v + 3, u - 2 : u + 3].min() == pytest.approx(point[2], rel=0.02)
    assert shown


def test_a_chair_on_the_flight_has_its_heading_in_inclined_axes() -> None:
    for before in (None, 3):
        view = draw_frame(5, "straight", before=before, heading_deg=30.0)
        assert abs(view.heading_to(view.steps[0])) == pytest.approx(30.0 * DEG)
        assert (abs(view.steps[0].direction_rad) > 31.0 * DEG) == (before is not None)
