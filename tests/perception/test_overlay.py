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


def test_a_refused_frame_says_why() -> None:
    _, picture = seen("floor")
    assert picture[-BAND_PX:].max() > 150
    assert not (picture[:-BAND_PX, -200:] == (255, 235, 60)).all(axis=2).any()  # no needle
