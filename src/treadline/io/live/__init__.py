"""Live depth cameras behind one protocol, and the table of cameras that can be opened by name; ``stream`` checks their images."""

from importlib import import_module

from treadline.core.errors import SettingsError
from treadline.io.live._depth_camera import CameraImages, DepthCamera

__all__ = ["CAMERAS", "CameraImages", "DepthCamera", "camera_by_name"]

CAMERAS = {
    "realsense": ("treadline.io.live._realsense", "RealSenseCamera"),
    "orbbec": ("treadline.io.live._orbbec", "OrbbecCamera"),
    "oak": ("treadline.io.live._oak", "OakCamera"),
}
"""Module and class of each camera."""


def camera_by_name(name: str) -> DepthCamera:
    """Return a closed camera.

    Raises:
        SettingsError: If the name is not in ``CAMERAS``.
    """
    if name not in CAMERAS:
        raise SettingsError(f"--live is '{name}'; allowed: {', '.join(CAMERAS)}")
    module, maker = CAMERAS[name]
    camera: DepthCamera = getattr(import_module(module), maker)()
    return camera
