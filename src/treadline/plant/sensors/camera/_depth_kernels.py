"""Per-pixel loops of the depth sensors, compiled: structured light, time of flight with multipath, active stereo.

Multipath is the light of a time-of-flight camera that reaches a pixel by way of another surface: a single diffuse bounce between
patches (Jiménez et al., Image and Vision Computing 32, 2014; Fuchs, ICPR 2010), with the disc approximation of the form factor,
which stays finite where patches meet (Wallace et al., SIGGRAPH 1989). Patches outside the image and shadows between patches are
neglected.
"""

import math

import numpy as np

from treadline.core.kernel_cache import njit
from treadline.plant.sensors.camera._ray_kernels import smooth

LOST, LOST_GRAZING, GRAZING = 0.002, 0.25, 0.04
"""Fraction of a Kinect 1's pixels without a return; additional fraction on surfaces with a relative depth change per pixel above
``GRAZING``."""
OCCLUDED_PX = 0.75
"""Disparity difference below which a pixel counts as seen by the other imager [px]."""
LIGHT_M_S = 299_792_458.0
MODULATION_HZ = 80e6
"""Modulation frequency: the middle one of the Kinect 2, which uses 16, 80 and 120 MHz (Sarbolandi et al., CVIU 139, 2015)."""


@njit(cache=True, error_model="numpy")
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
            faded = gain_m / max(_light(exact, face, u, v, fx, fy, cx, cy, albedos), 1e-3)
            sigma = math.sqrt(floor_m * floor_m + faded * faded)
            if sigma > 0.04 or chance[second + n] < 0.0003:
                continue
            # The driver smooths over neighbours; a binomial of nine is about as correlated.
            noise = 0.0
            for i in range(-1, 2):
                for j in range(-1, 2):
                    weight = (2.0 if i == 0 else 1.0) * (2.0 if j == 0 else 1.0)
                    noise += weight * normal[third + min(max(v + i, 0), rows - 1) * columns + min(max(u + j, 0), columns - 1)]
            wave = smooth(u / (7.0 * scale), v / (7.0 * scale), 3) - 0.5
            share = 0.5 * chance[first + n] if jump > 0.02 * z else 0.0
            measured[v, u] = z + share * (beyond - z) + sigma * noise / 6.0 + ripple_m * wave


@njit(cache=True, error_model="numpy")
def stereo(
    exact,
    face,
    disparity,
    fattened,
    scale,
    fx,
    fy,
    cx,
    cy,
    albedos,
    strength,
    sigma,
    step,
    near,
    far,
    least_light,
    spread,
    normal,
    places,
    measured,
):
    """Fill ``measured`` row by row from the right: the view of the right imager is covered from there."""
    rows, columns = exact.shape
    first, second = places[0], places[1]
    common = math.exp(spread)
    for v in range(rows):
        lowest = 1e9
        for u in range(columns - 1, -1, -1):
            measured[v, u] = np.nan
            n = v * columns + u
            d = disparity[v, u]
            seen = u - d * scale
            hidden = seen > lowest + OCCLUDED_PX * scale
            if d > 0.0:
                lowest = min(lowest, seen)
            if fattened[v, u] > 0.0:
                d = fattened[v, u]
            elif hidden or d <= 0.0:
                continue
            else:
                need = normal[second + n]
                light = _light(exact, face, u, v, fx, fy, cx, cy, albedos) / least_light
                # Exponentials are slow: most pixels have enough light for every need below one standard deviation.
                if light < (common if need < 1.0 else math.exp(spread * need)) and light < math.exp(spread * need):
                    continue
            if u - d * scale < 0.0:
                continue
            d = np.rint((d + sigma * normal[first + n]) / step) * step
            if d > 0.0 and near <= strength / d <= far:
                measured[v, u] = strength / d


