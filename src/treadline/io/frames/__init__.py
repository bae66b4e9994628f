"""Frames from files, logs and cameras: images, point clouds, recordings and live depth cameras, each as a series of frames."""

from treadline.core.camera_images import FrameSource, NamedFrame
from treadline.io.frames._image_files import read_frame
from treadline.io.frames.point_cloud import frame_of_points
from treadline.io.frames.sources import read_frames

__all__ = ["FrameSource", "NamedFrame", "frame_of_points", "read_frame", "read_frames"]
