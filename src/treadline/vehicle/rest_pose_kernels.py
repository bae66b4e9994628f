"""Compiled core of ``rest_poses``: contact of capsules with a polyline, the pitch at rest, and a pose followed along a move.

All in the vertical plane through the chair's middle: x along the drive, z up, pitch nose up. A chair is rows of ``parts``
(``PART``), rows of ``masses`` (``MASS``) and one angle per moving part; with the angles set it is a ``posture``. The ground is rows
of vertices (x, z, radius).
"""

import math
from typing import Any

import numpy as np

from treadline.core.kernel_cache import njit
from treadline.scenario.chair import GRAVITY_M_S2

PART = ("x_m", "z_m", "length_m", "radius_m", "end_radius_m", "offset_rad", "sign", "joint", "motor")
"""Columns of a part: a tapered capsule from a point in B over a length, with radii at its two ends, at ``offset + sign · angle``
to the flat run, by the angle of its joint, and the motor that bears it; joint -1 for a part that does not move. Parts that do not
move come first. Several parts may follow one joint, each by a motor of its own."""
MASS = ("kg", "x_m", "z_m", "part", "", "", "")
"""Columns of a mass: its place in B with part -1, or on the axis of a part at a distance from its start. The last row is the seat
with its load: kg, hinge (x, z), place from the hinge (x, z), and the range of its angle [rad]."""
STEP_RAD = math.radians(0.5)
"""Step of the search for the next pose at rest [rad]: below the smallest angle between two rest poses, about 0.7°."""
HALVINGS = 8
"""Halvings of a step of the search: 0.5° becomes 0.002°."""
LOW_RAD, HIGH_RAD = math.radians(-60.0), math.radians(75.0)
"""Range of the pitch that is searched [rad]; a chair beyond it has tipped over."""
JUMP_RAD = math.radians(0.5)
"""Change of the pitch within a move above which the move is divided [rad]."""
LEAST_PART = 1.0 / 16.0
"""Smallest part of a move: a pitch that changes by ``JUMP_RAD`` in it has lost its rest pose."""
WALL_M = 0.005
"""Height by which the smallest part of a move lifts a chair that has met a wall [m]: a belt at 75° lifts it by a millimetre."""
RESTS, TURNS_OVER, BLOCKED = 0, 1, 2
"""Ends of a move."""
SUPPORT_RAD = math.radians(2.0)
"""Angle by which a chair may turn onto the ground for that ground to count as its support [rad]."""


@njit(cache=True)
def posture(angles: Any, parts: Any, masses: Any) -> tuple[Any, Any]:
    """Return the axes of the capsules in B at the joints' angles, and what weighs.

    Returns:
        Rows (start x, z, end x, z, radius at the start and at the end, motor), and (kg, x, z of all that turns with the chassis;
        kg, hinge x, z, place x, z of the seat; range of its angle).
    """
    body, weighs = np.empty((parts.shape[0], 7)), np.zeros(10)
    for k in range(parts.shape[0]):
        joint = int(parts[k, 7])
        turn = parts[k, 5] + (parts[k, 6] * angles[joint] if joint >= 0 else 0.0)
        body[k, 0], body[k, 1], body[k, 4], body[k, 5] = parts[k, 0], parts[k, 1], parts[k, 3], parts[k, 4]
        body[k, 6] = parts[k, 8] if joint >= 0 else -1.0
        body[k, 2] = parts[k, 0] + parts[k, 2] * math.cos(turn)
        body[k, 3] = parts[k, 1] + parts[k, 2] * math.sin(turn)
    last = masses.shape[0] - 1
    for k in range(last):
        x, z, part = masses[k, 1], masses[k, 2], int(masses[k, 3])
        if part >= 0:
            share = x / parts[part, 2]
            x = body[part, 0] + share * (body[part, 2] - body[part, 0])
            z = body[part, 1] + share * (body[part, 3] - body[part, 1])
        weighs[0] += masses[k, 0]
        weighs[1] += masses[k, 0] * x
        weighs[2] += masses[k, 0] * z
    weighs[1] /= weighs[0]
    weighs[2] /= weighs[0]
    weighs[3:] = masses[last]
    return body, weighs


