"""Frames from files, logs and cameras: images, point clouds, recordings and live depth cameras, each as a series of frames."""

from treadline.frames.named_frame import FrameSource, NamedFrame
from treadline.frames.sources import read_frames

__all__ = ["FrameSource", "NamedFrame", "read_frames"]
