"""Loops over the pixels of a depth image, compiled.

With w = 1/Z a plane n·p = 1 is linear in the image, w = n·(x, y, 1), and a disparity sensor's noise is the same everywhere.
"""

import math
from typing import no_type_check

import numpy as np
from numba import njit

from treadline.fma import dot, fused

COUNT, X, Y, XX, XY, YY, W, XW, YW, WW = range(10)
SUMS = 10
GAP_PX = 2
"""Pixels off a surface that do not end it: a hole, a speck."""
ROUNDING = 1e-11
"""Of a sum of squares that is left about the mean: pixels in one row or column. Two rows at the image's border leave 1e-6."""
WIDENED = 3.7
"""Median deviations of a line's points that are kept: 2.5 sigma of a normal error."""
CREASE, BEYOND, BEFORE, UNKNOWN = 0, 1, 2, 3
"""What follows a surface's end: a surface that starts there, one that lies behind, one that stands before, nothing known."""


@njit(cache=True, error_model="numpy")
@no_type_check
def nearness_of(depth):
    """Return w = 1/Z of each pixel, NaN where there is no depth, a row for each column of the image: surfaces are read so."""
    rows, columns = depth.shape
    near, row = np.empty((columns, rows)), np.empty(columns)
    for v in range(rows):
        for u in range(columns):
            z = depth[v, u]
            w = 1.0 / z
            row[u] = w if 0.0 < z < 1e6 else np.nan
        near[:, v] = row
    return near


@njit(cache=True, error_model="numpy")
@no_type_check
def cell_sums(nearness, size, fx, fy, cx, cy, near, far):
    """Return sums over each ``size × size`` cell of the pixels with a depth, cell by cell of the grid."""
    rows, columns = nearness.shape[1] // size, nearness.shape[0] // size
    least, most = 1.0 / far, 1.0 / near
    sums, ys = np.zeros((rows, columns, SUMS)), np.empty(nearness.shape[1])
    for v in range(ys.size):
        ys[v] = (v - cy) / fy
    for j in range(columns):
        for i in range(rows):
            n = 0
            a = b = c = d = e = f = g = h = k = 0.0
            for u in range(j * size, (j + 1) * size):
                x = (u - cx) / fx
                for v in range(i * size, (i + 1) * size):
                    w = nearness[u, v]
                    if not (least <= w <= most):
                        continue
                    y = ys[v]
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
            row = sums[i, j]
            row[COUNT], row[X], row[Y], row[XX], row[XY] = n, a, b, c, d
            row[YY], row[W], row[XW], row[YW], row[WW] = e, f, g, h, k
    return sums


@njit(cache=True, error_model="numpy")
@no_type_check
def fit_plane(s, plane):
    """Fill ``plane`` with n; return the RMS residual of w and the deviation of n over its length; NaN where none fits."""
    n = s[COUNT]
    if n < 6:
        return np.nan, np.nan
    mx, my, mw = s[X] / n, s[Y] / n, s[W] / n
    xx, xy, yy = s[XX] - n * mx * mx, s[XY] - n * mx * my, s[YY] - n * my * my
    xw, yw, ww = s[XW] - n * mx * mw, s[YW] - n * my * mw, s[WW] - n * mw * mw
    det = xx * yy - xy * xy
    if det <= 1e-9 * xx * yy or det <= 0.0 or xx <= ROUNDING * s[XX] or yy <= ROUNDING * s[YY]:
        return np.nan, np.nan
    alpha = (xw * yy - yw * xy) / det
    beta = (yw * xx - xw * xy) / det
    gamma = mw - alpha * mx - beta * my
    plane[0], plane[1], plane[2] = alpha, beta, gamma
    residual = math.sqrt(max(ww - alpha * xw - beta * yw, 0.0) / n)
    turn = residual / math.sqrt(min(xx, yy)) / math.sqrt(alpha * alpha + beta * beta + gamma * gamma)
    return residual, turn


