"""An RGB-D camera that needs no GL."""

from treadline.sim.camera.camera import Camera, ExactView

__all__ = ["Camera", "ExactView"]
