"""Light of a time-of-flight camera that reaches a pixel by way of another surface, compiled.

Single diffuse bounce between patches (Jiménez et al., Image and Vision Computing 32, 2014; Fuchs, ICPR 2010), with the disc
approximation of the form factor, which stays finite where patches meet (Wallace et al., SIGGRAPH 1989). Patches outside the image
and shadows between patches are neglected.
"""

import math
from typing import no_type_check

import numpy as np
from numba import njit

LIGHT_M_S = 299_792_458.0
MODULATION_HZ = 80e6
"""Modulation frequency: the middle one of the Kinect 2, which uses 16, 80 and 120 MHz (Sarbolandi et al., CVIU 139, 2015)."""


@njit(cache=True, error_model="numpy")
@no_type_check
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
@no_type_check
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