@njit(cache=True, error_model="numpy")
@no_type_check
def plane_blocks(cells, full, residual_limit, depth_limit, turn_limit, least_residual):
    """Return the blocks of two cells by two that lie on one plane, and of one cell by two where no larger one does.

    A step far away is one cell high. Blocks overlap, so that an edge costs the least; a pixel may count four times.

    Args:
        full: Share of a block's pixels that must have a depth, times the pixels of a cell.
        residual_limit: RMS residual in 1/m that a block may have, or ``depth_limit`` in m of depth, whichever is wider.
        turn_limit: How well its normal must be known [rad].
        least_residual: Taken for the noise where a block shows less: a quantised depth may show none.

    Returns:
        Of each block its sums, n and its unit vector, the point in its middle, and its place: its first row and column of cells,
        and how many rows it has.
    """
    rows, columns = cells.shape[0], cells.shape[1]
    sums = np.empty((2 * rows * columns, SUMS))
    planes, units, centres = np.empty((2 * rows * columns, 3)), np.empty((2 * rows * columns, 3)), np.empty((2 * rows * columns, 3))
    places = np.empty((2 * rows * columns, 3), dtype=np.int64)
    large = np.zeros((rows + 1, columns), dtype=np.bool_)
    total, plane = np.empty(SUMS), np.empty(3)
    count = 0
    for height in (2, 1):
        for i in range(rows - height + 1):
            for j in range(columns - 1):
                if height == 1 and (large[i, j] or (i > 0 and large[i - 1, j])):
                    continue
                for k in range(SUMS):
                    total[k] = cells[i, j, k] + cells[i, j + 1, k]
                    if height == 2:
                        total[k] += cells[i + 1, j, k] + cells[i + 1, j + 1, k]
                if total[COUNT] < 2.0 * height * full:
                    continue
                residual, turn = fit_plane(total, plane)
                nearness = total[W] / total[COUNT]
                if not residual < max(residual_limit, depth_limit * nearness * nearness):
                    continue
                if turn * max(1.0, least_residual / max(residual, 1e-12)) > turn_limit:
                    continue
                large[i, j] = large[i, j] or height == 2
                sums[count] = total
                planes[count] = plane
                length = math.sqrt(plane[0] * plane[0] + plane[2] * plane[2] + plane[1] * plane[1])
                units[count, 0], units[count, 1], units[count, 2] = plane[0] / length, plane[1] / length, plane[2] / length
                x, y = total[X] / total[COUNT], total[Y] / total[COUNT]
                centres[count, 0], centres[count, 1], centres[count, 2] = x / nearness, y / nearness, 1.0 / nearness
                places[count, 0], places[count, 1], places[count, 2] = i, j, height
                count += 1
    return sums[:count].copy(), planes[:count].copy(), units[:count].copy(), centres[:count].copy(), places[:count].copy()


@njit(cache=True, error_model="numpy")
@no_type_check
def common_plane(sums, run, limits, start, stop, least, plane, inside):
    """Fit one plane to the blocks of a run that lie on it, starting with those from ``start`` to ``stop``; return how many do.

    Args:
        sums: Of all blocks.
        run: Numbers of the blocks in question.
        limits: RMS residual that each block may have.
        least: Blocks that a plane needs.
        plane: Filled with n.
        inside: Filled with which blocks lie on it.
    """
    total = np.empty(SUMS)
    for i in range(run.shape[0]):
        inside[i] = start <= i < stop
    count = stop - start
    for _ in range(3):
        if count < least:
            return 0
        total[:] = 0.0
        for i in range(run.shape[0]):
            if inside[i]:
                for k in range(SUMS):
                    total[k] += sums[run[i], k]
        residual, _turn = fit_plane(total, plane)
        if residual != residual:
            return 0
        changed, count = False, 0
        for i in range(run.shape[0]):
            fits = mean_square(sums[run[i]], plane) < limits[i] * limits[i]
            changed = changed or fits != inside[i]
            inside[i] = fits
            count += fits
        if not changed:
            break
    return count if count >= least else 0


