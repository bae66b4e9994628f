"""What is in a log, and which of its topics is the chair's depth camera, colour camera, calibration and IMU.

Topics are told apart by message type, images by their encoding; names decide only between equals. ``--topics`` overrules it.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path

from treadline.errors import LogFormatError, SettingsError
from treadline.io.bags import READERS, damage, parts_of
from treadline.io.decode import HEADINGS, IMU, OURS, CdrReader, Ros1Reader, calibration, heading_of_image, imu
from treadline.io.mcap_read import mcap_messages
from treadline.io.ros_types import Packet, Topic
from treadline.io.tables import listed

IMAGE, CAMERA_INFO, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/CompressedImage"
DEPTH_ENCODINGS = ("16UC1", "32FC1", "mono16")
COLOUR_ENCODINGS = ("rgb8", "bgr8", "rgba8", "bgra8", "8UC3", "mono8", "8UC1")
REGISTERED = ("aligned", "registered")
"""Words in the name of a depth topic whose pixels are those of the colour camera."""


@dataclass(slots=True, kw_only=True)
class Found:
    """One topic of a log."""

    kind: str
    encoding: str
    count: int
    first_ns: int
    last_ns: int
    stamp_ns: int
    """Of its first message; the time of logging where none is set."""
    pixels: str = ""
    """Encoding of its first image."""
    size: tuple[int, int] = (0, 0)
    """Width and height of its first image or calibration."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Topics:
    """Which topic is what; None is not in the log."""

    depth: str | None = None
    color: str | None = None
    info: str | None = None
    imu: str | None = None
    accel: str | None = None
    """Of an IMU whose gyro and accelerometer have a topic each."""
    headings: str | None = None
    """Headings that vision saw at the time; they stand in for images."""


KINDS = {"depth": IMAGE, "color": IMAGE, "info": CAMERA_INFO, "imu": IMU, "accel": IMU, "headings": OURS[HEADINGS][0]}


def packets(path: Path, wants: Callable[[str], bool], *, sealed: bool) -> Iterator[Packet]:
    """Yield the messages of a log of any kind.

    Raises:
        LogFormatError: If it is missing, broken, or no log.
    """
    if not path.exists():
        raise LogFormatError(f"{path}: no such file")
    files = parts_of(path)
    if not files or files[0].suffix.lower() not in READERS:
        raise LogFormatError(f"{path}: no log of messages; give a run folder, or a file or folder of {', '.join(READERS)}")
    for file in files:
        with damage(file):
            yield from mcap_messages(file, wants, sealed=True) if sealed else READERS[file.suffix.lower()](file, wants)


def reader_of(topic: Topic, data: bytes, logged_ns: int, origin_ns: int = 0) -> CdrReader:
    """Return what takes a message apart."""
    kind = Ros1Reader if topic.encoding == "ros1" else CdrReader
    return kind(data, origin_ns=origin_ns, logged_ns=logged_ns)


def kind_of(topic: Topic) -> str:
    """Return a type's name as ROS 2 writes it; what is not ROS's is none of its types."""
    if topic.encoding not in {"cdr", "ros1"}:
        return f"{topic.encoding} {topic.kind}"
    package, *between = topic.kind.split("/")
    return f"{package}/msg/{between[-1]}" if between else package


def survey(path: Path, *, sealed: bool) -> dict[str, Found]:
    """Return the topics of a log, having read it to its end: a broken file is told before anything is made of it."""
    found: dict[str, Found] = {}
    for topic, logged_ns, data in packets(path, lambda _: True, sealed=sealed):
        here = found.get(topic.name)
        if here is None:
            with damage(path):
                found[topic.name] = _first(topic, logged_ns, data)
        else:
            here.count += 1
            here.last_ns = max(here.last_ns, logged_ns)
    return found


def _first(topic: Topic, logged_ns: int, data: bytes) -> Found:
    kind, pixels, size, t_s = kind_of(topic), "", (0, 0), 0.0

    def reader() -> CdrReader:
        # Its own clock as origin: seconds since 1970 have no nanoseconds to spare.
        return reader_of(topic, data, logged_ns, origin_ns=logged_ns)

    if kind == IMAGE:
        t_s, height, width, pixels = heading_of_image(reader())
        size = width, height
    elif kind == CAMERA_INFO:
        t_s, camera = calibration(reader())
        size = camera.width_px, camera.height_px
    elif kind == IMU:
        t_s = imu(reader()).t_s
    elif topic.name in OURS and kind == OURS[topic.name][0]:
        t_s = OURS[topic.name][1](reader()).t_s
    stamp_ns = logged_ns + round(t_s * 1e9)
    return Found(
        kind=kind,
        encoding=topic.encoding,
        count=1,
        first_ns=logged_ns,
        last_ns=logged_ns,
        stamp_ns=stamp_ns,
        pixels=pixels,
        size=size,
    )


