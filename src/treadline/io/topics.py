"""Topics of a log and their roles.

Depth camera, colour camera, calibration and IMU are assigned to topics by message types and image encodings; names decide between
equal candidates. ``--topics`` overrides the assignment.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

from treadline.core.errors import ImageError, LogFormatError, SettingsError
from treadline.core.signals import HeadingMeasurement
from treadline.io._tables import listed
from treadline.io.mcap_read import BROKEN, Packet, RecordedTopic, damage, mcap_messages
from treadline.io.message_files import READERS, parts_of
from treadline.io.message_types import message_of, stamped_s
from treadline.io.messages import CAMERA_INFO, COMPRESSED, IMAGE, IMU, JOINTS, OWN
from treadline.io.standard_messages import HEADINGS, signal_reader

DEPTH_ENCODINGS = ("16UC1", "32FC1", "mono16")
"""Encodings of depth images."""
COLOUR_ENCODINGS = ("rgb8", "bgr8", "rgba8", "bgra8", "8UC3", "mono8", "8UC1")
"""Encodings of colour images."""
REGISTERED = ("aligned", "registered")
"""Words in the name of a depth topic registered to the colour camera."""


@dataclass(slots=True, kw_only=True)
class TopicSummary:
    """Summary of one topic of a log."""

    kind: str
    count: int
    first_ns: int
    last_ns: int
    stamp_ns: int
    """Stamp of the first message [ns]; the log time if the stamp is not set."""
    pixels: str
    """Encoding of the first image; empty for other messages."""
    size: tuple[int, int]
    """Width and height of the first image or calibration [px]; zeros for other messages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Topics:
    """Topic name of each role; None if not in the log."""

    depth: str | None = None
    color: str | None = None
    info: str | None = None
    imu: str | None = None
    accel: str | None = None
    """Accelerometer topic of an IMU with separate topics for gyro and accelerometer."""
    headings: str | None = None
    """Topic of recorded heading measurements, used in place of images."""


KINDS_OF_ROLES = {
    "depth": (IMAGE,),
    "color": (IMAGE,),
    "info": (CAMERA_INFO,),
    "imu": (IMU,),
    "accel": (IMU,),
    "headings": (OWN[HeadingMeasurement].kind, JOINTS),
}
"""Message types of each role."""


def packets(path: Path, wants: Callable[[str], bool], *, sealed: bool) -> Iterator[Packet]:
    """Yield the messages of a log of any format.

    Raises:
        LogFormatError: If the log is missing, damaged, or not a message log.
    """
    if not path.exists():
        raise LogFormatError(f"{path}: no such file")
    files = parts_of(path)
    if not files or files[0].suffix.lower() not in READERS:
        raise LogFormatError(f"{path}: not a message log; give a run folder, or a file or folder of {', '.join(READERS)}")
    for file in files:
        with damage(file):
            yield from mcap_messages(file, wants, sealed=True) if sealed else READERS[file.suffix.lower()](file, wants)


@contextmanager
def damaged_message(path: Path, topic: str) -> Iterator[None]:
    """Name log and topic in the error of a message that cannot be read."""
    try:
        yield
    except (LogFormatError, ImageError) as error:
        raise type(error)(f"{path}: {topic}: {error}") from None
    except BROKEN as error:
        raise LogFormatError(f"{path}: {topic}: a message that cannot be read: {error}") from None


class Received(NamedTuple):
    """Message of a log with a header, and its stamp [s]."""

    body: Any
    t_s: float


def received(topic: RecordedTopic, data: bytes, logged_ns: int, origin_ns: int = 0) -> Received:
    """Return a message of a standard type, or of treadline's; a zero stamp is replaced by the log time.

    Args:
        origin_ns: Time that is zero on the mission clock.
    """
    body = message_of(kind_of(topic), data, ros1=topic.encoding == "ros1")
    return Received(body, stamped_s(body.header.stamp, origin_ns=origin_ns, logged_ns=logged_ns))


def kind_of(topic: RecordedTopic) -> str:
    """Return a type name in ROS 2 notation; other encodings keep their own name."""
    if topic.encoding not in {"cdr", "ros1"}:
        return f"{topic.encoding} {topic.kind}"
    package, *between = topic.kind.split("/")
    return f"{package}/msg/{between[-1]}" if between else package


