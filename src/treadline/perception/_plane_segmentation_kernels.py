"""Planes in a depth image: blocks, surfaces, their ends and the lines at them; compiled.

With w = 1/Z a plane n·p = 1 is linear in the image, w = n·(x, y, 1), and the noise of a disparity sensor is uniform. ``pinhole`` is
fx, fy, cx, cy in pixels.
"""

import math
from typing import no_type_check

import numpy as np

from treadline.core.fma import dot, fused
from treadline.core.kernel_cache import njit

COUNT, X, Y, XX, XY, YY, W, XW, YW, WW = range(10)
SUMS = 10
GAP_PX = 2
"""Number of pixels off a surface that do not end it: a hole, a speck."""
ROUNDING = 1e-11
"""Relative threshold of a centred sum of squares: pixels in a single row or column. Two rows at the image border give 1e-6."""
HOLE_SHARE = 12
"""Image rows divided by the longest hole past which the surroundings of a surface's end are evaluated: the infrared shadow of a
nosing, a strip without return, the occlusion of a stereo camera."""
WIDENED = 3.7
"""Number of median deviations within which points of a line are kept: 2.5 sigma of a normal error."""
VAGUE_SHARE = 0.4
"""Least fraction of a surface's end on one line if nothing is known of its surroundings."""
BORDER_PX = 4
"""Distance from the image border within which a surface's end is the image's."""
CREASE, BEYOND, BEFORE, UNKNOWN = 0, 1, 2, 3
"""Codes for the surroundings of a surface's end: an adjacent surface, a surface behind, an object in front, unknown."""


@njit(cache=True, error_model="numpy")
@no_type_check
def nearness_of(depth):
    """Return w = 1/Z of each pixel, NaN without depth, transposed: one row per image column, as surfaces are read by columns."""
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
def cell_sums(nearness, size, pinhole, near, far):
    """Return sums over the valid pixels of each ``size × size`` cell of the grid."""
    fx, fy, cx, cy = pinhole
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
    """Fill ``plane`` with n; return the RMS residual of w and the relative standard deviation of n; NaN without a fit."""
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
def block_residuals(cells, full):
    """Return the RMS residuals of all blocks of 2×2 cells about their own planes [1/m], whether they are planar or not.

    The second column is the square of a block's diagonal contrast, the part of its cells' means that no plane explains, relative
    to that of white noise of the same size.
    """
    rows, columns = cells.shape[0], cells.shape[1]
    found, total, plane, count = np.empty((rows * columns, 2)), np.empty(SUMS), np.empty(3), 0
    for i in range(rows - 1):
        for j in range(columns - 1):
            for k in range(SUMS):
                total[k] = cells[i, j, k] + cells[i, j + 1, k] + cells[i + 1, j, k] + cells[i + 1, j + 1, k]
            if total[COUNT] < 4.0 * full:
                continue
            residual, _turn = fit_plane(total, plane)
            if residual == residual:
                contrast, variance = 0.0, 0.0
                for a in range(2):
                    for b in range(2):
                        s = cells[i + a, j + b]
                        off = s[W] - plane[0] * s[X] - plane[1] * s[Y] - plane[2] * s[COUNT]
                        contrast += (1.0 if a == b else -1.0) * off / max(s[COUNT], 1.0)
                        variance += residual * residual / max(s[COUNT], 1.0)
                found[count, 0], found[count, 1] = residual, contrast * contrast / max(variance, 1e-30)
                count += 1
    return found[:count].copy()


@njit(cache=True, error_model="numpy")
@no_type_check
def plane_blocks(cells, full, residual_limit, depth_limit, turn_limit, least_residual):
    """Return the blocks of 2×2 cells on one plane, and blocks of 1×2 cells where no larger one fits.

    A distant step is one cell high. Blocks overlap, so that less is lost at edges; a pixel can count four times.

    Args:
        full: Least fraction of a block's pixels with depth, times the pixels of a cell.
        residual_limit: Largest RMS residual of a block in 1/m, or ``depth_limit`` in m of depth, whichever is larger.
        turn_limit: Largest standard deviation of its normal [rad].
        least_residual: Lower limit of the assumed noise of a block: a quantised depth can have none.

    Returns:
        For each block its sums, n and its unit vector, its centre, and its place: first row and column of cells, and number of
        rows.
    """
    rows, columns = cells.shape[0], cells.shape[1]
    sums = np.empty((2 * rows * columns, SUMS))
    planes, units, centres = np.empty((2 * rows * columns, 3)), np.empty((2 * rows * columns, 3)), np.empty((2 * rows * columns, 3))
    places, turns = np.empty((2 * rows * columns, 3), dtype=np.int64), np.empty(2 * rows * columns)
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
                turns[count] = turn * max(1.0, least_residual / max(residual, 1e-12))
                if turns[count] > turn_limit:
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
    found = sums[:count].copy(), planes[:count].copy(), units[:count].copy(), centres[:count].copy(), places[:count].copy()
    return (*found, turns[:count].copy())


