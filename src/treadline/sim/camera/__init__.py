"""RGB-D camera without OpenGL, and random views of stairs and rooms with ground truth."""

from treadline.sim.camera.camera import Camera, ExactView
from treadline.sim.camera.recipe import ROOM_SCENES, STAIR_SCENES, STAIRLESS_SCENES, ViewRecipe
from treadline.sim.camera.truth import StairTruth
from treadline.sim.camera.views import RecordedDrive, View, draw_view

__all__ = [
    "ROOM_SCENES",
    "STAIRLESS_SCENES",
    "STAIR_SCENES",
    "Camera",
    "ExactView",
    "RecordedDrive",
    "StairTruth",
    "View",
    "ViewRecipe",
    "draw_view",
]
