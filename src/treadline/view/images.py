"""Images of a recorded run: ``ImageOrder -> Look``.

A run log holds headings and stair maps, not the reason of a rejected frame; the detector is run again on the logged images. The
mount of a ROS bag's camera is unknown: its images are shown without a detector's result.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from treadline.core.errors import ImageError, LogFormatError
from treadline.core.images import RgbdFrame
from treadline.core.signals import ImuSample
from treadline.io.decode import CdrReader, compressed_picture, picture
from treadline.io.mcap_read import BROKEN, has_arrivals, read_log
from treadline.io.topics import COLOUR_ENCODINGS, COMPRESSED, IMAGE, TopicSummary, kind_of, packets, reader_of, survey
from treadline.mission.frame_gravity import GravityAtExposure
from treadline.perception import DetectorConfig, StairDetector
from treadline.perception.overlay import as_jpeg
from treadline.playback import bag_origin_ns
from treadline.view.orders import ImageOrder
from treadline.view.tap import PICTURE_PX, look_of
from treadline.view.tape import Look


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


def pictures_of(order: ImageOrder) -> Iterator[Look]:
    """Yield the colour images of a ROS bag, raw or compressed, in their order.

    Raises:
        LogFormatError: If the bag is damaged.
    """
    path = Path(order.log)
    topic = _colour_topic(survey(path, sealed=False))
    if topic is None:
        return
    origin_ns = bag_origin_ns(path)
    for packet, logged_ns, data in packets(path, topic.__eq__, sealed=False):
        reader = reader_of(packet, data, logged_ns, origin_ns)
        try:
            t_s, rgb = _compressed(reader) if kind_of(packet) == COMPRESSED else _raw(reader)
        except (LogFormatError, *BROKEN, OSError, Image.DecompressionBombError):
            continue  # an image that cannot be read has nothing to show
        yield Look(
            t_s=t_s,
            taken_s=max(1e-9 * (logged_ns - origin_ns), t_s),
            reason=None,
            heading_rad=None,
            sigma_rad=None,
            edge_count=0,
            nosings_B=np.zeros((0, 3)),
            summary=f"image of {topic}, without a detector's result",
            picture=as_jpeg(rgb, PICTURE_PX),
            is_judged=False,
        )


def _colour_topic(found: Mapping[str, TopicSummary]) -> str | None:
    """Return the topic of the colour images: raw before compressed, and none that something is drawn into."""

    def rank(name: str) -> tuple[bool, bool, bool, str]:
        return "overlay" in name, found[name].kind == COMPRESSED, not any(word in name for word in ("color", "rgb")), name

    raw = [name for name, item in found.items() if item.kind == IMAGE and item.pixels in COLOUR_ENCODINGS]
    packed = [name for name, item in found.items() if item.kind == COMPRESSED and "depth" not in name.lower()]
    return min((*raw, *packed), key=rank, default=None)


def _raw(reader: CdrReader) -> tuple[float, UInt8[np.ndarray, "h w 3"]]:
    image = picture(reader)
    pixels = image.pixels if image.pixels.ndim == 3 else np.repeat(image.pixels[:, :, None], 3, axis=2)
    return image.t_s, np.ascontiguousarray(pixels[:, :, 2::-1] if image.encoding.startswith("bgr") else pixels[:, :, :3])


def _compressed(reader: CdrReader) -> tuple[float, UInt8[np.ndarray, "h w 3"]]:
    t_s, data = compressed_picture(reader)
    with Image.open(BytesIO(data), formats=("JPEG", "PNG")) as image:
        return t_s, np.asarray(image.convert("RGB"))


def send_looks(order: ImageOrder, put: Callable[[Any], None]) -> None:
    """Send the notes of all frames, waiting for the viewer where it is slow."""
    for look in looks_of(order) if has_arrivals(Path(order.log)) else pictures_of(order):
        put(("look", look))
    put(("looks_end", None))