@njit(cache=True, error_model="numpy")
@no_type_check
def planes_along(sums, centres, chosen, levels, gap, least, residual_limit, depth_limit, sample, fragment):
    """Return the planes among blocks, told apart by their level, of each run of blocks the fullest first.

    Things between two treads may join them to one run.

    Args:
        sums: Of all blocks, ``centres`` their middles.
        chosen: Numbers of the blocks in question, ordered by ``levels``.
        gap: Levels further apart than this are different surfaces.
        least: Blocks that a plane needs.
        residual_limit: RMS residual in 1/m that a block may have, or ``depth_limit`` in m of depth, whichever is wider.
        sample: Blocks that tell a plane's noise.
        fragment: Planes that many times smaller than one before them in their run are none.

    Returns:
        Blocks of all planes one after the other, where those of each plane end, their n and mean squared residuals.
    """
    members, stops = np.empty(chosen.shape[0], dtype=np.int64), np.empty(chosen.shape[0] // least, dtype=np.int64)
    normals, squares = np.empty((stops.shape[0], 3)), np.empty(stops.shape[0])
    limits, inside = np.empty(chosen.shape[0]), np.empty(chosen.shape[0], dtype=np.bool_)
    planes = held = stop = 0
    while stop < chosen.shape[0]:
        first, stop = stop, stop + 1
        while stop < chosen.shape[0] and not levels[stop] - levels[stop - 1] > gap:
            stop += 1
        run, at, fewest = chosen[first:stop].copy(), levels[first:stop].copy(), least
        while run.shape[0] >= fewest:
            count = run.shape[0]
            for i in range(count):
                depth = centres[run[i], 2]
                limits[i] = max(residual_limit, depth_limit / (depth * depth))
            start, end = _fullest(at, gap)
            if not common_plane(sums, run, limits, start, end, fewest, normals[planes], inside):
                break
            spread, begin, left = at[count - 1] - at[0], held, 0
            for i in range(count):
                if inside[i]:
                    members[held] = run[i]
                    held += 1
                else:
                    run[left], at[left] = run[i], at[i]
                    left += 1
            size = held - begin
            squares[planes] = mean_square_of(sums, members[begin:held], max(1, size // sample), normals[planes])
            stops[planes] = held
            planes += 1
            fewest = max(fewest, size // fragment)
            if spread <= gap:
                break
            run, at = run[:left], at[:left]
    return members[:held].copy(), stops[:planes].copy(), normals[:planes].copy(), squares[:planes].copy()


@njit(cache=True, error_model="numpy")
@no_type_check
def _fullest(levels, gap):
    """Return start and end of the most of some growing levels that are less than a gap apart."""
    start = end = stop = 0
    for i in range(levels.shape[0]):
        while stop < levels.shape[0] and levels[stop] < levels[i] + gap:
            stop += 1
        if stop - i > end - start:
            start, end = i, stop
    return start, end


@njit(cache=True, error_model="numpy")
@no_type_check
def mean_square(s, plane):
    """Return the mean squared residual of w of a block about a plane."""
    a, b, c = plane[0], plane[1], plane[2]
    quadratic = a * a * s[XX] + b * b * s[YY] + c * c * s[COUNT] + 2.0 * (a * b * s[XY] + a * c * s[X] + b * c * s[Y])
    linear = a * s[XW] + b * s[YW] + c * s[W]
    return max((s[WW] - 2.0 * linear + quadratic) / s[COUNT], 0.0)


@njit(cache=True, error_model="numpy")
@no_type_check
def mean_square_of(sums, members, step, plane):
    """Return the mean squared residual of w of every ``step``-th of some blocks about a plane."""
    square, count = 0.0, 0
    for i in range(0, members.shape[0], step):
        square += mean_square(sums[members[i]], plane)
        count += 1
    return square / count


@njit(cache=True, error_model="numpy")
@no_type_check
def solved_plane(s, plane, inverse):
    """Fill ``plane`` with n and ``inverse`` with that of its normal equations; return the mean square of what is left.

    NaN where the pixels have no plane.
    """
    if not fit_plane(s, plane)[0] >= 0.0:
        return np.nan
    n, x, y, xx, xy, yy = s[COUNT], s[X], s[Y], s[XX], s[XY], s[YY]
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = yy * n - y * y, xx * n - x * x, xx * yy - xy * xy
    inverse[0, 1] = inverse[1, 0] = x * y - xy * n
    inverse[0, 2] = inverse[2, 0] = xy * y - yy * x
    inverse[1, 2] = inverse[2, 1] = xy * x - xx * y
    inverse /= xx * inverse[0, 0] + xy * inverse[0, 1] + x * inverse[0, 2]
    left = s[WW] - plane[0] * s[XW] - plane[1] * s[YW] - plane[2] * s[W]
    return left / max(n - 3.0, 1.0)


@njit(cache=True, error_model="numpy")
@no_type_check
def box_of(places, members, size, margin, rows, columns, box):
    """Fill ``box`` with first column and row and last column and row of the pixels of some blocks, widened by a margin."""
    box[0], box[1], box[2], box[3] = columns, rows, 0, 0
    for k in members:
        i, j, height = places[k]
        box[0] = min(box[0], j * size - margin)
        box[1] = min(box[1], i * size - margin)
        box[2] = max(box[2], (j + 2) * size + margin)
        box[3] = max(box[3], (i + height) * size + margin)
    box[0], box[1] = max(box[0], 0), max(box[1], 0)
    box[2], box[3] = min(box[2], columns - 1), min(box[3], rows - 1)


@njit(cache=True, error_model="numpy")
@no_type_check
def _ending(near, v, way, start, slope, jump):
    """Return what follows a surface that ends at row ``v`` on the way up (-1) or down (1).

    Args:
        near: w along a column of the image; the surface has ``start + slope * v`` there.
    """
    rows = near.shape[0]
    first = second = np.nan
    for k in range(2, 5):
        row = v + way * k
        if 0 <= row < rows:
            off = near[row] - start - slope * row
            if off == off:
                first = off
                further = v + way * 2 * k
                if 0 <= further < rows:
                    second = near[further] - start - slope * further
                break
    if first != first or second != second:
        return UNKNOWN
    # Extrapolated back to the surface's end: what starts there is off by nothing, what lies behind by a jump.
    there = 2.0 * first - second
    if there < -jump and first < -jump:
        return BEYOND
    if there > jump and first > jump:
        return BEFORE
    return CREASE


@njit(cache=True, error_model="numpy")
@no_type_check
def surfaces(nearness, members, stops, places, size, planes, squares, tolerance, sigmas, jump, least_square, fx, fy, cx, cy):
    """Return the surfaces that some planes are of, each fitted to all of its pixels, with its ends in each column of the image.

    Args:
        nearness: w, a row for each column of the image.
        members: Blocks of all planes one after the other; ``stops`` tells where those of each plane end.
        places: Of all blocks, in cells of ``size`` pixels.
        planes: n of each plane, ``squares`` the mean squared residuals of its blocks.
        tolerance: How far off its plane a pixel may be in 1/m at least, and ``sigmas`` RMS residuals.
        jump: From which difference in 1/m two surfaces are apart.
        least_square: Taken for a surface's mean squared residual where it shows less.

    Returns:
        n of each surface, its covariance, a point in its middle, and in how many columns it is seen; none where its pixels have
        no plane. Then a row for each surface: these columns, half a pixel beyond its first and last row there, and what follows.
    """
    width, height, count = nearness.shape[0], nearness.shape[1], stops.shape[0]
    normals, covariances, centres = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty((count, 3))
    held, columns = np.zeros(count, dtype=np.int64), np.empty((count, width), dtype=np.int64)
    upper, lower = np.empty((count, width)), np.empty((count, width))
    above, below = np.empty((count, width), dtype=np.int64), np.empty((count, width), dtype=np.int64)
    rows, ys = np.empty(height), np.empty(height)
    for v in range(height):
        rows[v], ys[v] = v, (v - cy) / fy
    ray = np.ones(3)
    box, sums, begin = np.empty(4, dtype=np.int64), np.empty(SUMS), 0
    for s in range(count):
        box_of(places, members[begin : stops[s]], size, size + size // 2, height, width, box)
        begin, plane, off = stops[s], planes[s], max(tolerance, sigmas * math.sqrt(squares[s]))
        sums[:] = 0.0
        slope, k = plane[1] / fy, 0
        for u in range(box[0], box[2] + 1):
            near, x = nearness[u], (u - cx) / fx
            level = plane[0] * x + plane[2] - plane[1] * cy / fy
            first, last, found = _longest(near[box[1] : box[3] + 1], rows[box[1] : box[3] + 1], level, slope, off)
            first, last = first + box[1], last + box[1]
            if found < 3:
                continue
            columns[s, k], upper[s, k], lower[s, k] = u, first - 0.5, last + 0.5
            above[s, k] = _ending(near, first, -1, level, slope, jump)
            below[s, k] = _ending(near, last, 1, level, slope, jump)
            k += 1
            within = slice(first + 1, last)
            _add_column(near[within], rows[within], ys[within], x, level, slope, off, sums)
        n = sums[COUNT]
        square = solved_plane(sums, normals[s], covariances[s])
        # Pixels in one row or column have no plane.
        if n < size * size or square != square:
            continue
        held[s] = k
        ray[0], ray[1] = sums[X] / n, sums[Y] / n
        nearness_there = dot(normals[s], ray)
        for i in range(3):
            centres[s, i] = ray[i] / nearness_there
            for j in range(3):
                covariances[s, i, j] *= max(square, least_square)
    return normals, covariances, centres, held, columns, upper, lower, above, below


@njit(cache=True, error_model="numpy")
@no_type_check
def _longest(near, rows, level, slope, off):
    """Return where the longest run of a column's pixels on a plane starts and ends, and how many they are; gaps do not end it."""
    begin, end, best = -1, -1, 0
    first, missed, found = -1, GAP_PX + 1, 0
    for i in range(near.size):
        if abs(near[i] - level - slope * rows[i]) < off:
            if missed > GAP_PX:
                first, found = i, 0
            found += 1
            missed = 0
            if found > best:
                begin, end, best = first, i, found
        else:
            missed += 1
    return begin, end, best


@njit(cache=True, error_model="numpy")
@no_type_check
def _add_column(near, rows, ys, x, level, slope, off, sums):
    """Add the pixels on a plane in a part of a column to a surface's sums; along a column x is one number."""
    n = 0
    a = b = c = d = e = 0.0
    for i in range(near.size):
        w, y = near[i], ys[i]
        if not abs(w - level - slope * rows[i]) < off:
            continue
        n += 1
        a += y
        b += y * y
        c += w
        d += y * w
        e += w * w
    sums[COUNT] += n
    sums[X] += n * x
    sums[Y] += a
    sums[XX] += n * x * x
    sums[XY] += x * a
    sums[YY] += b
    sums[W] += c
    sums[XW] += x * c
    sums[YW] += d
    sums[WW] += e


@njit(cache=True, error_model="numpy")
@no_type_check
def fit_line(u, v, near, line):
    """Fill ``line`` with the line v = v₀ + a (u - u₀) that most points lie on; return how many.

    Args:
        u: Columns, growing.
        v: Rows of the points.
        near: Distance in rows within which a point counts as on the line.
        line: a, v₀, u₀ and the variances of a and v₀. Neighbouring points err together (a row is a whole number): the
            variances come from the means of eighths of the line.
    """
    n = len(u)
    line[:] = np.nan
    if n < 16:
        return 0
    best, a, b = 0, 0.0, 0.0
    half = n // 2
    step = max(1, half // 24)
    for i in range(0, n - half, step):
        slope = (v[i + half] - v[i]) / (u[i + half] - u[i])
        level = v[i] - slope * u[i]
        count = 0
        for k in range(n):
            if abs(v[k] - level - slope * u[k]) < near:
                count += 1
        if count > best:
            best, a, b = count, slope, level
    # Ragged edges scatter by more than a first look allows; cutting them would call them smooth.
    far = np.empty(n)
    for k in range(n):
        far[k] = abs(v[k] - b - a * u[k])
    middle = np.median(far[far < 3.0 * near])
    near = min(max(near, WIDENED * middle), 3.0 * near)
    for _ in range(3):
        count, su, sv = 0, 0.0, 0.0
        for k in range(n):
            if abs(v[k] - b - a * u[k]) < near:
                count += 1
                su += u[k]
                sv += v[k]
        if count < 16:
            return 0
        mu, mv = su / count, sv / count
        uu, uv = 0.0, 0.0
        for k in range(n):
            if abs(v[k] - b - a * u[k]) < near:
                uu += (u[k] - mu) ** 2
                uv += (u[k] - mu) * (v[k] - mv)
        if uu <= 0.0:
            return 0
        a = uv / uu
        b = mv - a * mu
    parts, square, within, filled = np.zeros(8), 0.0, 0, 0
    held = np.zeros(8)
    for k in range(n):
        off = v[k] - b - a * u[k]
        if abs(off) < near:
            part = min(8 * within // count, 7)
            parts[part] += off
            held[part] += 1.0
            square += off * off
            within += 1
    spread = 0.0
    for part in range(8):
        if held[part] > 0.0:
            spread += held[part] * (parts[part] / held[part]) ** 2
            filled += 1
    # As many square errors as points where neighbours err on their own; more where they err together. Two are used up.
    square = max(square / max(within - 2, 1), spread / max(filled - 2, 1))
    line[0], line[1], line[2], line[3], line[4] = a, mv, mu, square / uu, square / count
    return count


@njit(cache=True, error_model="numpy")
@no_type_check
def nosing_line(columns, rows, follows, plane, near, least, beyond, aliasing, fx, fy, cx, cy):
    """Return the line at which a surface ends before something further away, or at a corner, and the plane through it and the eye.

    Args:
        rows: Where the surface ends in each of its columns, and ``follows`` what lies there.
        plane: n of the surface.
        near: Distance in rows within which a point counts as on the line.
        least: Columns that a line must have.
        beyond: Share of the end at which what follows must lie further away: else it is a corner.
        aliasing: By how many rows a line's ends may be off against each other however many points it has.

    Returns:
        In how many columns it is seen, 0 where there is none; whether it is a corner; the plane's unit normal and its covariance;
        the line's middle and ends on the surface; u1, v1, u2, v2 of its ends, the left one first.
    """
    normal, covariance, points, ends = np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty(4)
    held = np.zeros(UNKNOWN + 1, dtype=np.int64)
    for what in follows:
        held[what] += 1
    share = beyond * (follows.size - held[UNKNOWN])
    is_corner = held[BEYOND] < share
    wanted = CREASE if is_corner else BEYOND
    if held[wanted] < max(least, share):
        return 0, is_corner, normal, covariance, points, ends
    u, v, line, count = np.empty(held[wanted]), np.empty(held[wanted]), np.empty(5), 0
    for k in range(follows.size):
        if follows[k] == wanted:
            u[count], v[count] = columns[k], rows[k]
            count += 1
    count = fit_line(u, v, near, line)
    if count < least:
        return 0, is_corner, normal, covariance, points, ends
    a, v0, u0 = line[0], line[1], line[2]
    # What else ends at the surface's level, across a wall beside the flight, is no part of the line.
    left, right = u[-1], u[0]
    for k in range(u.size):
        if abs(v[k] - v0 - a * (u[k] - u0)) < near:
            left, right = min(left, u[k]), max(right, u[k])
    if left >= right:
        return 0, is_corner, normal, covariance, points, ends
    ends[0], ends[1], ends[2], ends[3] = left, v0 + a * (left - u0), right, v0 + a * (right - u0)
    for k, at, row in ((0, u0, v0 + a * (u0 - u0)), (1, ends[0], ends[1]), (2, ends[2], ends[3])):
        ray = points[k]
        ray[0], ray[1], ray[2] = (at - cx) / fx, (row - cy) / fy, 1.0
        nearness = along(ray, plane)
        if nearness <= 0.0:  # behind the camera
            return 0, is_corner, normal, covariance, points, ends
        ray[0], ray[1], ray[2] = ray[0] / nearness, ray[1] / nearness, ray[2] / nearness
    _through_eye(a, v0, u0, line[3] + (aliasing / (right - left)) ** 2, line[4], fx, fy, cx, cy, normal, covariance)
    return count, is_corner, normal, covariance, points, ends


@njit(cache=True, error_model="numpy")
@no_type_check
def along(point, direction):
    """Return how far a point lies along a direction, as BLAS rounds it for a row of points."""
    return fused(point[2], direction[2], fused(point[0], direction[0], point[1] * direction[1]))


@njit(cache=True, error_model="numpy")
@no_type_check
def span(points, members, direction):
    """Return from where to where some of many points lie along a direction."""
    low, high = np.inf, -np.inf
    for k in members:
        place = along(points[k], direction)
        low, high = min(low, place), max(high, place)
    return low, high


@njit(cache=True, error_model="numpy")
@no_type_check
def height_of_end(columns, rows, follows, plane, up, fx, fy, cx, cy):
    """Return the median height at which a surface ends, NaN where most of its end is cut off."""
    heights, count, ray = np.empty(columns.size), 0, np.ones(3)
    for k in range(columns.size):
        if follows[k] != UNKNOWN:
            ray[0], ray[1] = (columns[k] - cx) / fx, (rows[k] - cy) / fy
            heights[count] = along(ray, up) / along(ray, plane)
            count += 1
    return np.nan if 2 * count < columns.size or count == 0 else np.median(heights[:count])


@njit(cache=True, error_model="numpy")
@no_type_check
def middle_of(units, told, spread, bundle, least, mean):
    """Fill ``mean`` with the mean of unit vectors in a bundle about a direction; return whether there are enough.

    Args:
        units: Each stands for its opposite as well.
        spread: Cosine from which one is near enough to ``told`` for the bundle's middle to be sought there.
        bundle: Cosine to that middle from which one is of the bundle.
    """
    near, count = np.empty((3, units.shape[0])), 0
    for k in range(units.shape[0]):
        cosine = along(units[k], told)
        if abs(cosine) > spread:
            for i in range(3):
                near[i, count] = -units[k, i] if cosine < 0.0 else units[k, i]
            count += 1
    if count < least:
        return False
    middle, total, held = np.empty(3), np.zeros(3), 0
    for i in range(3):
        middle[i] = np.median(near[i, :count])
    length = math.sqrt(dot(middle, middle))
    for i in range(3):
        middle[i] /= length
    for k in range(count):
        if along(near[:, k], middle) > bundle:
            for i in range(3):
                total[i] += near[i, k]
            held += 1
    if held < least:
        return False
    for i in range(3):
        total[i] /= held
    length = math.sqrt(dot(total, total))
    for i in range(3):
        mean[i] = total[i] / length
    return True


@njit(cache=True, error_model="numpy")
@no_type_check
def _through_eye(a, v0, u0, var_a, var_v, fx, fy, cx, cy, m, covariance):
    """Fill ``m`` with the unit normal of the plane through the eye and the line v = v₀ + a (u - u₀), and its covariance."""
    # y = A x + B in the coordinates of rays.
    A = a * fx / fy
    B = (v0 + a * (cx - u0) - cy) / fy
    length = math.sqrt(A * A + 1.0 + B * B)
    m[0], m[1], m[2] = A / length, -1.0 / length, B / length
    by_a = np.array([fx / fy / length, 0.0, (cx - u0) / fy / length])
    by_v = np.array([0.0, 0.0, 1.0 / fy / length])
    across_a, across_v = dot(m, by_a), dot(m, by_v)
    for i in range(3):
        by_a[i], by_v[i] = by_a[i] - across_a * m[i], by_v[i] - across_v * m[i]
    for i in range(3):
        for j in range(3):
            covariance[i, j] = var_a * (by_a[i] * by_a[j]) + var_v * (by_v[i] * by_v[j])


@njit(cache=True, error_model="numpy")
@no_type_check
def points_above(depth, stride, fx, fy, cx, cy, axes, level, foot, low, blur, high, begin, start, end):
    """Return the points of every ``stride``-th pixel that stand above a flight.

    Args:
        axes: Rows: ahead, the nosing plane's normal, up.
        level: Height of the nosing plane along its normal; ``foot``: height of what lies before it along up.
        low: Height above these from which a point counts, ``blur`` times its depth where that is more, and up to which, ``high``.
        begin: Places ahead that count: the foot from ``begin`` to ``start``, the nosing plane from there to ``end``.
    """
    rows, columns = depth.shape
    found = np.empty((((rows + stride - 1) // stride) * ((columns + stride - 1) // stride), 3))
    count = 0
    for v in range(0, rows, stride):
        y = (v - cy) / fy
        for u in range(0, columns, stride):
            z = depth[v, u]
            if not (z > 0.0 and z < 1e6):
                continue
            x = (u - cx) / fx
            ahead = z * (axes[0, 0] * x + axes[0, 1] * y + axes[0, 2])
            if not (begin < ahead < end):
                continue
            if ahead < start:
                above = z * (axes[2, 0] * x + axes[2, 1] * y + axes[2, 2]) - foot
            else:
                above = z * (axes[1, 0] * x + axes[1, 1] * y + axes[1, 2]) - level
            if not (max(low, blur * z) < above < high):
                continue
            found[count, 0], found[count, 1], found[count, 2] = x * z, y * z, z
            count += 1
    return found[:count].copy()


@njit(cache=True, error_model="numpy")
@no_type_check
def depths_at(depth, aheads, asides, heights, axes, fx, fy, cx, cy):
    """Return the depth seen at the points of a grid and the depth they would have, where both exist.

    Args:
        axes: Rows: the directions in C that ``aheads``, ``asides`` and ``heights`` are along.
    """
    seen, expected = np.empty(aheads.size * asides.size * heights.size), np.empty(aheads.size * asides.size * heights.size)
    count, point = 0, np.empty(3)
    for ahead in aheads:
        for height in heights:
            for aside in asides:
                for i in range(3):
                    point[i] = fused(height, axes[2, i], fused(aside, axes[1, i], ahead * axes[0, i]))
                if not point[2] > 0.1:
                    continue
                u, v = np.rint(fx * point[0] / point[2] + cx), np.rint(fy * point[1] / point[2] + cy)
                if not (0 <= u < depth.shape[1] and 0 <= v < depth.shape[0]):
                    continue
                z = depth[int(v), int(u)]
                if np.isfinite(z) and z > 0.0:
                    seen[count], expected[count] = z, point[2]
                    count += 1
    return seen[:count].copy(), expected[:count].copy()


@njit(cache=True, error_model="numpy")
@no_type_check
def places_of(depth, stride, fx, fy, cx, cy, origin, axes):
    """Return pixels as points of C, NaN where there is no depth, and their places along some directions.

    Args:
        depth: Of every ``stride``-th pixel of every ``stride``-th row.
        origin: Added to each point.
        axes: Rows: the directions along which the places are told.
    """
    rows, columns = depth.shape
    points, places = np.empty((rows, columns, 3)), np.empty((axes.shape[0], rows, columns))
    for i in range(rows):
        y = (i * stride - cy) / fy
        for j in range(columns):
            z = depth[i, j] if depth[i, j] > 0.0 else np.nan
            point = points[i, j]
            point[0], point[1], point[2] = (j * stride - cx) / fx * z + origin[0], y * z + origin[1], z + origin[2]
            for k in range(axes.shape[0]):
                places[k, i, j] = dot(point, axes[k])
    return points, places


@njit(cache=True, error_model="numpy")
@no_type_check
def level_patches(points, up, level):
    """Return which points of a grid lie in level patches, five points wide.

    Args:
        points: Rows and columns of points, NaN where there is none.
        level: Cosine between a patch's normal and ``up`` from which it is level.
    """
    rows, columns = points.shape[0], points.shape[1]
    found = np.zeros((rows, columns), dtype=np.bool_)
    for i in range(2, rows - 2):
        for j in range(2, columns - 2):
            top, bottom, left, right = points[i - 2, j], points[i + 2, j], points[i, j - 2], points[i, j + 2]
            ax, ay, az = bottom[0] - top[0], bottom[1] - top[1], bottom[2] - top[2]
            bx, by, bz = right[0] - left[0], right[1] - left[1], right[2] - left[2]
            nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            rise = abs(nx * up[0] + ny * up[1] + nz * up[2])
            found[i, j] = rise > level * math.sqrt(nx * nx + ny * ny + nz * nz)
    return found


@njit(cache=True, error_model="numpy")
@no_type_check
def ground_level(points, up, level, far, aside, height, furthest, bin_size, least, width, highest):
    """Return the height of the highest or lowest level of a grid of points that is wide enough to drive on; NaN without one.

    Args:
        points: Rows and columns of points, NaN where there is none.
        level: Cosine between a patch's normal and ``up`` from which it is level.
        far: Place of each point ahead, ``aside`` and ``height`` likewise.
        furthest: Patches beyond this do not count.
        bin_size: Difference in height within which patches are of one level.
        least: Patches that a level needs in its own and the next bin.
        width: Extent across that a level must exceed.
        highest: Whether the highest such level is wanted, else the lowest.
    """
    patches = level_patches(points, up, level)
    heights, sides, bins = np.empty(patches.size), np.empty(patches.size), np.empty(patches.size, dtype=np.int64)
    count = 0
    for i in range(patches.shape[0]):
        for j in range(patches.shape[1]):
            if patches[i, j] and far[i, j] < furthest:
                heights[count], sides[count] = height[i, j], aside[i, j]
                bins[count] = np.int64(math.floor(height[i, j] / bin_size))
                count += 1
    order = np.sort(bins[:count])
    within = np.empty(count)
    last = count if highest else -1
    while True:
        # The next bin in the order in which levels are tried.
        following = last - 1 if highest else last + 1
        if not 0 <= following < count:
            return np.nan
        place = order[following]
        first, stop = np.searchsorted(order, place), np.searchsorted(order, place, side="right")
        last = first if highest else stop - 1
        beside = place - 1 if highest else place + 1
        together = stop - first + np.searchsorted(order, beside, side="right") - np.searchsorted(order, beside)
        if together < least:
            continue
        low, high, held = np.inf, -np.inf, 0
        for k in range(count):
            if bins[k] == place or bins[k] == beside:
                low, high = min(low, sides[k]), max(high, sides[k])
                within[held] = heights[k]
                held += 1
        if high - low > width:
            return np.median(within[:held])