def roles(where: Path, found: Mapping[str, Found], named: Mapping[str, str], *, calibrated: bool) -> Topics:
    """Return which topic is what: as named, the rest by type.

    Args:
        calibrated: Whether the camera is known without a CameraInfo.

    Raises:
        SettingsError: If a name is not in the log, or is of another type.
        LogFormatError: If there is nothing to replay, or several topics could be meant.
    """
    for role, name in named.items():
        _check_named(where, found, role, name)
    # Who names headings wants them instead of images.
    depth = named.get("depth") or (None if "headings" in named else _depth(found))
    headings = named.get("headings") or (HEADINGS if HEADINGS in found and found[HEADINGS].kind == KINDS["headings"] else None)
    gyro, accel = (named["imu"], named.get("accel")) if "imu" in named else _imu(where, found)
    if depth is None:
        if headings is None:
            raise LogFormatError(
                f"{where}: neither depth images nor headings seen{_compressed(found)} (there are: {listed(found)})"
            )
        return Topics(imu=gyro, accel=accel, headings=headings)
    color = named.get("color") or _color(found, depth)
    if color is not None and found[color].size != found[depth].size:
        sizes = " and ".join(f"{name} {found[name].size[0]}×{found[name].size[1]}" for name in (color, depth))
        raise LogFormatError(f"{where}: sizes differ: {sizes}; name a depth topic that is registered to colour: --topics depth=…")
    info = named.get("info") or _info(found, depth, color)
    if info is None and not calibrated:
        raise LogFormatError(
            f"{where}: no intrinsics: no CameraInfo beside {depth}; name one (--topics info=…) or --set camera.fx_px, fy_px, "
            "cx_px and cy_px"
        )
    if info is not None and found[info].size != found[depth].size:
        sizes = " and ".join(f"{name} {found[name].size[0]}×{found[name].size[1]}" for name in (info, depth))
        raise LogFormatError(f"{where}: sizes differ: {sizes}; name the calibration of that image: --topics info=…")
    return Topics(depth=depth, color=color, info=info, imu=gyro, accel=accel)


def parse_topics(text: str | None) -> dict[str, str]:
    """Return topics by role, as ``--topics depth=/a,imu=/b`` names them.

    Raises:
        SettingsError: If a role is unknown or named twice.
    """
    named: dict[str, str] = {}
    allowed = [item.name for item in fields(Topics)]
    for part in text.split(",") if text is not None else ():
        role, sign, name = part.partition("=")
        if not sign or role.strip() not in allowed or not name.strip() or role.strip() in named:
            raise SettingsError(f"--topics: '{part}' is not one of {', '.join(allowed)} with a topic, as depth=/camera/depth/image")
        named[role.strip()] = name.strip()
    return named


def _check_named(where: Path, found: Mapping[str, Found], role: str, name: str) -> None:
    if name not in found:
        raise SettingsError(f"--topics {role}={name}: no such topic in {where} (there are: {listed(found)})")
    if found[name].kind != KINDS[role]:
        raise SettingsError(f"--topics {role}={name}: holds {found[name].kind}; {role} must be {KINDS[role]}")
    allowed = {"depth": DEPTH_ENCODINGS, "color": COLOUR_ENCODINGS}.get(role)
    if allowed is not None and found[name].pixels not in allowed:
        raise SettingsError(f"--topics {role}={name}: its images are '{found[name].pixels}'; {role} must be {', '.join(allowed)}")


def _depth(found: Mapping[str, Found]) -> str | None:
    def rank(name: str) -> tuple[bool, bool, str]:
        return not any(word in name for word in REGISTERED), "depth" not in name, name

    images = [name for name, item in found.items() if item.kind == IMAGE and item.pixels in DEPTH_ENCODINGS]
    # An infrared image has sixteen bits, too.
    images = [name for name in images if "depth" in name or not any(word in name for word in ("infra", "/ir", "mono"))]
    return min(images, key=rank, default=None)


def _color(found: Mapping[str, Found], depth: str) -> str | None:
    def rank(name: str) -> tuple[bool, bool, str]:
        return found[name].pixels in {"mono8", "8UC1"}, not any(word in name for word in ("color", "rgb")), name

    images = [name for name, item in found.items() if item.kind == IMAGE and item.pixels in COLOUR_ENCODINGS]
    return min((name for name in images if found[name].size == found[depth].size), key=rank, default=None)


def _info(found: Mapping[str, Found], depth: str, color: str | None) -> str | None:
    known = [name for name, item in found.items() if item.kind == CAMERA_INFO]
    for image in (depth, color):
        beside = [name for name in known if image is not None and _parent(name) == _parent(image)]
        if beside:
            return beside[0]
    return known[0] if len(known) == 1 else None


def _imu(where: Path, found: Mapping[str, Found]) -> tuple[str | None, str | None]:
    """Return the topic of the IMU, or of its gyro and of its accelerometer."""
    known = [name for name, item in found.items() if item.kind == IMU]
    best = [name for name in known if name.endswith(("/imu", "/imu/data"))] or known
    if len(best) > 1:
        gyros, accels = ([name for name in best if word in name] for word in ("gyro", "accel"))
        if len(gyros) == len(accels) == 1:
            return gyros[0], accels[0]
        raise LogFormatError(f"{where}: several IMU topics ({listed(best)}); name one: --topics imu={best[0]}")
    return (best[0] if best else None), None


def _compressed(found: Mapping[str, Found]) -> str:
    names = [name for name, item in found.items() if item.kind == COMPRESSED]
    return f"; {names[0]} is compressed: republish it raw (ros2 run image_transport republish compressed raw)" if names else ""


def _parent(topic: str) -> str:
    return topic.rpartition("/")[0]