@njit(cache=True)
def contact(
    th: float, x: float, body: Any, weighs: Any, ground: Any, used: int
) -> tuple[float, float, float, float, float, float, int, float]:
    """Return the one contact of a chair that is let down at a pitch.

    Args:
        used: Number of parts that may touch, the first ones.

    Returns:
        Lever of the weight ahead of the contact (positive turns the nose down), centre of mass (x, z), contact (x, z), tangent of
        the slope of the ground at the contact, the part that touches, and the height of B's origin.
    """
    c, s = math.cos(th), math.sin(th)
    top, cx, cz, slope, on = -1e9, 0.0, 0.0, 0.0, -1
    n = ground.shape[0]
    for k in range(used):
        ra, rb = body[k, 4], body[k, 5]
        ax, az = x + c * body[k, 0] - s * body[k, 1], s * body[k, 0] + c * body[k, 1]
        bx, bz = x + c * body[k, 2] - s * body[k, 3], s * body[k, 2] + c * body[k, 3]
        if bx < ax:
            ax, az, bx, bz, ra, rb = bx, bz, ax, az, rb, ra
        wide, high = bx - ax, bz - az
        length = math.hypot(wide, high)
        # Normal of the straight part below, which touches both circles: nx (bx - ax) + nz (bz - az) = ra - rb.
        tilt = min(max((ra - rb) / length, -1.0), 1.0)
        level = math.sqrt(1.0 - tilt * tilt)
        nx, nz = (level * high + tilt * wide) / length, (tilt * high - level * wide) / length
        r = max(ra, rb)
        first, behind = 0, n
        while first < behind:
            mid = (first + behind) // 2
            if ground[mid, 0] < ax - r:
                first = mid + 1
            else:
                behind = mid
        i = max(first - 2, 0)
        while i < n and ground[i, 0] <= bx + r:
            rho = ground[i, 2]
            gx, gz = ground[i, 0] + rho, ground[i, 1] - rho
            up = along = -1.0
            if nz < -1e-9:
                up = (nx * (gx - ax) + nz * (gz - az) - ra - rho) / nz
                along = -nz * (gx - ax) + nx * (gz - az - up)
            if 0.0 <= along <= level * length:  # below the straight part
                if up > top:
                    top, cx, cz, slope, on = up, gx - rho * nx, gz - rho * nz, -nx / nz, k
            else:
                for e in range(2):
                    ex, ez, reach = (ax, az, ra + rho) if e == 0 else (bx, bz, rb + rho)
                    off = gx - ex
                    if abs(off) < reach:
                        drop = math.sqrt(reach * reach - off * off)
                        up = gz - ez + drop
                        if up > top:
                            top, cx, cz, slope, on = up, gx - rho * off / reach, gz + rho * drop / reach, off / max(drop, 1e-9), k
            if i + 1 < n and ground[i + 1, 0] - gx > 1e-9:
                m = (ground[i + 1, 1] - ground[i, 1]) / (ground[i + 1, 0] - ground[i, 0])
                root = math.sqrt(1.0 + m * m)
                for e in range(2):
                    ex, ez, re = (ax, az, ra) if e == 0 else (bx, bz, rb)
                    tx = ex + re * m / root
                    if gx <= tx <= ground[i + 1, 0]:
                        tz = ground[i, 1] + m * (tx - ground[i, 0])
                        up = tz + re / root - ez
                        if up > top:
                            top, cx, cz, slope, on = up, tx, tz, m, k
            i += 1
    turned = th - min(max(th, weighs[8]), weighs[9])
    sc, ss = math.cos(turned), math.sin(turned)
    kg = weighs[0] + weighs[3]
    mx = weighs[0] * (c * weighs[1] - s * weighs[2]) + weighs[3] * (c * weighs[4] - s * weighs[5] + sc * weighs[6] - ss * weighs[7])
    mz = weighs[0] * (s * weighs[1] + c * weighs[2]) + weighs[3] * (s * weighs[4] + c * weighs[5] + ss * weighs[6] + sc * weighs[7])
    mx, mz = x + mx / kg, mz / kg
    return mx - cx, mx, top + mz, cx, cz, slope, on, top


