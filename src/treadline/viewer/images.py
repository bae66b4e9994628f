"""Images of a recorded run, with what the detector finds in them: ``ImageOrder -> Look``.

A log holds headings and stair maps, not the reason of a rejected frame; the detector is run again on the logged images.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from treadline.errors import ImageError
from treadline.io.mcap_read import read_log
from treadline.mission.gravity import GravityAtExposure
from treadline.perception import DetectorConfig, StairDetector
from treadline.signals import ImuSample, RgbdFrame
from treadline.viewer.orders import ImageOrder
from treadline.viewer.tap import look_of
from treadline.viewer.tape import Look


def looks_of(order: ImageOrder) -> Iterator[Look]:
    """Yield the notes of the frames of a log in their order.

    Raises:
        LogFormatError: If the log is damaged.
    """
    detector = StairDetector(DetectorConfig(method=order.vision, swept_half_m=order.swept_half_m))
    gravity = GravityAtExposure()
    for signal in read_log(Path(order.log), lambda topic: topic == "/imu" or topic.startswith("/camera")):
        if isinstance(signal, ImuSample):
            gravity.update(signal)
        elif isinstance(signal, RgbdFrame):
            frame = replace(signal, camera=order.camera)
            try:
                detection = detector.see(frame, gravity.gravity_C(frame))
            except ImageError:
                continue  # an image that the detector refuses has nothing to show
            yield look_of(frame, detection, signal.t_s + order.latency_s, with_picture=True)


def send_looks(order: ImageOrder, put: Callable[[Any], None]) -> None:
    """Send the notes of all frames, waiting for the viewer where it is slow."""
    for look in looks_of(order):
        put(("look", look))
    put(("looks_end", None))
