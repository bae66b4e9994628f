"""Random views of stairs and of places without a stair, with ground truth, and the scores of a detector on them.

Contract: ``draw_view(rng, ViewRecipe(...))`` and ``RecordedDrive``. ``python benchmarks/scenes --help`` renders the benchmark of
stair detectors and scores their results.
"""

from scenes.camera import SceneCamera
from scenes.ground_truth import StairTruth
from scenes.recipe import CLUTTER, ROOM_SCENES, STAIR_SCENES, STAIRLESS_SCENES, ViewRecipe
from scenes.views import RecordedDrive, View, draw_view
