"""ROS messages that place and draw a scene: frames, odometry, joint angles, markers, robot description, compressed images.

``transforms, meshes, lines -> topic, type, bytes``. No block reads them: they are for RViz, Foxglove and PlotJuggler.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from treadline.core.signals import Vector
from treadline.io.cdr import CdrWriter, MessageForm
from treadline.io.messages import Message, Writer
from treadline.vehicle.appearance import MeshPart

BASE = "base_link"
"""Name of the chair's frame B in its URDF."""
FRAMES = "tf2_msgs/msg/TFMessage"
ODOMETRY = "nav_msgs/msg/Odometry"
MARKERS = "visualization_msgs/msg/MarkerArray"
LINE_LIST, TRIANGLE_LIST = 5, 11
"""Types of a visualization_msgs/Marker."""
Rgba = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FramePose:
    """Pose of a frame in its parent."""

    parent: str
    child: str
    place_m: tuple[float, ...]
    quaternion: Sequence[float] | Float[np.ndarray, " 4"]
    """Rotation (w, x, y, z)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marker:
    """Triangles or lines of one colour in a frame."""

    frame: str
    name: str
    number: int
    """Number within the markers of one name; a later marker with equal name and number replaces this one."""
    kind: int
    points_m: Float[np.ndarray, "n 3"]
    """Corners of triangles, or ends of lines, in order."""
    rgba: Rgba
    width_m: float = 1.0
    """Width of lines; triangles have a scale of 1."""


def marker_of(part: MeshPart, frame: str) -> Marker:
    """Return a mesh as a marker in a frame."""
    points = part.vertices_m[part.faces].reshape(-1, 3).astype(float)
    return Marker(frame=frame, name=part.name, number=0, kind=TRIANGLE_LIST, points_m=points, rgba=(*part.colour, part.opacity))


def frames_message(topic: str, t_s: float, poses: Sequence[FramePose], writer: Writer = CdrWriter) -> Message:
    """Return a TFMessage."""
    form = _frames_form(tuple((pose.parent, pose.child) for pose in poses), writer)
    return topic, FRAMES, form.pack(t_s, *[_numbers(pose) for pose in poses])


@lru_cache(maxsize=64)  # a log has two: fixed and moving frames
def _frames_form(names: tuple[tuple[str, str], ...], writer: Writer) -> MessageForm:
    w = writer()
    w.uint32(len(names))
    for parent, child in names:
        w.open_time()
        w.string(parent)
        w.string(child)
        w.open_doubles(7)
    return w.form()


def _numbers(pose: FramePose) -> tuple[float, ...]:
    """Return position and rotation (x, y, z, w) of a pose."""
    qw, *q = map(float, pose.quaternion)
    return (*pose.place_m, *q, qw)


def odometry_message(
    topic: str,
    t_s: float,
    pose: FramePose,
    speed_m_s: float,
    angular_velocity_rad_s: Vector,
    writer: Writer = CdrWriter,
) -> Message:
    """Return an Odometry message; covariances are zeros: unknown."""
    form = _odometry_form(pose.parent, pose.child, writer)
    return topic, ODOMETRY, form.pack(t_s, _numbers(pose), (speed_m_s,), angular_velocity_rad_s)


@lru_cache(maxsize=64)  # a log has one
def _odometry_form(parent: str, child: str, writer: Writer) -> MessageForm:
    w = writer()
    w.open_time()
    w.string(parent)
    w.string(child)
    w.open_doubles(7)
    w.doubles(*[0.0] * 36)
    w.open_doubles(1)
    w.doubles(0.0, 0.0)
    w.open_doubles(3)
    w.doubles(*[0.0] * 36)
    return w.form()


def markers_message(topic: str, t_s: float, markers: Sequence[Marker]) -> Message:
    """Return a MarkerArray; its markers move with their frames and stay until they are replaced."""
    w = CdrWriter()
    w.uint32(len(markers))
    for marker in markers:
        _marker(w, t_s, marker)
    return topic, MARKERS, w.message()


def text_message(topic: str, text: str) -> Message:
    """Return a String."""
    w = CdrWriter()
    w.string(text)
    return topic, "std_msgs/msg/String", w.message()


def compressed_message(topic: str, t_s: float, frame: str, jpeg: bytes) -> Message:
    """Return a CompressedImage from a JPEG file."""
    w = CdrWriter()
    w.stamp(t_s, frame)
    w.string("jpeg")
    w.raw(jpeg)
    return topic, "sensor_msgs/msg/CompressedImage", w.message()


def _marker(w: CdrWriter, t_s: float, marker: Marker) -> None:
    w.stamp(t_s, marker.frame)
    w.string(marker.name)
    w.int32(marker.number)
    w.int32(marker.kind)
    w.int32(0)  # add or replace
    across = 1.0 if marker.kind == TRIANGLE_LIST else 0.0
    w.doubles(*[0.0] * 6, 1.0, marker.width_m, across, across)
    w.floats(*marker.rgba)
    w.int32(0)  # no lifetime
    w.uint32(0)
    w.uint8(1)  # moves with its frame
    w.uint32(len(marker.points_m))
    if len(marker.points_m):
        w.array(marker.points_m)
    w.uint32(0)  # no colour of each point
    w.string("")  # no texture, and an empty image for it
    w.stamp(0.0, "")
    w.string("")
    w.uint32(0)
    w.uint32(0)
    w.string("")  # no text
    w.string("")  # no mesh file
    w.string("")
    w.uint32(0)
    w.uint8(0)
