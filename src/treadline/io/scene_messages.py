"""ROS messages that place and draw a scene: frames, odometry, joint angles, markers, robot description, compressed images.

``transforms, meshes, lines -> RosMessage``. No block reads them: they are for RViz, Foxglove and PlotJuggler.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.camera_images import CAMERA_AXES_IN_CHAIR, PinholeCamera
from treadline.core.rotations import quaternion_of
from treadline.core.signals import Vector
from treadline.io.message_types import RosMessage, stamp
from treadline.io.messages import COMPRESSED, camera_name, optical_frame
from treadline.vehicle.appearance import MeshPart

BASE = "base_link"
"""Name of the chair's frame B in its URDF."""
FRAMES = "tf2_msgs/msg/TFMessage"
ODOMETRY = "nav_msgs/msg/Odometry"
MARKERS = "visualization_msgs/msg/MarkerArray"
TEXT = "std_msgs/msg/String"
LINE_LIST, TEXT_FACING, TRIANGLE_LIST = 5, 9, 11
"""Types of a visualization_msgs/Marker."""
ADD, DELETE_ALL = 0, 3
"""Actions of a visualization_msgs/Marker."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FramePose:
    """Pose of a frame in its parent."""

    parent: str
    child: str
    place_m: tuple[float, ...]
    quaternion: Sequence[float] | Float[np.ndarray, " 4"] = (1.0, 0.0, 0.0, 0.0)
    """Rotation (w, x, y, z); parallel to the parent if left out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marker:
    """Triangles, lines or a text of one colour in a frame."""

    frame: str
    name: str
    number: int
    """Number within the markers of one name; a later marker with equal name and number replaces this one."""
    kind: int
    points_m: Float[np.ndarray, "n 3"]
    """Corners of triangles, or ends of lines, in order; of a text its place."""
    rgba: tuple[float, float, float, float]
    width_m: float = 1.0
    """Width of lines, height of a text; triangles have a scale of 1."""
    text: str = ""
    action: int = ADD


CLEAR = Marker(frame=BASE, name="", number=0, kind=0, points_m=np.zeros((0, 3)), rgba=(0.0,) * 4, action=DELETE_ALL)
"""Removes all markers of a topic; those that follow it in one message are drawn."""


def marker_of(part: MeshPart, frame: str) -> Marker:
    """Return a mesh as a marker in a frame."""
    points = part.vertices_m[part.faces].reshape(-1, 3).astype(float)
    return Marker(frame=frame, name=part.name, number=0, kind=TRIANGLE_LIST, points_m=points, rgba=(*part.colour, part.opacity))


def frames_message(topic: str, t_s: float, poses: Sequence[FramePose]) -> RosMessage:
    """Return a TFMessage."""
    values = [value for pose in poses for value in (*stamp(t_s), pose.parent, pose.child, *_numbers(pose))]
    return RosMessage(topic, FRAMES, (len(poses), *values), (len(poses),))


def camera_frames(camera: PinholeCamera) -> list[FramePose]:
    """Return the frames of a camera on the chair as in the URDF: its link, and its optical frame."""
    name, R = camera_name(camera), camera.R_BC @ CAMERA_AXES_IN_CHAIR.T
    axes = quaternion_of(CAMERA_AXES_IN_CHAIR)
    return [
        FramePose(parent="chair", child=f"{name}_link", place_m=camera.mount_m, quaternion=quaternion_of(R)),
        FramePose(parent=f"{name}_link", child=optical_frame(name), place_m=(0.0, 0.0, 0.0), quaternion=axes),
    ]


def _numbers(pose: FramePose) -> tuple[float, ...]:
    """Return position and rotation (x, y, z, w) of a pose."""
    qw, *q = map(float, pose.quaternion)
    return (*pose.place_m, *q, qw)


def odometry_message(topic: str, t_s: float, pose: FramePose, speed_m_s: float, angular_velocity_rad_s: Vector) -> RosMessage:
    """Return an Odometry message; covariances are zeros: unknown."""
    unknown = (0.0,) * 36
    moved, turned = (*_numbers(pose), *unknown), (speed_m_s, 0.0, 0.0, *angular_velocity_rad_s, *unknown)
    return RosMessage(topic, ODOMETRY, (*stamp(t_s), pose.parent, pose.child, *moved, *turned))


def markers_message(topic: str, t_s: float, markers: Sequence[Marker]) -> RosMessage:
    """Return a MarkerArray; its markers move with their frames and stay until they are replaced."""
    values = [value for marker in markers for value in _marker(t_s, marker)]
    lengths = [count for marker in markers for count in (0 if marker.text else len(marker.points_m), 0, 0)]
    return RosMessage(topic, MARKERS, (len(markers), *values), (len(markers), *lengths))


def text_message(topic: str, text: str) -> RosMessage:
    """Return a String."""
    return RosMessage(topic, TEXT, (text,))


def compressed_message(topic: str, t_s: float, frame: str, jpeg: bytes) -> RosMessage:
    """Return a CompressedImage from a JPEG file."""
    return RosMessage(topic, COMPRESSED, (*stamp(t_s), frame, "jpeg", jpeg))


def _marker(t_s: float, marker: Marker) -> list[Any]:
    """Return the values of a visualization_msgs/Marker."""
    across = 1.0 if marker.kind == TRIANGLE_LIST else 0.0
    origin, points = ((0.0,) * 3, marker.points_m) if not marker.text else (marker.points_m[0].tolist(), marker.points_m[:0])
    place, scale = (*origin, *(0.0,) * 3, 1.0), (marker.width_m, across, marker.width_m if marker.text else across)
    for_good, locked, plain = (0, 0), True, 0
    image, mesh = (*stamp(0.0), "", "", b""), ("", "", b"", False)
    texture = ("", *image, 0, marker.text)
    return [
        *(*stamp(t_s), marker.frame, marker.name, marker.number, marker.kind, marker.action),
        *(*place, *scale, *marker.rgba, *for_good, locked),
        *(len(points), *points.ravel().tolist(), plain, *texture, *mesh),
    ]
