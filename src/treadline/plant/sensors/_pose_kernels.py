"""Ground truth from the pose of a chair, and rotations, compiled."""

import math
from typing import NamedTuple

import numpy as np

from treadline.core.fma import dot, fused
from treadline.core.kernel_cache import njit

_TURN = ("half_gauge", "zero", "raises", "stays", "follows", "kg", "share")
SECTION = np.dtype([("start", float, 2), ("length", float), ("radii", float, 2)] + [(name, float) for name in _TURN])
"""Section of the belts: axis of its start, length, radii at start and end, half gauge, direction at a zero joint, sign of a turn,
angle at which it stays, whether it turns with the flipper, mass, place of its centre of mass as a share of its length."""


class ChairNumbers(NamedTuple):
    """Parameters of a loaded chair for ``truth``."""

    half_run: float
    hinge: tuple[float, float, float]
    """Origin of the payload's frame, with the seat shift."""
    seat_kg: float
    """Mass of seat and payload."""
    chassis_kg: float
    chassis: tuple[float, float, float]
    """Centre of mass of the chassis."""


@njit(cache=True)
def truth(
    R_SW,
    p_WS,
    R_WB,
    p_WB,
    rate,
    seat_angle,
    flipper_angle,
    reach,
    place,
    reaches,
    edges_W,
    surfaces,
    chair,
    sections,
    seated,
    loaded,
    rocking,
    up_W,
):
    """Return the ground truth derived from a simulated chair's pose.

    Heading, yaw, heading rate, pitch, roll, x and y on the stair, seat pitch, tip-over margin, x, y and z of the passenger in W.

    Args:
        rate: Angular velocity in B.
        flipper_angle: Angle of the flipper.
        reach: Reach of the belt contacts of this tick; stored in row ``place`` of ``reaches``, or in all rows if ``place`` is
            negative.
        sections: records ``SECTION``.
        seated: Centre of the payload from the hinge in the seat frame, without sway; ``loaded``: with sway.
        rocking: Tangent of the angle by which the chair may turn onto ground for it to count as support.
        up_W: Unit vector against gravity: z of W, except on a stair that falls to a side.
    """
    heading, heading_rate, x, y = on_stair(R_SW, p_WS, R_WB, p_WB, rate)
    forward_z, left_z, up_z = dot(R_WB[:, 0], up_W), dot(R_WB[:, 1], up_W), dot(R_WB[:, 2], up_W)
    c, s = math.cos(seat_angle), math.sin(seat_angle)

    if place < 0:
        reaches[:] = reach
    else:
        reaches[place] = reach
    # Contacts of a rocking chair are intermittent: the recent ones count.
    touches, tail, left, right = reaches[:, 0].max(), reaches[:, 1].max(), reaches[:, 2].max(), reaches[:, 3].max()
    front, rear = support(touches, tail, edges_W, p_WB, R_WB, chair.half_run, rocking)
    kg = chair.chassis_kg
    com_x, com_y, com_z = kg * chair.chassis[0], kg * chair.chassis[1], kg * chair.chassis[2]
    for row in sections:
        turned = row["zero"] + row["raises"] * (flipper_angle if row["follows"] > 0.5 else row["stays"])
        (start_x, start_z), length, share = row["start"], row["length"], row["share"]
        end_x, end_z = start_x + length * math.cos(turned), start_z + length * math.sin(turned)
        for pulley_x, pulley_z, radius in ((start_x, start_z, row["radii"][0]), (end_x, end_z, row["radii"][1])):
            ahead, gap = pulley_gap(surfaces, pulley_x, pulley_z, row["half_gauge"], radius, p_WB, R_WB)
            if touches > -math.inf and gap <= rocking * (ahead - touches):
                front = max(front, ahead)
            if tail > -math.inf and gap <= rocking * (-ahead - tail):
                rear = max(rear, -ahead)
        kg += row["kg"]
        com_x += row["kg"] * ((1.0 - share) * start_x + share * end_x)
        com_z += row["kg"] * ((1.0 - share) * start_z + share * end_z)
    com_x, com_y, com_z = com_x / kg, com_y / kg, com_z / kg
    payload, seat_kg = np.empty(3), chair.seat_kg
    _on_seat(chair, loaded, c, s, payload)
    total = kg + seat_kg
    com_x = (kg * com_x + seat_kg * payload[0]) / total
    com_y = (kg * com_y + seat_kg * payload[1]) / total
    com_z = (kg * com_z + seat_kg * payload[2]) / total
    lengthwise, sidewise = math.atan2(forward_z, up_z), math.atan2(left_z, up_z)
    margin = min(
        math.atan2(front - com_x, com_z) + lengthwise,
        math.atan2(rear + com_x, com_z) - lengthwise,
        math.atan2(left - com_y, com_z) + sidewise,
        math.atan2(right + com_y, com_z) - sidewise,
    )

    _on_seat(chair, seated, c, s, payload)
    return (
        heading,
        math.atan2(R_WB[1, 0], R_WB[0, 0]),
        heading_rate,
        _arcsine(forward_z),
        _arcsine(left_z),
        x,
        y,
        _arcsine(forward_z * c - up_z * s),
        margin,
        p_WB[0] + dot(R_WB[0], payload),
        p_WB[1] + dot(R_WB[1], payload),
        p_WB[2] + dot(R_WB[2], payload),
    )


