"""Per-pixel loops of the camera, compiled: ray casting, surface patterns, sensor models."""

import math
from typing import no_type_check

import numpy as np
from numba import njit

NEAR_M = 0.02
"""Distance from the camera at which faces are clipped [m]."""
LOST, LOST_GRAZING, GRAZING = 0.002, 0.25, 0.04
"""Fraction of a Kinect 1's pixels without a return; additional fraction on surfaces with a relative depth change per pixel above
``GRAZING``."""


@njit(cache=True, error_model="numpy")
@no_type_check
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
@no_type_check
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
@no_type_check
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
@no_type_check
def _hash(i, j, k):
    """Return a pseudo-random number in [0, 1) that depends on the cell only."""
    n = (i * 374761393 + j * 668265263 + k * 2147483647) & 0xFFFFFFFF
    n = ((n ^ (n >> 13)) * 1274126177) & 0xFFFFFFFF
    return ((n ^ (n >> 16)) & 0xFFFF) / 65536.0


@njit(cache=True, error_model="numpy")
@no_type_check
def _smooth(x, y, k):
    """Return value noise: random at integer coordinates, interpolated between them."""
    i, j = int(math.floor(x)), int(math.floor(y))
    a, b = x - i, y - j
    a, b = a * a * (3.0 - 2.0 * a), b * b * (3.0 - 2.0 * b)
    low = _hash(i, j, k) * (1.0 - a) + _hash(i + 1, j, k) * a
    high = _hash(i, j + 1, k) * (1.0 - a) + _hash(i + 1, j + 1, k) * a
    return low * (1.0 - b) + high * b


@njit(cache=True, error_model="numpy")
@no_type_check
def _pattern(kind, a, b, seed):
    """Return the relative reflectance of a surface; a runs across the stair, b along the run or up the riser."""
    if kind == 0:  # wood: grain along the tread
        grain = _smooth(a * 3.0, b * 60.0, seed)
        return 0.85 + 0.3 * grain
    if kind == 1:  # concrete: blotches
        return 0.88 + 0.16 * _smooth(a * 9.0, b * 9.0, seed) + 0.08 * _smooth(a * 70.0, b * 70.0, seed + 1)
    if kind == 2:  # carpet: fine fibre
        return 0.8 + 0.4 * _hash(int(math.floor(a * 250.0)), int(math.floor(b * 250.0)), seed)
    if kind == 3:  # terrazzo: chips
        chip = _hash(int(math.floor(a * 90.0)), int(math.floor(b * 90.0)), seed)
        return 1.25 if chip > 0.88 else (0.6 if chip < 0.12 else 0.98)
    return 0.9 + 0.2 * _smooth(a * 12.0, b * 12.0, seed)


@njit(cache=True, error_model="numpy")
@no_type_check
def paint(depth, face, R_WC, p_WC, fx, fy, cx, cy, shades, axes, colours, kinds, light, shadows, puddles, noise, place, rgb):
    """Fill ``rgb`` from depth and face: shade by orientation, surface pattern, shadows, water, gain, sensor noise.

    Args:
        shades: Brightness of the six sides of each box.
        axes: World axis nearest to the normal of each side.
        kinds: Pattern of each box.
        shadows: Rows of normal (3), level and half width.
        puddles: Rows of centre (3) and half axes (2).
    """
    rows, columns = depth.shape
    for v in range(rows):
        y = (v - cy) / fy
        for u in range(columns):
            f = face[v, u]
            shine = 0.0
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
                for k in range(puddles.shape[0]):
                    inside = _within(puddles, k, wx, wy, wz)
                    if inside > 0.0:
                        level *= 0.7
                        shine += 230.0 * inside * inside * _smooth(wx * 14.0, wy * 14.0, 5)
            gain = light * level
            # Shot noise grows with the root of the signal.
            grain = noise[place + v * columns + u] * (1.5 + 0.25 * math.sqrt(gain * (colours[box, 1] if box >= 0 else 90.0)))
            for channel in range(3):
                value = gain * (colours[box, channel] if box >= 0 else 90.0) + light * shine + grain
                rgb[v, u, channel] = np.uint8(min(max(value, 0.0), 255.0))