def survey(path: Path, *, sealed: bool) -> dict[str, TopicSummary]:
    """Return a summary of each topic; reads the whole log, so that a damaged file is reported first."""
    found: dict[str, TopicSummary] = {}
    for topic, logged_ns, data in packets(path, lambda _: True, sealed=sealed):
        here = found.get(topic.name)
        if here is None:
            with damage(path):
                found[topic.name] = _first(topic, logged_ns, data)
        else:
            here.count += 1
            here.last_ns = max(here.last_ns, logged_ns)
    return found


def _first(topic: RecordedTopic, logged_ns: int, data: bytes) -> TopicSummary:
    kind, pixels, size, t_s = kind_of(topic), "", (0, 0), 0.0
    if kind in (IMAGE, CAMERA_INFO) or signal_reader(topic.name, kind) is not None:
        # The log time is the origin, because a float rounds the seconds since 1970 by more than a nanosecond.
        body, t_s = received(topic, data, logged_ns, origin_ns=logged_ns)
        pixels = body.encoding if kind == IMAGE else ""
        size = (body.width, body.height) if kind in (IMAGE, CAMERA_INFO) else size
    times = {"first_ns": logged_ns, "last_ns": logged_ns, "stamp_ns": logged_ns + round(t_s * 1e9)}
    return TopicSummary(kind=kind, count=1, pixels=pixels, size=size, **times)


def roles(where: Path, found: Mapping[str, TopicSummary], named: Mapping[str, str], *, calibrated: bool) -> Topics:
    """Return the topic of each role: as named by the user, the rest by type.

    Args:
        calibrated: Whether the camera calibration is known without a CameraInfo message.

    Raises:
        SettingsError: If a named topic is not in the log, or is of another type.
        LogFormatError: If the log has no input for a replay, or the choice of a topic is ambiguous.
    """
    for role, name in named.items():
        _check_named(where, found, role, name)
    # A user-named headings topic replaces the images.
    depth = named.get("depth") or (None if "headings" in named else _depth(found))
    headings = named.get("headings")
    if headings is None and HEADINGS in found and found[HEADINGS].kind in KINDS_OF_ROLES["headings"]:
        headings = HEADINGS
    gyro, accel = (named["imu"], named.get("accel")) if "imu" in named else _imu(where, found)
    if depth is None:
        if headings is None:
            raise LogFormatError(f"{where}: neither depth images nor headings{compressed_hint(found)} (there are: {listed(found)})")
        return Topics(imu=gyro, accel=accel, headings=headings)
    color, info = image_topics(where, found, depth, named, calibrated=calibrated)
    return Topics(depth=depth, color=color, info=info, imu=gyro, accel=accel)


def image_topics(
    where: Path, found: Mapping[str, TopicSummary], depth: str, named: Mapping[str, str], *, calibrated: bool
) -> tuple[str | None, str | None]:
    """Return the topics of the colour images and of the calibration of a depth topic: as named by the user, else by type.

    Raises:
        LogFormatError: If there is no calibration, or an image or a calibration has another size than the depth images.
    """
    color = named.get("color") or _color(found, depth)
    if color is not None:
        _check_size(where, found, color, depth, "name a depth topic that is registered to colour: --topics depth=…")
    info = named.get("info") or _info(found, depth, color)
    if info is None and not calibrated:
        raise LogFormatError(
            f"{where}: no intrinsics: no CameraInfo next to {depth}; give --camera FILE with fx_px, fy_px, cx_px and cy_px, or "
            "name one (replay --topics info=…)"
        )
    if info is not None and not (calibrated and "info" not in named):
        _check_size(where, found, info, depth, "give --camera FILE, or name the calibration of that image (replay --topics info=…)")
    return color, info