@njit(cache=True)
def on_stair(R_SW, p_WS, R_WB, p_WB, rate):
    """Return heading, heading rate about the normal of the nosing plane, and position of B along and across the stair."""
    R_SB = product(R_SW, R_WB)
    place = p_WB - p_WS
    # The heading is about the chair's z axis: the normal of the nosing plane on the flight, the vertical on floor and landing.
    heading = math.atan2(R_SB[1, 0], R_SB[1, 1])
    return heading, dot(R_SB[2], rate), dot(R_SW[0], place), dot(R_SW[1], place)


@njit(cache=True)
def support(front, rear, edges_W, p_WB, R_WB, half_run, rocking):
    """Return the reach of the belts' support from B, to front and rear: contacts, and the edges onto which the chair can rock.

    Args:
        front: Reach of the belts' contacts to the front; ``rear``: to the rear.
        edges_W: Axes of the ground's rounded edges and their radii, one row each.
        half_run: Half the length of the belts' flat run.
        rocking: Tangent of the angle by which the chair may turn about the contact until it lies on an edge.
    """
    ahead, behind = front, rear
    for edge_W in edges_W:
        place = edge_W[:3] - p_WB
        x, z = dot(place, R_WB[:, 0]), dot(place, R_WB[:, 2]) + edge_W[3]
        if abs(x) < half_run:
            if front > -math.inf and abs(z) <= rocking * (x - front):
                ahead = max(ahead, x)
            if rear > -math.inf and abs(z) <= rocking * (-x - rear):
                behind = max(behind, -x)
    return ahead, behind


@njit(cache=True)
def pulley_gap(surfaces, pulley_x, pulley_z, half_gauge, radius, p_WB, R_WB):
    """Return the distance ahead of B of the lowest point of a pair of pulleys, and its gap to the ground; the smaller of the two.

    Args:
        surfaces: Flat tops, one row each: centre x, y, cosine and sine of the yaw, half length, half width, height,
            rise per metre.
        pulley_x: Axis of the pulleys in B, and ``pulley_z`` the same, vertical.
    """
    gap = math.inf
    for side in (-1.0, 1.0):
        axis = np.array((pulley_x, side * half_gauge, pulley_z))
        x, y, z = p_WB[0] + dot(R_WB[0], axis), p_WB[1] + dot(R_WB[1], axis), p_WB[2] + dot(R_WB[2], axis)
        for row in surfaces:
            dx, dy = x - row[0], y - row[1]
            along, across = fused(row[2], dx, row[3] * dy), fused(row[2], dy, -(row[3] * dx))
            # A tread above the axis (open risers) gives no support.
            height = fused(row[7], along, row[6])
            if abs(along) <= row[4] and abs(across) <= row[5] and height < z:
                gap = min(gap, z - radius - height)
    return pulley_x - radius * R_WB[2, 0], gap  # the lowest point, below the axis in W


@njit(cache=True)
def _on_seat(chair, centre, c, s, place):
    """Fill ``place`` with a point of the seat in B: ``mechanics.stability.payload_place``, compiled."""
    x, y, z = chair.hinge
    place[0] = x + c * centre[0] + s * centre[2]
    place[1] = y + centre[1]
    place[2] = z - s * centre[0] + c * centre[2]


@njit(cache=True)
def _arcsine(value):
    """Return the arcsine of a component of a unit vector, clamped against rounding."""
    return math.asin(max(-1.0, min(1.0, value)))


@njit(cache=True)
def product(A, B):
    """Return the product of two matrices."""
    C = np.empty((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            C[i, j] = dot(A[i], B[:, j])
    return C


@njit(cache=True)
def rotation(w, x, y, z, R):
    """Write the rotation matrix of a unit quaternion: ``angles.rotation_of``, compiled."""
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


@njit(cache=True)
def quaternion(R):
    """Return the unit quaternion (w, x, y, z), w ≥ 0, of a rotation matrix: ``angles.quaternion_of``, compiled."""
    a, b, c, d, e, f, g, h, i = R[0, 0], R[0, 1], R[0, 2], R[1, 0], R[1, 1], R[1, 2], R[2, 0], R[2, 1], R[2, 2]
    first, second, third, fourth = 1.0 + a + e + i, 1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i
    largest = max(first, second, third, fourth)
    if first == largest:
        q = np.array((first, h - f, c - g, d - b))
    elif second == largest:
        q = np.array((h - f, second, b + d, c + g))
    elif third == largest:
        q = np.array((c - g, b + d, third, f + h))
    else:
        q = np.array((d - b, c + g, f + h, fourth))
    q /= math.sqrt(dot(q, q))
    return q if q[0] >= 0.0 else -q