@njit(cache=True, error_model="numpy")
@no_type_check
def _within(puddles, k, wx, wy, wz):
    """Return the relative depth of a point inside a puddle: 1 in the middle, 0 outside."""
    if abs(wz - puddles[k, 2]) > 0.004:
        return 0.0
    along, across = (wx - puddles[k, 0]) / puddles[k, 3], (wy - puddles[k, 1]) / puddles[k, 4]
    return max(1.0 - along * along - across * across, 0.0)


@njit(cache=True, error_model="numpy")
@no_type_check
def soak(measured, exact, R_WC, p_WC, fx, fy, cx, cy, puddles, chance, place):
    """Modify measured depth in puddles: no return from the middle, and partial mirror images at the rim.

    A mirror image lies below the surface: the depth is larger, here by a hand's breadth.
    """
    rows, columns = measured.shape
    for v in range(rows):
        y = (v - cy) / fy
        for u in range(columns):
            z = exact[v, u]
            if z != z:
                continue
            x = (u - cx) / fx
            wx = p_WC[0] + z * (R_WC[0, 0] * x + R_WC[0, 1] * y + R_WC[0, 2])
            wy = p_WC[1] + z * (R_WC[1, 0] * x + R_WC[1, 1] * y + R_WC[1, 2])
            wz = p_WC[2] + z * (R_WC[2, 0] * x + R_WC[2, 1] * y + R_WC[2, 2])
            for k in range(puddles.shape[0]):
                inside = _within(puddles, k, wx, wy, wz)
                if inside <= 0.0:
                    continue
                # Blotches, not single pixels: water mirrors in patches.
                patch = _smooth(wx * 25.0, wy * 25.0, 9)
                if inside > 0.6 or chance[place + v * columns + u] < 0.3:
                    measured[v, u] = np.nan
                elif patch > 0.6:
                    measured[v, u] += 0.25 * (patch - 0.6)


@njit(cache=True, error_model="numpy")
@no_type_check
def kinect(exact, face, fx_noise, baseline, shadow_px, sigma_px, step_px, near, far, jitter, normal, chance, places, measured):
    """Fill ``measured`` with the output of a structured-light sensor for exact depth.

    Args:
        face: Face of each pixel. At an edge a pixel may get its depth from the neighbouring face; within a face, lateral jitter is
            part of the disparity noise.
        fx_noise: Focal length of the sensor's disparity image [px].
        shadow_px: ``f·B`` in pixels of this image: the shift of the projector's view times depth.
        sigma_px: Standard deviation of the disparity noise.
        step_px: Quantisation of the disparity.
        lateral_px: Standard deviation of the lateral jitter.
        normal: Standard normal numbers, and ``places`` the start positions of this frame's streams.
        chance: Uniform random numbers.
    """
    rows, columns = exact.shape
    strength = fx_noise * baseline
    first, second, third, fourth = places[0], places[1], places[2], places[3]
    for v in range(rows):
        nearest = 1e9
        depth, names, out = exact[v], face[v], measured[v]
        # The projector stands to the right of the camera: shadows fall on the left of near surfaces.
        for u in range(columns - 1, -1, -1):
            out[u] = np.nan
            z = depth[u]
            if z == z:
                seen = u - shadow_px / z
                if seen > nearest + 0.75:
                    continue
                nearest = min(nearest, seen)
            n = v * columns + u
            # A random branch per pixel would cost more than the work it saves.
            su = min(max(u + jitter[first + n], 0), columns - 1)
            sv = min(max(v + jitter[second + n], 0), rows - 1)
            elsewhere = face[sv, su] != names[u]
            su, sv = su if elsewhere else u, sv if elsewhere else v
            z = exact[sv, su]
            if not (near <= z <= far):
                continue
            # A surface seen at a grazing angle returns little light: its depth runs away between neighbours.
            lu, ru = max(su - 1, 0), min(su + 1, columns - 1)
            lv, rv = max(sv - 1, 0), min(sv + 1, rows - 1)
            slope_u = abs(exact[sv, ru] - exact[sv, lu])
            slope_v = abs(exact[rv, su] - exact[lv, su])
            steep = max(slope_u, slope_v) / (z * 2.0)
            lost = LOST + (LOST_GRAZING if steep > GRAZING else 0.0)
            if chance[fourth + n] < lost:
                continue
            disparity = np.rint((strength / z + sigma_px * normal[third + n]) / step_px) * step_px
            if disparity > 0.0:
                out[u] = strength / disparity