@njit(cache=True)
def settle(th: float, x: float, body: Any, weighs: Any, ground: Any) -> tuple[float, float, float, bool]:
    """Return where a chair at a pitch turns to by its weight.

    Returns:
        Pitches just below and above the rest pose, drop of the centre of mass as the chair turns there about its contacts (the
        integral of its lever), and whether there is such a pose.
    """
    used = body.shape[0]
    lever = contact(th, x, body, weighs, ground, used)[0]
    nose_down = lever > 0.0
    step = -STEP_RAD if nose_down else STEP_RAD
    a, drop = th, 0.0
    while LOW_RAD < a + step < HIGH_RAD:
        b = a + step
        there = contact(b, x, body, weighs, ground, used)[0]
        if (there > 0.0) != nose_down:
            from_rad = a
            for _ in range(HALVINGS):
                m = 0.5 * (a + b)
                if (contact(m, x, body, weighs, ground, used)[0] > 0.0) == nose_down:
                    a = m
                else:
                    b = m
            return min(a, b), max(a, b), drop + abs(lever * (a - from_rad)), True
        # A lever that shrinks is that of a part which leaves the ground within the step: it lifted the chair, which does not fall.
        drop += abs(step) * min(abs(there), 0.5 * (abs(lever) + abs(there)))
        a, lever = b, there
    return a, a, drop, False


@njit(cache=True)
def follow(
    th: float, from_x: float, from_angles: Any, to_x: float, to_angles: Any, parts: Any, masses: Any, ground: Any
) -> tuple[float, float, float, float, int]:
    """Follow the rest pose of a chair over one move of place and joints.

    Returns:
        Pitch at the end; the part of the move that was made; angle and drop of the largest fall on the way; and ``RESTS``,
        ``TURNS_OVER``, or ``BLOCKED`` by a wall, which would lift the chair at once.
    """
    done, size = 0.0, 1.0
    angle, drop = 0.0, 0.0
    while done < 1.0 - 1e-9:
        size = min(size, 1.0 - done)
        part = done + size
        x = from_x + part * (to_x - from_x)
        body, weighs = posture(from_angles + part * (to_angles - from_angles), parts, masses)
        low, _, fell, stands = settle(th, x, body, weighs, ground)
        turned = abs(low - th)
        if turned > JUMP_RAD and size > LEAST_PART:
            size *= 0.5
            continue
        if not stands:
            return low, done, math.pi, 9.0, TURNS_OVER
        if turned > JUMP_RAD:
            before_x = from_x + done * (to_x - from_x)
            before, _ = posture(from_angles + done * (to_angles - from_angles), parts, masses)
            height = contact(th, before_x, before, weighs, ground, body.shape[0])[7]
            if contact(th, x, body, weighs, ground, body.shape[0])[7] - height > WALL_M:
                return th, done, angle, drop, BLOCKED
            angle, drop = max(angle, turned), max(drop, fell)
        th, done = low, part
        size *= 2.0
    return th, 1.0, angle, drop, RESTS


