"""What the detector sees in random views of stairs, next to the ground truth."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from scenes.recipe import ViewRecipe
from scenes.views import StairTruth, View, draw_view

from treadline.perception import DetectorConfig, StairDetection, StairDetector

LEAST_SHARE = 0.15
"""Least image fraction of the stair for a frame to count."""


def sights(recipe: ViewRecipe, seeds: range, **config: Any) -> Iterator[tuple[View, StairTruth, StairDetection]]:
    """Look at each view that shows enough of its stair."""
    detector = StairDetector(DetectorConfig(**config))
    for seed in seeds:
        view = draw_view(np.random.default_rng(seed), recipe)
        if view.stair is not None and view.stair.share > LEAST_SHARE:
            yield view, view.stair, detector.look(view.frame, view.gravity_C)