@njit(cache=True, error_model="numpy")
@no_type_check
def noise_law(sums, planes, depths, places, parts):
    """Return the exponent of the noise of w over depth, from medians over ``parts`` ranges of depth, and the span of log depth.

    A disparity has the same noise at all depths, an exponent of 0. A range whose error does not grow has -2.
    """
    logs, noise, count = np.empty(depths.size), np.empty(depths.size), 0
    for k in range(depths.size):
        if places[k, 2] == 2:
            logs[count] = math.log(depths[k])
            noise[count] = 0.5 * math.log(max(mean_square(sums[k], planes[k]), 1e-14))
            count += 1
    if count < 4 * parts:
        return 0.0, 0.0
    order = np.argsort(logs[:count])
    x, y = np.empty(parts), np.empty(parts)
    for part in range(parts):
        members = order[part * count // parts : (part + 1) * count // parts]
        x[part], y[part] = np.median(logs[members]), np.median(noise[members])
    span = x[parts - 1] - x[0]
    x -= x.mean()
    return dot(x, y) / max(dot(x, x), 1e-12), span


@njit(cache=True, error_model="numpy")
@no_type_check
def common_plane(sums, run, limits, start, stop, least, plane, inside):
    """Fit one plane to the blocks of a run, starting with those from ``start`` to ``stop``; return the number of blocks on it.

    Args:
        sums: Sums of all blocks.
        run: Indices of the blocks in question.
        limits: Largest RMS residual of each block.
        least: Least number of blocks of a plane.
        plane: Filled with n.
        inside: Filled with the mask of blocks on the plane.
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
    """Return the planes among blocks, separated by their level, the largest first in each run of blocks.

    Objects between two treads can join them to one run.

    Args:
        sums: Sums of all blocks, ``centres`` their centres.
        chosen: Indices of the blocks in question, ordered by ``levels``.
        gap: Separation of different surfaces.
        least: Least number of blocks of a plane.
        residual_limit: Largest RMS residual of a block in 1/m, or ``depth_limit`` in m of depth, whichever is larger.
        sample: Number of blocks used to estimate a plane's noise.
        fragment: Ratio of block counts above which a smaller plane of the same run is rejected.

    Returns:
        PlanarBlocks of all planes, concatenated, the end index of each plane, their n and mean squared residuals.
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
    """Return start and end of the largest group of increasing levels within a gap."""
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
    """Return the mean squared residual of w of every ``step``-th block about a plane."""
    square, count = 0.0, 0
    for i in range(0, members.shape[0], step):
        square += mean_square(sums[members[i]], plane)
        count += 1
    return square / count


@njit(cache=True, error_model="numpy")
@no_type_check
def solved_plane(s, plane, inverse):
    """Fill ``plane`` with n and ``inverse`` with the inverse of its normal equations; return the mean squared residual.

    NaN if the pixels do not determine a plane.
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
    """Fill ``box`` with first column and row and last column and row of the pixels of some blocks, extended by a margin."""
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
    """Return the code for the surroundings of a surface's end at row ``v``, upwards (-1) or downwards (1).

    Args:
        near: w along a column of the image; the surface has ``start + slope * v`` there.
    """
    rows = near.shape[0]
    first = second = np.nan
    hole = max(5, rows // HOLE_SHARE)
    for k in range(2, hole):
        row = v + way * k
        if not 0 <= row < rows:
            break
        off = near[row] - start - slope * row
        if off == off:
            first = off
            # Behind a wide hole the second pixel is the next one: twice the distance would reach a further surface.
            further = v + way * 2 * k if k < 5 else row + way * 2
            if 0 <= further < rows:
                second = near[further] - start - slope * further
            break
    if first != first or second != second:
        return UNKNOWN
    if k >= 5:
        # A hole can hide a crease, so only a jump is certain.
        if max(first, second) < -jump:
            return BEYOND
        return BEFORE if min(first, second) > jump else UNKNOWN
    # Extrapolated back to the surface's end: an adjacent surface has no offset there, the background has a jump.
    there = 2.0 * first - second
    if there < -jump and first < -jump:
        return BEYOND
    if there > jump and first > jump:
        return BEFORE
    return CREASE


@njit(cache=True, error_model="numpy")
@no_type_check
def surfaces(nearness, members, stops, places, size, planes, squares, tolerance, sigmas, jump, aside, least_square, pinhole):
    """Return the surfaces of some planes, each fitted to all of its pixels, with its ends in each column of the image.

    Args:
        nearness: w, one row per column of the image.
        members: PlanarBlocks of all planes, concatenated; ``stops`` the end index of each plane.
        places: Places of all blocks, in cells of ``size`` pixels.
        planes: n of each plane, ``squares`` the mean squared residuals of its blocks.
        tolerance: Least distance from the plane for a pixel to be rejected [1/m], and ``sigmas`` the same in RMS residuals.
        jump: Difference separating two surfaces [1/m].
        aside: Largest lateral distance of a wall next to a surface [m].
        least_square: Lower limit of a surface's mean squared residual.

    Returns:
        n of each surface, its covariance, its centre, and its number of columns; none if its pixels do not determine a plane. Then
        one row per surface: these columns, half a pixel beyond its first and last row there, and the codes of its surroundings.
    """
    fx, fy, cx, cy = pinhole
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
        # Pixels of a side wall near its crease lie on the plane as well, and would turn it.
        margin = int(math.ceil(off * fx * aside))
        for inner in (margin, 0):
            sums[:] = 0.0
            for i in range(k):
                u, left, right = columns[s, i], i - inner, i + inner
                if left < 0 or right >= k or columns[s, right] - columns[s, left] > 2 * inner:
                    continue
                first = max(upper[s, left], upper[s, i], upper[s, right])
                last = min(lower[s, left], lower[s, i], lower[s, right])
                within = slice(int(first + 1.5), int(max(last - 0.5, 0.0)))
                near, x = nearness[u], (u - cx) / fx
                level = plane[0] * x + plane[2] - plane[1] * cy / fy
                _add_column(near[within], rows[within], ys[within], x, level, slope, off, sums)
            if sums[COUNT] >= 4 * size * size:
                break
        n = sums[COUNT]
        square = solved_plane(sums, normals[s], covariances[s])
        # Pixels in a single row or column do not determine a plane.
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
    """Return start, end and number of pixels of the longest run on a plane in a column; short gaps do not end a run."""
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
    """Add the pixels on a plane in a part of a column to a surface's sums; x is constant along a column."""
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
def along(point, direction):
    """Return the coordinate of a point along a direction, rounded as by BLAS for a row of points."""
    return fused(point[2], direction[2], fused(point[0], direction[0], point[1] * direction[1]))


@njit(cache=True, error_model="numpy")
@no_type_check
def span(points, members, direction):
    """Return the range of some of many points along a direction."""
    low, high = np.inf, -np.inf
    for k in members:
        place = along(points[k], direction)
        low, high = min(low, place), max(high, place)
    return low, high


@njit(cache=True, error_model="numpy")
@no_type_check
def middle_of(units, start, spread, bundle, least, mean):
    """Fill ``mean`` with the mean of unit vectors in a bundle about a direction; return whether there are enough.

    Args:
        units: Unit vectors; the sign is irrelevant.
        spread: Cosine of the largest angle from ``start`` in the search for the centre of the bundle.
        bundle: Cosine of the largest angle of a member from that centre.
    """
    near, count = np.empty((3, units.shape[0])), 0
    for k in range(units.shape[0]):
        cosine = along(units[k], start)
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
def fit_line(u, v, near, line):
    """Fill ``line`` with the line v = v₀ + a (u - u₀) through most points; return the number of points on it.

    Args:
        u: Columns, increasing.
        v: Rows of the points.
        near: Largest distance of a point from the line [rows].
        line: a, v₀, u₀ and the variances of a and v₀. Errors of adjacent points are correlated (rows are integers): the variances
            are estimated from the means of eighths of the line.
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
    # Ragged edges scatter by more than the first tolerance; truncation would underestimate the scatter.
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
    # Sum of squares for independent errors of adjacent points; correlated errors give more. Two degrees of freedom are used.
    square = max(square / max(within - 2, 1), spread / max(filled - 2, 1))
    line[0], line[1], line[2], line[3], line[4] = a, mv, mu, square / uu, square / count
    return count


@njit(cache=True, error_model="numpy")
@no_type_check
def nosing_line(columns, rows, follows, plane, height, near, least, beyond, aliasing, pinhole):
    """Return the line at a surface's end before a larger depth or at a corner, and the plane through line and camera centre.

    Args:
        rows: End row of the surface in each of its columns, and ``follows`` the codes of its surroundings.
        plane: n of the surface.
        height: Number of image rows.
        near: Largest distance of a point from the line [rows].
        least: Least number of columns of a line.
        beyond: Least fraction of the end with a larger depth behind; otherwise the line is a corner.
        aliasing: Lower limit of the relative error of a line's ends [rows], for any number of points.

    Returns:
        Number of columns, 0 without a line; its kind: ``BEYOND`` for a larger depth behind, ``CREASE`` for a corner, ``UNKNOWN``
        for a line past which nothing is known; the plane's unit normal and its covariance; the line's middle and ends on the
        surface; u1, v1, u2, v2 of its ends, the left one first.
    """
    fx, fy, cx, cy = pinhole
    normal, covariance, points, ends = np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty(4)
    held = np.zeros(UNKNOWN + 1, dtype=np.int64)
    for what in follows:
        held[what] += 1
    share = beyond * (follows.size - held[UNKNOWN])
    kind = CREASE if held[BEYOND] < share else BEYOND
    u, v, line, count = np.empty(follows.size), np.empty(follows.size), np.empty(5), 0
    if held[kind] >= max(least, share):
        for k in range(follows.size):
            if follows[k] == kind:
                u[count], v[count] = columns[k], rows[k]
                count += 1
    usable = count
    count = fit_line(u[:usable], v[:usable], near, line) if usable else 0
    if count < least:
        kind, usable = UNKNOWN, 0
        for k in range(follows.size):
            if follows[k] != BEFORE and BORDER_PX <= rows[k] < height - BORDER_PX:
                u[usable], v[usable] = columns[k], rows[k]
                usable += 1
        if usable < max(least, 0.5 * follows.size):
            return 0, kind, normal, covariance, points, ends
        count = fit_line(u[:usable], v[:usable], near, line)
        if count < max(least, VAGUE_SHARE * usable):
            return 0, kind, normal, covariance, points, ends
    u, v = u[:usable], v[:usable]
    a, v0, u0 = line[0], line[1], line[2]
    # Other ends at the surface's level, beyond a wall next to the flight, do not belong to the line.
    left, right = u[-1], u[0]
    for k in range(u.size):
        if abs(v[k] - v0 - a * (u[k] - u0)) < near:
            left, right = min(left, u[k]), max(right, u[k])
    if left >= right:
        return 0, kind, normal, covariance, points, ends
    ends[0], ends[1], ends[2], ends[3] = left, v0 + a * (left - u0), right, v0 + a * (right - u0)
    for k, at, row in ((0, u0, v0 + a * (u0 - u0)), (1, ends[0], ends[1]), (2, ends[2], ends[3])):
        ray = points[k]
        ray[0], ray[1], ray[2] = (at - cx) / fx, (row - cy) / fy, 1.0
        nearness = along(ray, plane)
        if nearness <= 0.0:  # behind the camera
            return 0, kind, normal, covariance, points, ends
        ray[0], ray[1], ray[2] = ray[0] / nearness, ray[1] / nearness, ray[2] / nearness
    _through_eye(a, v0, u0, line[3] + (aliasing / (right - left)) ** 2, line[4], pinhole, normal, covariance)
    return count, kind, normal, covariance, points, ends


@njit(cache=True, error_model="numpy")
@no_type_check
def height_of_end(columns, rows, follows, plane, up, height, pinhole):
    """Return the median height of a surface's end; NaN if an object in front or the image border cuts off most of it.

    Args:
        height: Number of image rows.
    """
    fx, fy, cx, cy = pinhole
    heights, count, ray = np.empty(columns.size), 0, np.ones(3)
    for k in range(columns.size):
        if follows[k] != BEFORE and BORDER_PX <= rows[k] < height - BORDER_PX:
            ray[0], ray[1] = (columns[k] - cx) / fx, (rows[k] - cy) / fy
            heights[count] = along(ray, up) / along(ray, plane)
            count += 1
    return np.nan if 2 * count < columns.size or count == 0 else np.median(heights[:count])


@njit(cache=True, error_model="numpy")
@no_type_check
def _through_eye(a, v0, u0, var_a, var_v, pinhole, m, covariance):
    """Fill ``m`` with the unit normal of the plane through camera centre and line v = v₀ + a (u - u₀), and its covariance."""
    fx, fy, cx, cy = pinhole
    # Line y = A x + B in normalised image coordinates.
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
