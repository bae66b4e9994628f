"""Per-pixel loops of the camera, compiled: rays against boxes, surface patterns, the Kinect's geometry."""

import math

import numpy as np
from numba import njit


@njit(cache=True)
def cast(centres, halves, yaws, R_WC, p_WC, fx, fy, cx, cy, far, depth, face):
    """Fill ``depth`` [m along the optical axis] and ``face`` (6·box + side) with the nearest box of each pixel.

    A pixel without a hit within ``far`` gets NaN and -1. Sides: 0/1 -x/+x, 2/3 -y/+y, 4/5 -z/+z in the box's frame.
    """
    rows, columns = depth.shape
    depth[:] = np.inf
    face[:] = -1
    o = np.empty(3)
    q = np.empty(3)
    M = np.empty((3, 3))
    for b in range(centres.shape[0]):
        c, s = math.cos(yaws[b]), math.sin(yaws[b])
        rx, ry, rz = p_WC[0] - centres[b, 0], p_WC[1] - centres[b, 1], p_WC[2] - centres[b, 2]
        o[0], o[1], o[2] = c * rx + s * ry, -s * rx + c * ry, rz
        for j in range(3):
            M[0, j] = c * R_WC[0, j] + s * R_WC[1, j]
            M[1, j] = -s * R_WC[0, j] + c * R_WC[1, j]
            M[2, j] = R_WC[2, j]
        # The box's outline in the image bounds the pixels that can see it.
        u0, u1, v0, v1 = columns * 1.0, -1.0, rows * 1.0, -1.0
        behind = 0
        for corner in range(8):
            for i in range(3):
                q[i] = (halves[b, i] if (corner >> i) & 1 else -halves[b, i]) - o[i]
            z = M[0, 2] * q[0] + M[1, 2] * q[1] + M[2, 2] * q[2]
            if z < 0.02:
                behind += 1
                continue
            x = M[0, 0] * q[0] + M[1, 0] * q[1] + M[2, 0] * q[2]
            y = M[0, 1] * q[0] + M[1, 1] * q[1] + M[2, 1] * q[2]
            u, v = fx * x / z + cx, fy * y / z + cy
            u0, u1, v0, v1 = min(u0, u), max(u1, u), min(v0, v), max(v1, v)
        if behind == 8:
            continue
        if behind > 0:
            u0, u1, v0, v1 = 0.0, columns - 1.0, 0.0, rows - 1.0
        first_u, last_u = max(int(math.floor(u0)), 0), min(int(math.ceil(u1)), columns - 1)
        first_v, last_v = max(int(math.floor(v0)), 0), min(int(math.ceil(v1)), rows - 1)
        for v in range(first_v, last_v + 1):
            y = (v - cy) / fy
            for u in range(first_u, last_u + 1):
                x = (u - cx) / fx
                near, out, side = 0.0, far, -1
                for i in range(3):
                    d = M[i, 0] * x + M[i, 1] * y + M[i, 2]
                    if abs(d) < 1e-12:
                        if abs(o[i]) > halves[b, i]:
                            side = -1
                            near = out
                            break
                        continue
                    inverse = 1.0 / d
                    if d > 0.0:
                        enter, leave, hit = (-halves[b, i] - o[i]) * inverse, (halves[b, i] - o[i]) * inverse, 2 * i
                    else:
                        enter, leave, hit = (halves[b, i] - o[i]) * inverse, (-halves[b, i] - o[i]) * inverse, 2 * i + 1
                    if enter > near:
                        near, side = enter, hit
                    if leave < out:
                        out = leave
                    if near >= out:
                        break
                if side >= 0 and near < out and near < depth[v, u]:
                    depth[v, u] = near
                    face[v, u] = 6 * b + side
    for v in range(rows):
        for u in range(columns):
            if face[v, u] < 0:
                depth[v, u] = np.nan


@njit(cache=True)
def _hash(i, j, k):
    """Return a number in [0, 1) that looks random and is the same for the same cell."""
    n = (i * 374761393 + j * 668265263 + k * 2147483647) & 0xFFFFFFFF
    n = ((n ^ (n >> 13)) * 1274126177) & 0xFFFFFFFF
    return ((n ^ (n >> 16)) & 0xFFFF) / 65536.0


@njit(cache=True)
def _smooth(x, y, k):
    """Return value noise: random at whole coordinates, blended between."""
    i, j = int(math.floor(x)), int(math.floor(y))
    a, b = x - i, y - j
    a, b = a * a * (3.0 - 2.0 * a), b * b * (3.0 - 2.0 * b)
    low = _hash(i, j, k) * (1.0 - a) + _hash(i + 1, j, k) * a
    high = _hash(i, j + 1, k) * (1.0 - a) + _hash(i + 1, j + 1, k) * a
    return low * (1.0 - b) + high * b


