"""Per-pixel loops of the camera, compiled: ray casting, surface patterns and colours."""

import math

import numpy as np

from treadline.core.kernel_cache import njit

NEAR_M = 0.02
"""Distance from the camera at which faces are clipped [m]."""


@njit(cache=True, error_model="numpy")
def cast(centres, halves, turns, R_WC, p_WC, fx, fy, cx, cy, far, depth, face):
    """Fill ``depth`` [m along the optical axis] and ``face`` (6·box + side) with the nearest box of each pixel.

    ``turns`` holds the rotation of each box in the world. Each face towards the camera is a convex polygon in the image with linear
    inverse depth: it is clipped, filled row by row, and kept where it is nearest. A pixel without a hit within ``far`` gets NaN and
    -1. Sides: 0/1 -x/+x, 2/3 -y/+y, 4/5 -z/+z in the box frame.
    """
    rows, columns = depth.shape
    depth[:] = 1.0 / far  # holds inverse depth until the end
    face[:] = -1
    o = np.empty(3)
    M = np.empty((3, 3))
    corners = np.empty((4, 3))
    clipped = np.empty((6, 3))
    for b in range(centres.shape[0]):
        rx, ry, rz = p_WC[0] - centres[b, 0], p_WC[1] - centres[b, 1], p_WC[2] - centres[b, 2]
        for i in range(3):
            x, y, z = turns[b, 0, i], turns[b, 1, i], turns[b, 2, i]
            o[i] = x * rx + y * ry + z * rz
            for j in range(3):
                M[i, j] = x * R_WC[0, j] + y * R_WC[1, j] + z * R_WC[2, j]
        for side in range(6):
            i = side // 2
            level = halves[b, i] if side % 2 else -halves[b, i]
            distance = level - o[i]
            # Looked at from its outside, or not seen at all.
            if (side % 2 and distance >= 0.0) or (not side % 2 and distance <= 0.0):
                continue
            j, k = (i + 1) % 3, (i + 2) % 3
            for corner in range(4):
                p = halves[b, j] * (1.0 if corner in (1, 2) else -1.0) - o[j]
                q = halves[b, k] * (1.0 if corner >= 2 else -1.0) - o[k]
                for axis in range(3):
                    corners[corner, axis] = distance * M[i, axis] + p * M[j, axis] + q * M[k, axis]
            count = _clip(corners, clipped)
            if count < 3:
                continue
            # On the plane, 1/Z = (normal · ray) / distance, linear in the pixel.
            wu, wv = M[i, 0] / distance / fx, M[i, 1] / distance / fy
            w0 = M[i, 2] / distance - wu * cx - wv * cy
            _fill(clipped, count, fx, fy, cx, cy, wu, wv, w0, 6 * b + side, depth, face)
    for v in range(rows):
        for u in range(columns):
            depth[v, u] = 1.0 / depth[v, u] if face[v, u] >= 0 else np.nan


@njit(cache=True, error_model="numpy")
def _clip(corners, clipped):
    """Write the part of a quadrilateral in front of the camera; return its number of corners."""
    count = 0
    for a in range(4):
        b = (a + 1) % 4
        za, zb = corners[a, 2], corners[b, 2]
        if za >= NEAR_M:
            clipped[count] = corners[a]
            count += 1
        if (za >= NEAR_M) != (zb >= NEAR_M):
            t = (NEAR_M - za) / (zb - za)
            clipped[count] = corners[a] + t * (corners[b] - corners[a])
            count += 1
    return count


@njit(cache=True, error_model="numpy")
def _fill(polygon, count, fx, fy, cx, cy, wu, wv, w0, label, inverse, face):
    """Fill a convex polygon where its inverse depth is the largest so far."""
    rows, columns = inverse.shape
    u_at, v_at = np.empty(6), np.empty(6)
    top, bottom, first, last = 1e18, -1e18, 1e18, -1e18
    for a in range(count):
        scale = 1.0 / polygon[a, 2]
        u_at[a] = fx * polygon[a, 0] * scale + cx
        v_at[a] = fy * polygon[a, 1] * scale + cy
        top, bottom = min(top, v_at[a]), max(bottom, v_at[a])
        first, last = min(first, u_at[a]), max(last, u_at[a])
    if bottom < 0.0 or top > rows - 1 or last < 0.0 or first > columns - 1:
        return
    for v in range(max(int(math.ceil(top)), 0), min(int(math.floor(bottom)), rows - 1) + 1):
        left, right = 1e18, -1e18
        for a in range(count):
            b = a + 1 if a + 1 < count else 0
            va, vb = v_at[a], v_at[b]
            if (va <= v <= vb or vb <= v <= va) and va != vb:
                u = u_at[a] + (v - va) / (vb - va) * (u_at[b] - u_at[a])
                left, right = min(left, u), max(right, u)
        if right < 0.0 or left > columns - 1:
            continue
        start, stop = max(int(math.ceil(left)), 0), min(int(math.floor(right)), columns - 1)
        value = wv * v + w0 + wu * start
        near, names = inverse[v], face[v]
        for u in range(start, stop + 1):
            if value > near[u]:
                near[u] = value
                names[u] = label
            value += wu


