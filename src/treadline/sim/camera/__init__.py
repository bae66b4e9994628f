"""An RGB-D camera that needs no GL, and views of stairs and rooms with their truth."""

from treadline.sim.camera.camera import Camera, ExactView
from treadline.sim.camera.recipe import ROOM_SCENES, STAIR_SCENES, Recipe
from treadline.sim.camera.truth import StairTruth
from treadline.sim.camera.views import RecordedDrive, View, draw_view

__all__ = ["ROOM_SCENES", "STAIR_SCENES", "Camera", "ExactView", "Recipe", "RecordedDrive", "StairTruth", "View", "draw_view"]