@njit(cache=True, error_model="numpy")
@no_type_check
def time_of_flight(
    exact, face, fx, fy, cx, cy, albedos, floor_m, gain_m, ripple_m, scale, near, far, dropped, normal, chance, places, measured
):
    """Fill ``measured`` with the output of a time-of-flight sensor for exact depth.

    Args:
        albedos: Albedo of each box at the sensor's wavelength.
        floor_m: Noise at high signal; ``gain_m`` is the additional noise for a white wall facing the sensor at 1 m, growing with
            decreasing signal: with distance squared, at grazing angles, on dark surfaces.
        ripple_m: Amplitude of the sensor's fixed pattern across the image.
        scale: Pixels of this image per sensor pixel.
        dropped: Fraction of the mixed pixels that the driver removes.
        normal: Standard normal numbers, and ``places`` the start positions of this frame's streams.
    """
    rows, columns = exact.shape
    first, second, third = places[0], places[1], places[2]
    for v in range(rows):
        for u in range(columns):
            measured[v, u] = np.nan
            z = exact[v, u]
            if not (near <= z <= far):
                continue
            n = v * columns + u
            f = face[v, u]
            # Mixed pixels: light from both sides of an edge comes back at once.
            lu, ru, lv, rv = max(u - 1, 0), min(u + 1, columns - 1), max(v - 1, 0), min(v + 1, rows - 1)
            beyond = z
            for k in range(4):
                other = exact[v, lu] if k == 0 else exact[v, ru] if k == 1 else exact[lv, u] if k == 2 else exact[rv, u]
                names = face[v, lu] if k == 0 else face[v, ru] if k == 1 else face[lv, u] if k == 2 else face[rv, u]
                if names != f and other == other and abs(other - z) > abs(beyond - z):
                    beyond = other
            jump = abs(beyond - z)
            if jump > 0.04 * z and chance[first + n] < dropped:
                continue
            # The inverse depth's gradient on this face gives its normal, and so the angle at which it is seen.
            w = 1.0 / z
            wu, wv = 0.0, 0.0
            if face[v, ru] == f and ru > u:
                wu = (1.0 / exact[v, ru] - w) * fx
            elif face[v, lu] == f and lu < u:
                wu = (w - 1.0 / exact[v, lu]) * fx
            if face[rv, u] == f and rv > v:
                wv = (1.0 / exact[rv, u] - w) * fy
            elif face[lv, u] == f and lv < v:
                wv = (w - 1.0 / exact[lv, u]) * fy
            x, y = (u - cx) / fx, (v - cy) / fy
            wz = w - wu * x - wv * y
            cosine = w / math.sqrt((wu * wu + wv * wv + wz * wz) * (1.0 + x * x + y * y))
            light = albedos[f // 6] * cosine / (z * z)
            faded = gain_m / max(light, 1e-3)
            sigma = math.sqrt(floor_m * floor_m + faded * faded)
            if sigma > 0.04 or chance[second + n] < 0.0003:
                continue
            # The driver smooths over neighbours; a binomial of nine is about as correlated.
            noise = 0.0
            for i in range(-1, 2):
                for j in range(-1, 2):
                    weight = (2.0 if i == 0 else 1.0) * (2.0 if j == 0 else 1.0)
                    noise += weight * normal[third + min(max(v + i, 0), rows - 1) * columns + min(max(u + j, 0), columns - 1)]
            wave = _smooth(u / (7.0 * scale), v / (7.0 * scale), 3) - 0.5
            share = 0.5 * chance[first + n] if jump > 0.02 * z else 0.0
            measured[v, u] = z + share * (beyond - z) + sigma * noise / 6.0 + ripple_m * wave
