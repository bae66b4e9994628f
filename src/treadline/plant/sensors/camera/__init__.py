"""RGB-D camera without OpenGL, and random views of stairs and rooms with ground truth."""

from treadline.plant.sensors.camera.ground_truth import StairTruth
from treadline.plant.sensors.camera.ray_camera import Camera
from treadline.plant.sensors.camera.recipe import ROOM_SCENES, STAIR_SCENES, STAIRLESS_SCENES, ViewRecipe
from treadline.plant.sensors.camera.rendered_frame import ExactView
from treadline.plant.sensors.camera.views import RecordedDrive, View, draw_view

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
