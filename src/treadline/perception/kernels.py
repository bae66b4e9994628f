"""One pass over a depth image, compiled: sums of each block for plane fits in inverse depth."""

import math
from typing import no_type_check

import numpy as np
from numba import njit

COUNT, X, Y, XX, XY, YY, W, XW, YW, WW = range(10)
SUMS = 10


@njit(cache=True)
@no_type_check
def block_sums(depth, size, fx, fy, cx, cy, near, far):
    """Return sums over each ``size × size`` block of pixels with a depth.

    With w = 1/Z a plane is linear in the image, w = αx + βy + γ, and a disparity sensor's noise is the same everywhere.
    """
    rows, columns = depth.shape[0] // size, depth.shape[1] // size
    sums = np.zeros((rows * columns, SUMS))
    for i in range(rows):
        for j in range(columns):
            n = 0
            a = b = c = d = e = f = g = h = k = 0.0
            for v in range(i * size, (i + 1) * size):
                y = (v - cy) / fy
                for u in range(j * size, (j + 1) * size):
                    z = depth[v, u]
                    if not (near <= z <= far):
                        continue
                    x = (u - cx) / fx
                    w = 1.0 / z
                    n += 1
                    a += x
                    b += y
                    c += x * x
                    d += x * y
                    e += y * y
                    f += w
                    g += x * w
                    h += y * w
                    k += w * w
            row = sums[i * columns + j]
            row[COUNT], row[X], row[Y], row[XX], row[XY] = n, a, b, c, d
            row[YY], row[W], row[XW], row[YW], row[WW] = e, f, g, h, k
    return sums


@njit(cache=True)
@no_type_check
def fit_planes(sums, planes, residuals):
    """Fill ``planes`` (α, β, γ) and the RMS residual of w for each row of sums; NaN where there is no plane."""
    for i in range(sums.shape[0]):
        s = sums[i]
        n = s[COUNT]
        residuals[i] = np.nan
        planes[i, 0] = planes[i, 1] = planes[i, 2] = np.nan
        if n < 6:
            continue
        mx, my, mw = s[X] / n, s[Y] / n, s[W] / n
        xx, xy, yy = s[XX] - n * mx * mx, s[XY] - n * mx * my, s[YY] - n * my * my
        xw, yw, ww = s[XW] - n * mx * mw, s[YW] - n * my * mw, s[WW] - n * mw * mw
        det = xx * yy - xy * xy
        if det <= 1e-9 * xx * yy or det <= 0.0:
            continue
        alpha = (xw * yy - yw * xy) / det
        beta = (yw * xx - xw * xy) / det
        planes[i, 0], planes[i, 1], planes[i, 2] = alpha, beta, mw - alpha * mx - beta * my
        residuals[i] = math.sqrt(max(ww - alpha * xw - beta * yw, 0.0) / n)