@njit(cache=True)
def _pattern(kind, a, b, seed):
    """Return a surface's reflectance around 1; a runs across the stair, b along the run or up the riser."""
    if kind == 0:  # wood: grain along the tread
        grain = _smooth(a * 3.0, b * 60.0, seed)
        return 0.85 + 0.3 * grain + 0.05 * math.sin(40.0 * b + 6.0 * grain)
    if kind == 1:  # concrete: blotches
        return 0.88 + 0.16 * _smooth(a * 9.0, b * 9.0, seed) + 0.08 * _smooth(a * 70.0, b * 70.0, seed + 1)
    if kind == 2:  # carpet: fine fibre
        return 0.8 + 0.4 * _hash(int(math.floor(a * 250.0)), int(math.floor(b * 250.0)), seed)
    if kind == 3:  # terrazzo: chips
        chip = _hash(int(math.floor(a * 90.0)), int(math.floor(b * 90.0)), seed)
        return 1.25 if chip > 0.88 else (0.6 if chip < 0.12 else 0.98)
    return 0.9 + 0.2 * _smooth(a * 12.0, b * 12.0, seed)


@njit(cache=True)
def paint(depth, face, R_WC, p_WC, fx, fy, cx, cy, shades, colours, kind, light, noise, rgb):
    """Fill ``rgb`` from depth and face: shade by orientation, pattern in surface coordinates, gain, sensor noise."""
    rows, columns = depth.shape
    for v in range(rows):
        y = (v - cy) / fy
        for u in range(columns):
            f = face[v, u]
            if f < 0:
                level, box, side = 0.25, -1, 0
            else:
                box, side = f // 6, f % 6
                z = depth[v, u]
                x = (u - cx) / fx
                wx = p_WC[0] + z * (R_WC[0, 0] * x + R_WC[0, 1] * y + R_WC[0, 2])
                wy = p_WC[1] + z * (R_WC[1, 0] * x + R_WC[1, 1] * y + R_WC[1, 2])
                wz = p_WC[2] + z * (R_WC[2, 0] * x + R_WC[2, 1] * y + R_WC[2, 2])
                if side < 2:
                    a, b = wy, wz
                elif side < 4:
                    a, b = wx, wz
                else:
                    a, b = wy, wx
                level = shades[box, side] * _pattern(kind, a, b, 31 * side + 7)
            gain = light * level
            for channel in range(3):
                value = gain * (colours[box, channel] if box >= 0 else 90.0)
                # Shot noise grows with the root of the signal.
                value += noise[v, u] * (1.5 + 0.25 * math.sqrt(max(value, 0.0)))
                rgb[v, u, channel] = np.uint8(min(max(value, 0.0), 255.0))


@njit(cache=True)
def kinect(exact, fx_noise, baseline, shadow_px, sigma_px, step_px, lateral_px, near, far, normal, chance, measured):
    """Fill ``measured`` with what a structured-light sensor makes of exact depth.

    Args:
        fx_noise: Focal length of the sensor's own disparity [px].
        shadow_px: ``f·B`` in this image's pixels: the projector's view is shifted by it over depth.
        sigma_px: Gaussian noise of the disparity.
        step_px: Its quantisation.
        lateral_px: Standard deviation of the place in the image a depth is taken from.
        normal: Three standard normal numbers per pixel.
        chance: One uniform number per pixel: drop-outs.
    """
    rows, columns = exact.shape
    strength = fx_noise * baseline
    for v in range(rows):
        furthest = -1e9
        for u in range(columns):
            z = exact[v, u]
            lit = True
            if z == z:
                seen = u + shadow_px / z
                if seen < furthest - 0.75:
                    lit = False
                else:
                    furthest = max(furthest, seen)
            measured[v, u] = np.nan
            if not lit:
                continue
            su = min(max(u + int(round(lateral_px * normal[0, v, u])), 0), columns - 1)
            sv = min(max(v + int(round(lateral_px * normal[1, v, u])), 0), rows - 1)
            z = exact[sv, su]
            if not (near <= z <= far):
                continue
            # A surface seen at a grazing angle returns little light: its depth runs away between neighbours.
            lu, ru = max(su - 1, 0), min(su + 1, columns - 1)
            lv, rv = max(sv - 1, 0), min(sv + 1, rows - 1)
            slope_u = abs(exact[sv, ru] - exact[sv, lu])
            slope_v = abs(exact[rv, su] - exact[lv, su])
            steep = max(slope_u, slope_v) / (z * 2.0)
            lost = 0.002 + (0.25 if steep > 0.04 else 0.0)
            if chance[v, u] < lost:
                continue
            disparity = strength / z + sigma_px * normal[2, v, u]
            disparity = round(disparity / step_px) * step_px
            if disparity > 0.0:
                measured[v, u] = strength / disparity
