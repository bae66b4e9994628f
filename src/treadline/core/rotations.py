"""Rotations as matrices, unit quaternions (w, x, y, z) and rotation vectors."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

Rotation = Float[np.ndarray, "3 3"]
"""Rotation matrix."""
Vector3 = Float[np.ndarray, " 3"]
"""Coordinates in the axes of a frame."""


def rotation_x(angle_rad: float) -> Rotation:
    """Return the rotation about x; a positive angle turns y towards z."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rotation_y(angle_rad: float) -> Rotation:
    """Return the rotation about y; a positive angle turns z towards x and tips x (forward) down."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation_z(angle_rad: float) -> Rotation:
    """Return the rotation about z; a positive angle turns x towards y."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_of(quaternion: Sequence[float] | Float[np.ndarray, " 4"]) -> Rotation:
    """Return the rotation matrix of a unit quaternion (w, x, y, z)."""
    w, x, y, z = (float(q) for q in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def attitude_of(
    yaw_rad: Float[np.ndarray, "*T"], pitch_rad: Float[np.ndarray, "*T"], roll_rad: Float[np.ndarray, "*T"]
) -> Float[np.ndarray, "*T 4"]:
    """Return the unit quaternions (w, x, y, z) of B in W from yaw and the elevations of B's x axis (pitch) and y axis (roll).

    Rotation order: roll about B's x, then pitch, then yaw about the vertical, ``R_WB = Rz(yaw) Ry(-pitch) Rx(bank)`` with
    ``sin(bank) = sin(roll) / cos(pitch)``, because the y axis of a pitched chassis rises less than the chassis banks. Valid
    below a bank of 90°; rounding beyond it gives 90°.

    Args:
        yaw_rad: Direction of B's x axis about the vertical.
        pitch_rad: Elevation of B's x axis, front up positive.
        roll_rad: Elevation of B's y axis, left side up positive.
    """
    steepness = np.maximum(np.cos(pitch_rad), np.finfo(float).tiny)
    bank_rad = np.arcsin(np.clip(np.sin(roll_rad) / steepness, -1.0, 1.0))
    (cz, sz), (cy, sy), (cx, sx) = (
        (np.cos(0.5 * angle), np.sin(0.5 * angle)) for angle in (np.asarray(yaw_rad), -np.asarray(pitch_rad), bank_rad)
    )
    return np.stack(
        (
            cz * cy * cx + sz * sy * sx,
            cz * cy * sx - sz * sy * cx,
            cz * sy * cx + sz * cy * sx,
            sz * cy * cx - cz * sy * sx,
        ),
        axis=-1,
    )


def quaternion_of(R: Rotation) -> Float[np.ndarray, " 4"]:
    """Return the unit quaternion (w, x, y, z), w ≥ 0, of a rotation matrix."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    # Four equivalent forms (Shepperd, 1978); division by the largest element avoids cancellation.
    forms = (
        (1.0 + a + e + i, h - f, c - g, d - b),
        (h - f, 1.0 + a - e - i, b + d, c + g),
        (c - g, b + d, 1.0 - a + e - i, f + h),
        (d - b, c + g, f + h, 1.0 - a - e + i),
    )
    best = max(range(4), key=lambda k: forms[k][k])
    quaternion = np.array(forms[best])
    quaternion /= math.sqrt(float(quaternion @ quaternion))
    return quaternion if quaternion[0] >= 0.0 else -quaternion


UP = np.array([0.0, 0.0, 1.0])
"""Unit vector along z."""
UP.setflags(write=False)


def levelling(force: Vector3) -> Vector3:
    """Return the rotation vector of the shortest rotation of a force onto +z."""
    axis = np.cross(force, UP)
    sine, cosine = float(np.linalg.norm(axis)), float(force @ UP)
    if sine < 1e-12 * abs(cosine):
        return np.array([0.0 if cosine > 0.0 else np.pi, 0.0, 0.0])
    return axis * (np.arctan2(sine, cosine) / sine)


def rotation_about(vector: Vector3) -> Rotation:
    """Return the rotation matrix of a rotation vector, whose length is the angle (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K)