@njit(cache=True, error_model="numpy")
def _hash(i, j, k):
    """Return a pseudo-random number in [0, 1) that depends on the cell only."""
    n = (i * 374761393 + j * 668265263 + k * 2147483647) & 0xFFFFFFFF
    n = ((n ^ (n >> 13)) * 1274126177) & 0xFFFFFFFF
    return ((n ^ (n >> 16)) & 0xFFFF) / 65536.0


@njit(cache=True, error_model="numpy")
def smooth(x, y, k):
    """Return value noise: random at integer coordinates, interpolated between them."""
    i, j = int(math.floor(x)), int(math.floor(y))
    a, b = x - i, y - j
    a, b = a * a * (3.0 - 2.0 * a), b * b * (3.0 - 2.0 * b)
    low = _hash(i, j, k) * (1.0 - a) + _hash(i + 1, j, k) * a
    high = _hash(i, j + 1, k) * (1.0 - a) + _hash(i + 1, j + 1, k) * a
    return low * (1.0 - b) + high * b


@njit(cache=True, error_model="numpy")
def _pattern(kind, a, b, seed):
    """Return the relative reflectance of a surface; a runs across the stair, b along the run or up the riser."""
    if kind == 0:  # wood: grain along the tread
        grain = smooth(a * 3.0, b * 60.0, seed)
        return 0.85 + 0.3 * grain
    if kind == 1:  # concrete: blotches
        return 0.88 + 0.16 * smooth(a * 9.0, b * 9.0, seed) + 0.08 * smooth(a * 70.0, b * 70.0, seed + 1)
    if kind == 2:  # carpet: fine fibre
        return 0.8 + 0.4 * _hash(int(math.floor(a * 250.0)), int(math.floor(b * 250.0)), seed)
    if kind == 3:  # terrazzo: chips
        chip = _hash(int(math.floor(a * 90.0)), int(math.floor(b * 90.0)), seed)
        return 1.25 if chip > 0.88 else (0.6 if chip < 0.12 else 0.98)
    return 0.9 + 0.2 * smooth(a * 12.0, b * 12.0, seed)


@njit(cache=True, error_model="numpy")
def paint(depth, face, R_WC, p_WC, fx, fy, cx, cy, shades, axes, colours, kinds, light, shadows, noise, place, rgb):
    """Fill ``rgb`` from depth and face: shade by orientation, surface pattern, shadows, gain, sensor noise.

    Args:
        shades: Brightness of the six sides of each box.
        axes: World axis nearest to the normal of each side.
        kinds: Pattern of each box.
        shadows: Rows of normal (3), level and half width.
    """
    rows, columns = depth.shape
    for v in range(rows):
        y = (v - cy) / fy
        for u in range(columns):
            f = face[v, u]
            if f < 0:
                level, box = 0.25, -1
            else:
                box, side = f // 6, f % 6
                z = depth[v, u]
                x = (u - cx) / fx
                wx = p_WC[0] + z * (R_WC[0, 0] * x + R_WC[0, 1] * y + R_WC[0, 2])
                wy = p_WC[1] + z * (R_WC[1, 0] * x + R_WC[1, 1] * y + R_WC[1, 2])
                wz = p_WC[2] + z * (R_WC[2, 0] * x + R_WC[2, 1] * y + R_WC[2, 2])
                if axes[box, side] == 0:
                    a, b = wy, wz
                elif axes[box, side] == 1:
                    a, b = wx, wz
                else:
                    a, b = wy, wx
                level = shades[box, side] * _pattern(kinds[box], a, b, 31 * side + 7)
                for k in range(shadows.shape[0]):
                    off = abs(shadows[k, 0] * wx + shadows[k, 1] * wy + shadows[k, 2] * wz - shadows[k, 3])
                    # A lamp is no point: the shadow's edge is a few centimetres wide.
                    level *= 1.0 - 0.6 * min(max((shadows[k, 4] - off) / 0.03, 0.0), 1.0)
            gain = light * level
            # Shot noise grows with the root of the signal.
            grain = noise[place + v * columns + u] * (1.5 + 0.25 * math.sqrt(gain * (colours[box, 1] if box >= 0 else 90.0)))
            for channel in range(3):
                value = gain * (colours[box, channel] if box >= 0 else 90.0) + grain
                rgb[v, u, channel] = np.uint8(min(max(value, 0.0), 255.0))