@njit(cache=True)
def describe(th: float, x: float, angles: Any, parts: Any, masses: Any, ground: Any, torques: Any, out: Any) -> bool:
    """Write what holds at the rest pose nearest to a pitch, and return whether there is one.

    Args:
        torques: Torque of each motor [N m].
        out: Pitch, height of B's origin, centre of mass (x, z), front contact (x, z), rear contact (x, z), share of the weight at
            the front contact, slopes of the ground at both contacts, margin to the front and to the rear [rad], parts at both
            contacts; and for each motor the torque by which the ground turns its part up [N m]. Belts hold the chair against the
            slope with the same share of friction at both contacts: a tip that reaches far down bears more torque than its load
            alone has.
    """
    body, weighs = posture(angles, parts, masses)
    used = body.shape[0]
    low, high, _, stands = settle(th, x, body, weighs, ground)
    if not stands:
        return False
    front, rear = contact(low, x, body, weighs, ground, used), contact(high, x, body, weighs, ground, used)
    span = front[3] - rear[3]
    share = min(max((front[1] - rear[3]) / span, 0.0), 1.0) if span > 1e-9 else 0.5
    out[0], out[1], out[2], out[3] = low, front[7], front[1], front[2]
    out[4], out[5], out[6], out[7], out[8] = front[3], front[4], rear[3], rear[4], share
    out[9], out[10] = front[5], rear[5]
    out[11] = _margin(low - SUPPORT_RAD, 1.0, front, rear, low, x, body, weighs, ground, torques)
    out[12] = _margin(high + SUPPORT_RAD, -1.0, rear, front, low, x, body, weighs, ground, torques)
    out[13], out[14] = front[6], rear[6]
    out[15:] = 0.0
    weight_n = GRAVITY_M_S2 * (weighs[0] + weighs[3])
    holds = share * front[5] + (1.0 - share) * rear[5]  # the part of its normal force that each contact adds along the ground
    for which in range(2):
        at, borne = (front, share) if which == 0 else (rear, 1.0 - share)
        part = at[6]
        if body[part, 6] >= 0.0:
            ahead = at[3] - _axis(part, low, x, body)
            below = front[7] + math.sin(low) * body[part, 0] + math.cos(low) * body[part, 1] - at[4]
            # A part that points rearward is turned up by what is behind its axis.
            out_ahead = 1.0 if body[part, 2] >= body[part, 0] else -1.0
            out[15 + int(body[part, 6])] += borne * weight_n * out_ahead * (ahead + (holds - at[5]) * below)
    return True


@njit(cache=True)
def _axis(part: int, th: float, x: float, body: Any) -> float:
    """Return where the axis is about which a part turns."""
    return x + math.cos(th) * body[part, 0] - math.sin(th) * body[part, 1]


@njit(cache=True)
def _margin(
    turned: float, way: float, near: Any, far: Any, th: float, x: float, body: Any, weighs: Any, ground: Any, torques: Any
) -> float:
    """Return the angle by which gravity may turn before the chair turns over the last ground that carries it [rad].

    That is the contact, or the ground it meets within ``SUPPORT_RAD``. A moving part bears the weight as far as its motor's torque
    goes, from the last ground under the parts that do not move.
    """
    fixed = 0
    while fixed < body.shape[0] and body[fixed, 6] < 0.0:
        fixed += 1
    held = contact(turned, x, body, weighs, ground, fixed)
    last, low = far[3], far[4]
    if held[6] >= 0 and way * (held[3] - last) > 0.0:
        last, low = held[3], held[4]
    edge = contact(turned, x, body, weighs, ground, body.shape[0])
    most, height = far[3], far[4]
    for which in range(2):
        at = near if which == 0 else edge
        if at[6] < 0:
            continue
        place, high, motor = at[3], at[4], int(body[at[6], 6])
        if motor >= 0:
            lever = abs(place - _axis(at[6], th, x, body))
            borne = min(torques[motor] / max(GRAVITY_M_S2 * (weighs[0] + weighs[3]) * lever, 1e-9), 1.0)
            place, high = last + borne * (place - last), low + borne * (high - low)
        if way * (place - most) > 0.0:
            most, height = place, high
    return math.atan2(way * (most - near[1]), near[2] - height)