def parse_topics(text: str | None) -> dict[str, str]:
    """Return topics by role from the option ``--topics depth=/a,imu=/b``.

    Raises:
        SettingsError: If a role is unknown or repeated.
    """
    named: dict[str, str] = {}
    allowed = [item.name for item in fields(Topics)]
    for part in text.split(",") if text is not None else ():
        role, sign, name = part.partition("=")
        if not sign or role.strip() not in allowed or not name.strip() or role.strip() in named:
            raise SettingsError(f"--topics: '{part}' is not one of {', '.join(allowed)} with a topic, as depth=/camera/depth/image")
        named[role.strip()] = name.strip()
    return named


def _check_size(where: Path, found: Mapping[str, TopicSummary], name: str, depth: str, remedy: str) -> None:
    if found[name].size != found[depth].size:
        sizes = " and ".join(f"{topic} {found[topic].size[0]}×{found[topic].size[1]}" for topic in (name, depth))
        raise LogFormatError(f"{where}: sizes differ: {sizes}; {remedy}")


def _check_named(where: Path, found: Mapping[str, TopicSummary], role: str, name: str) -> None:
    if name not in found:
        raise SettingsError(f"--topics {role}={name}: no such topic in {where} (there are: {listed(found)})")
    if found[name].kind not in KINDS_OF_ROLES[role]:
        raise SettingsError(f"--topics {role}={name}: holds {found[name].kind}; {role} must be {KINDS_OF_ROLES[role][0]}")
    allowed = {"depth": DEPTH_ENCODINGS, "color": COLOUR_ENCODINGS}.get(role)
    if allowed is not None and found[name].pixels not in allowed:
        raise SettingsError(f"--topics {role}={name}: its images are '{found[name].pixels}'; {role} must be {', '.join(allowed)}")


def _depth(found: Mapping[str, TopicSummary]) -> str | None:
    def rank(name: str) -> tuple[bool, bool, str]:
        return not any(word in name for word in REGISTERED), "depth" not in name, name

    return min(depth_topics(found), key=rank, default=None)


def depth_topics(found: Mapping[str, TopicSummary]) -> list[str]:
    """Return the topics with depth images."""
    images = [name for name, item in found.items() if item.kind == IMAGE and item.pixels in DEPTH_ENCODINGS]
    # Infrared images are 16-bit as well.
    return [name for name in images if "depth" in name or not any(word in name for word in ("infra", "/ir", "mono"))]


def _color(found: Mapping[str, TopicSummary], depth: str) -> str | None:
    """Return the colour images of the size of the depth images."""

    def rank(name: str) -> tuple[bool, bool, str]:
        return found[name].pixels in {"mono8", "8UC1"}, not any(word in name for word in ("color", "rgb")), name

    images = [name for name, item in found.items() if item.kind == IMAGE and item.pixels in COLOUR_ENCODINGS]
    return min((name for name in images if found[name].size == found[depth].size), key=rank, default=None)


def _info(found: Mapping[str, TopicSummary], depth: str, color: str | None) -> str | None:
    """Return the calibration next to the depth or the colour images, or the only one."""
    known = [name for name, item in found.items() if item.kind == CAMERA_INFO]
    for image in (depth, color):
        siblings = [name for name in known if image is not None and name.rpartition("/")[0] == image.rpartition("/")[0]]
        if siblings:
            return siblings[0]
    return known[0] if len(known) == 1 else None


def _imu(where: Path, found: Mapping[str, TopicSummary]) -> tuple[str | None, str | None]:
    """Return the IMU topic, or the gyro and accelerometer topics."""
    known = [name for name, item in found.items() if item.kind == IMU]
    best = [name for name in known if name.endswith(("/imu", "/imu/data"))] or known
    if len(best) > 1:
        gyros, accels = ([name for name in best if word in name] for word in ("gyro", "accel"))
        if len(gyros) == len(accels) == 1:
            return gyros[0], accels[0]
        raise LogFormatError(f"{where}: several IMU topics ({listed(best)}); name one: --topics imu={best[0]}")
    return (best[0] if best else None), None


def compressed_hint(found: Mapping[str, TopicSummary]) -> str:
    """Return how to make compressed images readable; empty without any."""
    names = [name for name, item in found.items() if item.kind == COMPRESSED]
    return f"; {names[0]} is compressed: republish it raw (ros2 run image_transport republish compressed raw)" if names else ""
