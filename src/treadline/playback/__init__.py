"""A run as arrays, for viewers, players and pictures: ``run folder, log or signals -> Recording``."""

from treadline.playback.builder import RecordingBuilder
from treadline.playback.read_run import bag_origin_ns, manifest_of, read_frames, read_recording, run_folder_of
from treadline.playback.recording import Limits, PerceivedStair, PhaseSpan, Recording

__all__ = [
    "Limits",
    "PerceivedStair",
    "PhaseSpan",
    "Recording",
    "RecordingBuilder",
    "bag_origin_ns",
    "manifest_of",
    "read_frames",
    "read_recording",
    "run_folder_of",
]
