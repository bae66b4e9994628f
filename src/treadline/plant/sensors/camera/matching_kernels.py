"""Per-pixel loops of active stereo, compiled."""

import math
from typing import no_type_check

import numpy as np
from numba import njit

OCCLUDED_PX = 0.75
"""Disparity difference below which a pixel counts as seen by the other imager [px], as in ``kernels.kinect``."""


@njit(cache=True, error_model="numpy")
@no_type_check
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
@no_type_check
def _light(exact, face, u, v, fx, fy, cx, cy, albedos):
    """Return the light of the projector that a pixel gets back, relative to a white wall facing it at 1 m."""
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
