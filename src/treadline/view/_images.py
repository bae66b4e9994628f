"""Camera frames with what the detector finds in them: ``RgbdFrame, Detection -> ShownFrame``, and those of a log in their order.

A run log holds headings and stair maps, not the reason of a rejected frame; the detector is run again on the logged images. The
mount of a ROS bag's camera is unknown: its images are shown without a detector's result.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import ImageError, LogFormatError
from treadline.core.signals import ImuSample
from treadline.io.images import picture, rgb_pixels
from treadline.io.mcap_read import BROKEN, has_arrivals, read_log
from treadline.io.messages import COMPRESSED, IMAGE
from treadline.io.topics import COLOUR_ENCODINGS, Received, TopicSummary, kind_of, packets, received, survey
from treadline.mission import Detection, GravityAtExposure
from treadline.perception import DetectorConfig, StairDetector
from treadline.perception.detection import StairDetection
from treadline.perception.overlay import BAND_PX, as_jpeg, overlay
from treadline.playback import bag_origin_ns
from treadline.view._messages import DEPTH_STEP, ImageOrder, ShownFrame

PICTURE_PX = 480
"""Width of the camera image in the panel [px]."""


def send_frames(order: ImageOrder, put: Callable[[Any], None]) -> None:
    """Send all frames of a log, waiting for the viewer where it is slow."""
    for frame in frames_of(order) if has_arrivals(Path(order.log)) else pictures_of(order):
        put(("frame", frame))
    put(("end", None))


def frames_of(order: ImageOrder) -> Iterator[ShownFrame]:
    """Yield the frames of a log in their order, with what the detector finds in them.

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
            yield shown(frame, detection, signal.t_s + order.latency_s, with_picture=True)


def shown(frame: RgbdFrame, detection: Detection, taken_s: float, *, with_picture: bool) -> ShownFrame:
    """Return a frame with its detection.

    Args:
        taken_s: Time at which the mission received the frame [s].
        with_picture: Whether the image with its overlay is drawn: 10 ms.
    """
    sight = getattr(detection, "sight", None)
    found = sight if isinstance(sight, StairDetection) else None  # a plug-in returns its answer alone
    measurement, stair = detection.measurement, detection.stair_map
    more: dict[str, Any] = {}
    if found is not None:
        line, rows = found.printed()
        reason, summary = found.reason, "; ".join([line, *(f"{key} {value}" for key, value in rows)])
    elif measurement is None:
        reason = summary = "no heading in this frame"
    else:
        reason, summary = None, f"heading from {measurement.edge_count} nosings"
    if stair is not None:
        more["nosings_B"] = np.array(stair.nosings_B).reshape(-1, 3)
    if found is not None and found.shape is not None:
        more["planes_B"] = {name: planes_of(getattr(found, name), frame.camera) for name in ("treads", "risers")}
    if with_picture:
        drawn = frame.rgb if found is None else overlay(frame, found)[:-BAND_PX]
        more["picture"] = as_jpeg(drawn, PICTURE_PX)
        more["depth_m"] = frame.depth_m[::DEPTH_STEP, ::DEPTH_STEP].astype(np.float32)
    heading_rad = None if measurement is None else measurement.heading_rad
    return ShownFrame(t_s=frame.t_s, taken_s=taken_s, summary=summary, reason=reason, heading_rad=heading_rad, **more)


def planes_of(surfaces: Any, camera: PinholeCamera) -> Float[np.ndarray, "n 4 3"]:
    """Return the corners of detected surfaces in B [m], each in the order upper left, upper right, lower right, lower left.

    The upper and the lower edge in the image are replaced by straight lines, and their ends lie on the plane.
    """
    found = []
    for surface in surfaces:
        columns = surface.upper.columns.astype(float)
        ends, degree = np.array([columns.min(), columns.max()]), min(len(np.unique(columns)) - 1, 1)
        upper, lower = (
            np.polyval(np.polyfit(columns, np.asarray(edge.rows, dtype=float), degree), ends)
            for edge in (surface.upper, surface.lower)
        )
        u, v = np.concatenate([ends, ends[::-1]]), np.concatenate([upper, lower[::-1]])
        rays = camera.pixel_to_point(u, v)
        found.append(rays / (rays @ surface.normal)[:, None])
    return np.asarray(np.array(found).reshape(-1, 4, 3) @ camera.R_BC.T + np.array(camera.mount_m))


def pictures_of(order: ImageOrder) -> Iterator[ShownFrame]:
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
        try:
            message = received(packet, data, logged_ns, origin_ns)
            rgb = _compressed(message) if kind_of(packet) == COMPRESSED else rgb_pixels(picture(*message))
        except (LogFormatError, *BROKEN, OSError, Image.DecompressionBombError):
            continue  # an image that cannot be read has nothing to show
        yield ShownFrame(
            t_s=message.t_s,
            taken_s=max(1e-9 * (logged_ns - origin_ns), message.t_s),
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


def _compressed(message: Received) -> UInt8[np.ndarray, "h w 3"]:
    with Image.open(BytesIO(message.body.data), formats=("JPEG", "PNG")) as image:
        return np.asarray(image.convert("RGB"))