@njit(cache=True, error_model="numpy", inline="always")
def _light(exact, face, u, v, fx, fy, cx, cy, albedos):
    """Return the light of the projector that a pixel gets back, relative to a white wall facing it at 1 m.

    The inverse depth's gradient on the pixel's face gives the face's normal, and so the angle at which it is seen.
    """
    rows, columns = exact.shape
    z, f = exact[v, u], face[v, u]
    w = 1.0 / z
    wu, wv = 0.0, 0.0
    if u + 1 < columns and face[v, u + 1] == f:
        wu = (1.0 / exact[v, u + 1] - w) * fx
    elif u > 0 and face[v, u - 1] == f:
        wu = (w - 1.0 / exact[v, u - 1]) * fx
    if v + 1 < rows and face[v + 1, u] == f:
        wv = (1.0 / exact[v + 1, u] - w) * fy
    elif v > 0 and face[v - 1, u] == f:
        wv = (w - 1.0 / exact[v - 1, u]) * fy
    x, y = (u - cx) / fx, (v - cy) / fy
    wz = w - wu * x - wv * y
    cosine = w / math.sqrt((wu * wu + wv * wv + wz * wz) * (1.0 + x * x + y * y))
    return albedos[f // 6] * cosine / (z * z)


@njit(cache=True, error_model="numpy")
def bounce(exact, face, albedos, fx, fy, cx, cy, cell, bias):
    """Fill ``bias`` [m of range] for the middle pixel of each cell of ``cell`` × ``cell`` pixels; NaN without a surface."""
    rows, columns = bias.shape
    count = rows * columns
    points, normals = np.empty((count, 3)), np.empty((count, 3))
    ranges, lights, areas, reflect = np.empty(count), np.zeros(count), np.empty(count), np.empty(count)
    for i in range(rows):
        for j in range(columns):
            k = i * columns + j
            v, u = min(i * cell + cell // 2, exact.shape[0] - 1), min(j * cell + cell // 2, exact.shape[1] - 1)
            if not _plane(exact, face, u, v, fx, fy, cx, cy, normals[k]):
                continue
            z = exact[v, u]
            points[k, 0], points[k, 1], points[k, 2] = (u - cx) / fx * z, (v - cy) / fy * z, z
            ranges[k] = math.sqrt(points[k, 0] ** 2 + points[k, 1] ** 2 + z * z)
            facing = (normals[k, 0] * points[k, 0] + normals[k, 1] * points[k, 1] + normals[k, 2] * z) / ranges[k]
            # Solid angle of the cell times range squared over the cosine: the area of the patch.
            areas[k] = cell * cell / (fx * fy) * z**3 / ranges[k] / max(facing, 1e-3)
            lights[k] = facing / ranges[k] ** 2
            reflect[k] = albedos[face[v, u] // 6]
    wave = 4.0 * math.pi * MODULATION_HZ / LIGHT_M_S
    for k in range(count):
        if lights[k] <= 0.0:
            bias[k // columns, k % columns] = np.nan
            continue
        real, imaginary = 1.0, 0.0
        for q in range(count):
            if lights[q] <= 0.0 or q == k:
                continue
            dx, dy, dz = points[q, 0] - points[k, 0], points[q, 1] - points[k, 1], points[q, 2] - points[k, 2]
            # Normals point away from the camera.
            leaving = normals[q, 0] * dx + normals[q, 1] * dy + normals[q, 2] * dz
            arriving = -(normals[k, 0] * dx + normals[k, 1] * dy + normals[k, 2] * dz)
            if leaving <= 0.0 or arriving <= 0.0:
                continue
            square = dx * dx + dy * dy + dz * dz
            factor = leaving * arriving / square * areas[q] / (math.pi * square + areas[q])
            share = lights[q] / lights[k] * reflect[q] * factor
            phase = wave * 0.5 * (ranges[q] + math.sqrt(square) - ranges[k])
            real += share * math.cos(phase)
            imaginary += share * math.sin(phase)
        bias[k // columns, k % columns] = math.atan2(imaginary, real) / wave


@njit(cache=True, error_model="numpy")
def _plane(exact, face, u, v, fx, fy, cx, cy, normal):
    """Write the unit normal of the face at a pixel, pointing away from the camera; return whether it has one."""
    f, z = face[v, u], exact[v, u]
    if f < 0 or z != z:
        return False
    w = 1.0 / z
    if u + 1 < exact.shape[1] and face[v, u + 1] == f:
        wu = (1.0 / exact[v, u + 1] - w) * fx
    elif u > 0 and face[v, u - 1] == f:
        wu = (w - 1.0 / exact[v, u - 1]) * fx
    else:
        return False
    if v + 1 < exact.shape[0] and face[v + 1, u] == f:
        wv = (1.0 / exact[v + 1, u] - w) * fy
    elif v > 0 and face[v - 1, u] == f:
        wv = (w - 1.0 / exact[v - 1, u]) * fy
    else:
        return False
    wz = w - wu * (u - cx) / fx - wv * (v - cy) / fy
    length = math.sqrt(wu * wu + wv * wv + wz * wz)
    normal[0], normal[1], normal[2] = wu / length, wv / length, wz / length
    return True
