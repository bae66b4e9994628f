"""Image of the detection result."""

import numpy as np
from scenes.recipe import ViewRecipe
from scenes.views import View, draw_view

from treadline.perception import StairDetector
from treadline.perception._plane_segmentation import Surface
from treadline.perception.overlay import overlay

# Literals, so that a changed value in the code is detected here.
BAND_PX = 66
WIDTH_PX = 960


def seen(scene: str) -> tuple[View, np.ndarray]:
    view = draw_view(np.random.default_rng(41_000), ViewRecipe(scenes=(scene,)))
    return view, overlay(view.frame, StairDetector().look(view.frame, view.gravity_C))


def test_a_stair_is_tinted_where_its_surfaces_are() -> None:
    view, picture = seen("up")
    assert picture.shape == (round(240 * WIDTH_PX / 320) + BAND_PX, WIDTH_PX, 3)
    sight = StairDetector().look(view.frame, view.gravity_C)

    def blueness(surface: Surface) -> float:
        u, v = view.frame.camera.fx_px * surface.centre[:2] / surface.centre[2] + [view.frame.camera.cx_px, view.frame.camera.cy_px]
        pixel = picture[round(float(v) * 3.0), round(float(u) * 3.0)].astype(float)
        return float(pixel[2] - pixel[0])

    # Treads are blue and risers orange, whatever the stair's own colour, for that is the same for both.
    assert (
        np.mean([blueness(tread) for tread in sight.parts.treads]) > np.mean([blueness(riser) for riser in sight.parts.risers]) + 50
    )


def test_nosings_are_drawn_no_further_than_they_are_seen() -> None:
    # Two nosings alone, whose first guess of a direction is five degrees off: lines along it ran far past the steps.
    view = draw_view(np.random.default_rng([0, 3]), ViewRecipe())
    sight = StairDetector().look(view.frame, view.gravity_C)
    assert sight.axes is not None
    assert sight.box_px is not None
    camera = view.frame.camera
    for nosing in sight.parts.flight:
        ends = nosing.ends_m(sight.axes.edge_C, sight.parts.aside)
        np.testing.assert_allclose(ends @ sight.parts.aside, nosing.sides_m)
        np.testing.assert_allclose(np.cross(ends - nosing.point, sight.axes.edge_C), 0.0, atol=1e-12)
        u = camera.fx_px * ends[:, 0] / ends[:, 2] + camera.cx_px
        # The box holds the middles of blocks, and a riser leans in the image.
        assert sight.box_px[0] - 12.0 < u.min() < u.max() < sight.box_px[2] + 12.0


def test_a_refused_frame_says_why() -> None:
    _, picture = seen("floor")
    assert picture[-BAND_PX:].max() > 150
    assert not (picture[:-BAND_PX, -200:] == (255, 235, 60)).all(axis=2).any()  # no needle
