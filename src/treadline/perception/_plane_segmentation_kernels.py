"""Planes in a depth image: blocks, surfaces, their ends and the lines at them; compiled.

With w = 1/Z a plane n·p = 1 is linear in the image, w = n·(x, y, 1), and the noise of a disparity sensor is uniform. ``pinhole`` is
fx, fy, cx, cy in pixels. The ten sums over some pixels are those of 1, x, y, x², xy, y², w, xw, yw and w², in this order.
"""

import math

import numpy as np

from treadline.core.fma import dot, fused
from treadline.core.kernel_cache import njit

GAP_PX = 2
"""Number of pixels off a surface that do not end it: a hole, a speck."""
FRAGMENT = 8
"""Ratio of block counts above which a smaller plane on the same level counts as a wrinkle: without it, furniture takes twice the
time."""
ROUNDING = 1e-11
"""Relative threshold of a centred sum of squares: pixels in a single row or column. Two rows at the image border give 1e-6."""
HOLE_SHARE = 12
"""Image rows divided by the longest hole past which the surroundings of a surface's end are evaluated: the infrared shadow of a
nosing, a strip without return, the occlusion of a stereo camera."""
WIDENED = 3.7
"""Number of median deviations within which points of a line are kept: 2.5 sigma of a normal error."""
BORDER_PX = 4
"""Distance from the image border within which a surface's end is the image's."""
CREASE, BEYOND, BEFORE, UNKNOWN = 0, 1, 2, 3
"""Codes for the surroundings of a surface's end: an adjacent surface, a surface behind, an object in front, unknown."""


@njit(cache=True, error_model="numpy")
def pooled(depth, side, jump):
    """Return the median depth of the valid pixels of each ``side × side`` square; NaN without any.

    Args:
        jump: Least difference of two surfaces [1/m]: of two middle pixels of different surfaces the nearer one counts.
    """
    rows, columns = depth.shape[0] // side, depth.shape[1] // side
    found, known = np.empty((rows, columns), dtype=np.float32), np.empty(side * side)
    for i in range(rows):
        for j in range(columns):
            count = 0
            for v in range(i * side, (i + 1) * side):
                for u in range(j * side, (j + 1) * side):
                    z = depth[v, u]
                    if not 0.0 < z < np.inf:
                        continue
                    at = count
                    while at > 0 and known[at - 1] > z:
                        known[at] = known[at - 1]
                        at -= 1
                    known[at] = z
                    count += 1
            found[i, j] = np.nan
            if count > 0:
                low, high = known[(count - 1) // 2], known[count // 2]
                found[i, j] = low if 1.0 / low - 1.0 / high > jump else 0.5 * (low + high)
    return found


@njit(cache=True, error_model="numpy")
def _add_column(sums, x, n, y, yy, w, yw, ww):
    """Add sums over pixels of one column, whose x is constant."""
    sums[0] += n
    sums[1] += n * x
    sums[2] += y
    sums[3] += n * x * x
    sums[4] += x * y
    sums[5] += yy
    sums[6] += w
    sums[7] += x * w
    sums[8] += yw
    sums[9] += ww


@njit(cache=True, error_model="numpy")
def cells_of(depth, size, pinhole, near, far):
    """Return w = 1/Z of each pixel, the sums over the pixels of ``size × size`` cells, and the fractions of copies among them.

    w is NaN without depth, and transposed: one row per image column, as surfaces are read by columns. The sums hold the pixels from
    ``near`` to ``far``. A copy has the depth of its left neighbour.
    """
    fx, fy, cx, cy = pinhole
    height, width = depth.shape
    rows, columns = height // size, width // size
    nearness, sums, copies = np.empty((width, height)), np.zeros((rows, columns, 10)), np.zeros((rows, columns))
    band = np.empty((size, width))
    # A row of cells at a time, along the rows of the image: such loops have no branch.
    for top in range(0, height, size):
        stop = min(top + size, height)
        n, same, w_sum, yw_sum, ww_sum, y_sum, yy_sum = np.zeros((7, width))
        for v in range(top, stop):
            y, row, line = (v - cy) / fy, depth[v], band[v - top]
            for u in range(width):
                z = np.float64(row[u])
                line[u] = 1.0 / z if (z > 0.0) & (z < np.inf) else np.nan
            for u in range(width):
                inside = (row[u] > near) & (row[u] < far)
                one, w = 1.0 if inside else 0.0, line[u] if inside else 0.0
                n[u] += one
                y_sum[u] += one * y
                yy_sum[u] += one * (y * y)
                w_sum[u] += w
                yw_sum[u] += y * w
                ww_sum[u] += w * w
            for u in range(1, width):
                same[u] += 1.0 if row[u] == row[u - 1] else 0.0
        for u in range(width):
            for v in range(top, stop):
                nearness[u, v] = band[v - top, u]
        for u in range(columns * size if top // size < rows else 0):
            cell = sums[top // size, u // size]
            _add_column(cell, (u - cx) / fx, n[u], y_sum[u], yy_sum[u], w_sum[u], yw_sum[u], ww_sum[u])
            copies[top // size, u // size] += same[u] / (size * size)
    return nearness, sums, copies


@njit(cache=True, error_model="numpy")
def fit_plane(s, plane):
    """Fill ``plane`` with n; return the RMS residual of w and the relative standard deviation of n; NaN without a fit."""
    n = s[0]
    if n < 6:
        return np.nan, np.nan
    mx, my, mw = s[1] / n, s[2] / n, s[6] / n
    xx, xy, yy = s[3] - n * mx * mx, s[4] - n * mx * my, s[5] - n * my * my
    xw, yw, ww = s[7] - n * mx * mw, s[8] - n * my * mw, s[9] - n * mw * mw
    det = xx * yy - xy * xy
    if det <= 1e-9 * xx * yy or det <= 0.0 or xx <= ROUNDING * s[3] or yy <= ROUNDING * s[5]:
        return np.nan, np.nan
    alpha = (xw * yy - yw * xy) / det
    beta = (yw * xx - xw * xy) / det
    gamma = mw - alpha * mx - beta * my
    plane[0], plane[1], plane[2] = alpha, beta, gamma
    residual = math.sqrt(max(ww - alpha * xw - beta * yw, 0.0) / n)
    turn = residual / math.sqrt(min(xx, yy)) / math.sqrt(alpha * alpha + beta * beta + gamma * gamma)
    return residual, turn


@njit(cache=True, error_model="numpy")
def _sum_block(cells, i, j, height, total):
    """Fill ``total`` with the sums over ``height × 2`` cells."""
    for k in range(10):
        total[k] = cells[i, j, k] + cells[i, j + 1, k]
        if height == 2:
            total[k] += cells[i + 1, j, k] + cells[i + 1, j + 1, k]


@njit(cache=True, error_model="numpy")
def block_fits(cells, full):
    """Return for each block of 2×2 cells n, RMS residual [1/m], standard deviation of the normal, contrast and mean of w.

    The contrast is the square of the part of the cells' means along the block's diagonals, which no plane explains, relative to
    that of white noise of the same size. All are NaN for blocks with less than ``full`` pixels a cell.
    """
    fits = np.full((max(cells.shape[0] - 1, 0), max(cells.shape[1] - 1, 0), 7), np.nan)
    total = np.empty(10)
    for i in range(fits.shape[0]):
        for j in range(fits.shape[1]):
            _sum_block(cells, i, j, 2, total)
            fit = fits[i, j]
            if total[0] < 4.0 * full:
                continue
            fit[3], fit[4] = fit_plane(total, fit)
            fit[6] = total[6] / total[0]
            contrast, weight = 0.0, 0.0
            for a in range(2):
                for b in range(2):
                    s = cells[i + a, j + b]
                    off = s[6] - fit[0] * s[1] - fit[1] * s[2] - fit[2] * s[0]
                    contrast += (1.0 if a == b else -1.0) * off / max(s[0], 1.0)
                    weight += 1.0 / max(s[0], 1.0)
            fit[5] = contrast * contrast / max(fit[3] * fit[3] * weight, 1e-30)
    return fits


@njit(cache=True, error_model="numpy")
def plane_blocks(cells, fits, full, residual_limit, turn_limit):
    """Return the blocks of 2×2 cells on one plane, and blocks of 1×2 cells where no larger one fits.

    A distant step is one cell high. Blocks overlap, so that less is lost at edges; a pixel can count four times.

    Args:
        fits: Planes of the blocks of 2×2 cells.
        full: Least number of pixels with depth in a cell.
        residual_limit: Largest RMS residual of a block [1/m].
        turn_limit: Largest standard deviation of its normal [rad].

    Returns:
        For each block its sums, its unit normal, its centre, its place: first row and column of cells and number of rows; its
        RMS residual and the standard deviation of its normal.
    """
    rows, columns = cells.shape[0], cells.shape[1]
    most = 2 * rows * columns
    sums, units, centres = np.empty((most, 10)), np.empty((most, 3)), np.empty((most, 3))
    places, residuals, turns = np.empty((most, 3), dtype=np.int64), np.empty(most), np.empty(most)
    large = np.zeros((rows + 1, columns), dtype=np.bool_)
    total, plane = np.empty(10), np.empty(3)
    count = 0
    for height in (2, 1):
        for i in range(rows - height + 1):
            for j in range(columns - 1):
                if height == 1 and (large[i, j] or (i > 0 and large[i - 1, j])):
                    continue
                _sum_block(cells, i, j, height, total)
                if total[0] < 2.0 * height * full:
                    continue
                if height == 2:
                    plane[:], residual, turn = fits[i, j, :3], fits[i, j, 3], fits[i, j, 4]
                else:
                    residual, turn = fit_plane(total, plane)
                if not (residual < residual_limit and turn <= turn_limit):
                    continue
                large[i, j] = large[i, j] or height == 2
                sums[count], residuals[count], turns[count] = total, residual, turn
                units[count] = plane / math.sqrt(dot(plane, plane))
                x, y, nearness = total[1] / total[0], total[2] / total[0], total[6] / total[0]
                centres[count, 0], centres[count, 1], centres[count, 2] = x / nearness, y / nearness, 1.0 / nearness
                places[count, 0], places[count, 1], places[count, 2] = i, j, height
                count += 1
    return sums[:count], units[:count], centres[:count], places[:count], residuals[:count], turns[:count]


@njit(cache=True, error_model="numpy")
def _common_plane(sums, run, limit, inside, plane):
    """Fit one plane to the blocks of a run, starting with those ``inside``; return the number of blocks on it.

    Args:
        sums: Sums of all blocks.
        run: Indices of the blocks in question.
        limit: Largest RMS residual of a block [1/m].
        inside: Mask of the first blocks; filled with those on the plane.
        plane: Filled with n.
    """
    total = np.empty(10)
    for _ in range(3):
        total[:] = 0.0
        for i in range(run.shape[0]):
            if inside[i]:
                total += sums[run[i]]
        if not fit_plane(total, plane)[0] >= 0.0:
            return 0
        for i in range(run.shape[0]):
            inside[i] = mean_square(sums[run[i]], plane) < limit * limit
    return np.count_nonzero(inside)


@njit(cache=True, error_model="numpy")
def planes_along(sums, centres, chosen, direction, gap, least, limit):
    """Return the planes among blocks, separated by their level along a direction, the largest first in each run of blocks.

    Objects between two treads can join them to one run.

    Args:
        sums: Sums of all blocks, ``centres`` their centres.
        chosen: Indices of the blocks in question.
        gap: Separation of different surfaces.
        least: Least number of blocks of a plane.
        limit: Largest RMS residual of a block [1/m].

    Returns:
        Blocks of all planes, concatenated, the end index of each plane, their n and mean squared residuals.
    """
    levels = np.empty(chosen.shape[0])
    for i in range(levels.shape[0]):
        levels[i] = along(centres[chosen[i]], direction)
    order = np.argsort(levels, kind="mergesort")
    chosen, levels = chosen[order], levels[order]
    members, stops = np.empty(chosen.shape[0], dtype=np.int64), np.empty(chosen.shape[0] // least, dtype=np.int64)
    normals, squares, total = np.empty((stops.shape[0], 3)), np.empty(stops.shape[0]), np.empty(10)
    planes = held = stop = 0
    while stop < chosen.shape[0]:
        first, stop = stop, stop + 1
        while stop < chosen.shape[0] and not levels[stop] - levels[stop - 1] > gap:
            stop += 1
        run, at, fewest = chosen[first:stop], levels[first:stop], least
        while run.shape[0] >= fewest:
            start, end = _fullest(at, gap)
            inside = np.zeros(run.shape[0], dtype=np.bool_)
            inside[start:end] = True
            if end - start < fewest or _common_plane(sums, run, limit, inside, normals[planes]) < fewest:
                break
            total[:], begin = 0.0, held
            for i in range(run.shape[0]):
                if inside[i]:
                    members[held] = run[i]
                    held += 1
                    total += sums[run[i]]
            squares[planes] = mean_square(total, normals[planes])
            stops[planes] = held
            planes += 1
            fewest = max(fewest, (held - begin) // FRAGMENT)
            if at[-1] - at[0] <= gap:
                break
            run, at = run[~inside], at[~inside]
    return members[:held].copy(), stops[:planes].copy(), normals[:planes].copy(), squares[:planes].copy()


@njit(cache=True, error_model="numpy")
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
def mean_square(s, plane):
    """Return the mean squared residual of w of some pixels about a plane."""
    a, b, c = plane[0], plane[1], plane[2]
    quadratic = a * a * s[3] + b * b * s[5] + c * c * s[0] + 2.0 * (a * b * s[4] + a * c * s[1] + b * c * s[2])
    return max((s[9] - 2.0 * (a * s[7] + b * s[8] + c * s[6]) + quadratic) / s[0], 0.0)


@njit(cache=True, error_model="numpy")
def solved_plane(s, plane, inverse):
    """Fill ``plane`` with n and ``inverse`` with the inverse of its normal equations; return the mean squared residual.

    NaN if the pixels do not determine a plane.
    """
    if not fit_plane(s, plane)[0] >= 0.0:
        return np.nan
    n, x, y, xx, xy, yy = s[0], s[1], s[2], s[3], s[4], s[5]
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = yy * n - y * y, xx * n - x * x, xx * yy - xy * xy
    inverse[0, 1] = inverse[1, 0] = x * y - xy * n
    inverse[0, 2] = inverse[2, 0] = xy * y - yy * x
    inverse[1, 2] = inverse[2, 1] = xy * x - xx * y
    inverse /= xx * inverse[0, 0] + xy * inverse[0, 1] + x * inverse[0, 2]
    return (s[9] - plane[0] * s[7] - plane[1] * s[8] - plane[2] * s[6]) / max(n - 3.0, 1.0)


@njit(cache=True, error_model="numpy")
def _ending(near, v, way, ys, level, slope, jump):
    """Return the code for the surroundings of a surface's end at row ``v``, upwards (-1) or downwards (1).

    Args:
        near: w along a column of the image; the surface has w = level + slope·y there.
    """
    rows = near.shape[0]
    first = second = np.nan
    for k in range(2, max(5, rows // HOLE_SHARE)):
        row = v + way * k
        if not 0 <= row < rows:
            break
        first = near[row] - level - slope * ys[row]
        if first == first:
            # Behind a wide hole the second pixel is the next one: twice the distance would reach a further surface.
            further = v + way * 2 * k if k < 5 else row + way * 2
            if 0 <= further < rows:
                second = near[further] - level - slope * ys[further]
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
def surfaces(nearness, members, stops, places, size, planes, squares, tolerance, sigmas, jump, pinhole):
    """Return the surfaces of some planes, each fitted to all of its pixels, with its ends in each column of the image.

    Args:
        nearness: w, one row per column of the image.
        members: Blocks of all planes, concatenated; ``stops`` the end index of each plane.
        places: Places of all blocks, in cells of ``size`` pixels.
        planes: n of each plane, ``squares`` the mean squared residuals of its blocks.
        tolerance: Least distance from the plane for a pixel to be rejected [1/m], and ``sigmas`` the same in RMS residuals.
        jump: Difference separating two surfaces [1/m].

    Returns:
        n of each surface, its covariance, its centre, and its number of columns; none if its pixels do not determine a plane. Then
        one row per surface: these columns; half a pixel beyond its first and last row there; the codes of its surroundings.
    """
    fx, cx = pinhole[0], pinhole[2]
    width, height, count = nearness.shape[0], nearness.shape[1], stops.shape[0]
    normals, covariances, centres = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty((count, 3))
    held, columns = np.zeros(count, dtype=np.int64), np.empty((count, width), dtype=np.int64)
    upper, lower = np.empty((count, width)), np.empty((count, width))
    above, below = np.empty((count, width), dtype=np.int64), np.empty((count, width), dtype=np.int64)
    ys, ray, sums, begin = (np.arange(height) - pinhole[3]) / pinhole[1], np.ones(3), np.empty(10), 0
    for s in range(count):
        own, margin = places[members[begin : stops[s]]], size + size // 2
        begin, plane, off, k = stops[s], planes[s], max(tolerance, sigmas * math.sqrt(squares[s])), 0
        left, stop = own[:, 1].min() * size - margin, (own[:, 1].max() + 2) * size + margin + 1
        top, bottom = max(own[:, 0].min() * size - margin, 0), min((own[:, 0] + own[:, 2]).max() * size + margin + 1, height)
        for u in range(max(left, 0), min(stop, width)):
            near, level = nearness[u], plane[0] * ((u - cx) / fx) + plane[2]
            first, last, found = _longest(near, top, bottom, ys, level, plane[1], off)
            if found < 3:
                continue
            columns[s, k], upper[s, k], lower[s, k] = u, first - 0.5, last + 0.5
            above[s, k] = _ending(near, first, -1, ys, level, plane[1], jump)
            below[s, k] = _ending(near, last, 1, ys, level, plane[1], jump)
            k += 1
        # Pixels of a side wall near its crease lie on the plane as well, and would turn it: of a wall along the view 1 m aside
        # those within ``off`` of the crease. Where a surface is too narrow for the margin, all columns count.
        for margin in (int(math.ceil(off * fx)), 0):
            sums[:] = 0.0
            for i in range(margin, k - margin):
                u, before, after = columns[s, i], i - margin, i + margin
                if columns[s, after] - columns[s, before] > 2 * margin:
                    continue
                first = max(upper[s, before], upper[s, i], upper[s, after])
                last = min(lower[s, before], lower[s, i], lower[s, after])
                near, x, n = nearness[u], (u - cx) / fx, 0
                level, y_sum, yy_sum, w_sum, yw_sum, ww_sum = plane[0] * x + plane[2], 0.0, 0.0, 0.0, 0.0, 0.0
                for v in range(int(first + 1.5), int(max(last - 0.5, 0.0))):
                    w, y = near[v], ys[v]
                    if abs(w - level - plane[1] * y) < off:
                        n += 1
                        y_sum += y
                        yy_sum += y * y
                        w_sum += w
                        yw_sum += y * w
                        ww_sum += w * w
                _add_column(sums, x, n, y_sum, yy_sum, w_sum, yw_sum, ww_sum)
            if sums[0] >= 4 * size * size:
                break
        square = solved_plane(sums, normals[s], covariances[s])
        # Pixels in a single row or column do not determine a plane.
        if sums[0] < size * size or square != square:
            continue
        held[s] = k
        ray[0], ray[1] = sums[1] / sums[0], sums[2] / sums[0]
        centres[s] = ray / dot(normals[s], ray)
        covariances[s] *= max(square, 1e-12)  # depth without noise
    return normals, covariances, centres, held, columns, upper, lower, above, below


@njit(cache=True, error_model="numpy")
def _longest(near, start, stop, ys, level, slope, off):
    """Return first and last row and number of pixels of the longest run on a plane in a column; short gaps do not end a run."""
    begin, end, best = -1, -1, 0
    first, missed, found = -1, GAP_PX + 1, 0
    for v in range(start, stop):
        if abs(near[v] - level - slope * ys[v]) < off:
            if missed > GAP_PX:
                first, found = v, 0
            found += 1
            missed = 0
            if found > best:
                begin, end, best = first, v, found
        else:
            missed += 1
    return begin, end, best


@njit(cache=True, error_model="numpy")
def along(point, direction):
    """Return the coordinate of a point along a direction, rounded as by BLAS for a row of points."""
    return fused(point[2], direction[2], fused(point[0], direction[0], point[1] * direction[1]))


@njit(cache=True, error_model="numpy")
def span(points, members, direction):
    """Return the range of some of many points along a direction."""
    low, high = np.inf, -np.inf
    for k in members:
        place = along(points[k], direction)
        low, high = min(low, place), max(high, place)
    return low, high


@njit(cache=True, error_model="numpy")
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
    for i in range(0, n - half, max(1, half // 24)):
        slope = (v[i + half] - v[i]) / (u[i + half] - u[i])
        level = v[i] - slope * u[i]
        count = np.count_nonzero(np.abs(v - level - slope * u) < near)
        if count > best:
            best, a, b = count, slope, level
    # Ragged edges scatter by more than the first tolerance; truncation would underestimate the scatter.
    far = np.abs(v - b - a * u)
    near = min(max(near, WIDENED * np.median(far[far < 3.0 * near])), 3.0 * near)
    for _ in range(3):
        on = np.abs(v - b - a * u) < near
        if np.count_nonzero(on) < 16:
            return 0
        u0, v0 = np.mean(u[on]), np.mean(v[on])
        across = u[on] - u0
        uu = np.sum(across * across)
        a = np.sum(across * (v[on] - v0)) / uu
        b = v0 - a * u0
    off = (v - b - a * u)[np.abs(v - b - a * u) < near]
    count, spread = off.size, 0.0
    for part in range(8):
        eighth = off[part * count // 8 : (part + 1) * count // 8]
        spread += np.sum(eighth) ** 2 / max(eighth.size, 1)
    # Sum of squares for independent errors of adjacent points; correlated errors give more. Two degrees of freedom are used.
    square = max(np.sum(off * off) / max(count - 2, 1), spread / 6.0)
    line[0], line[1], line[2], line[3], line[4] = a, v0, u0, square / uu, square / max(count, 1)
    return count


@njit(cache=True, error_model="numpy")
def in_view(rows, follows, height):
    """Return the mask of columns in which neither an object in front nor the image border ends a surface."""
    return (follows != BEFORE) & (rows >= BORDER_PX) & (rows < height - BORDER_PX)


@njit(cache=True, error_model="numpy")
def nosing_line(columns, rows, follows, plane, height, near, least, aliasing, pinhole):
    """Return the line at a surface's end before a larger depth or at a corner, and the plane through line and camera centre.

    Args:
        rows: End row of the surface in each of its columns, and ``follows`` the codes of its surroundings.
        plane: n of the surface.
        height: Number of image rows.
        near: Largest distance of a point from the line [rows].
        least: Least number of columns of a line.
        aliasing: Lower limit of the relative error of a line's ends [rows], for any number of points.

    Returns:
        Number of columns, 0 without a line; its kind: ``BEYOND`` for a larger depth behind, ``CREASE`` for a corner, ``UNKNOWN``
        for a line past which nothing is known; the plane's unit normal and its covariance; the line's middle and ends on the
        surface, the left end first.
    """
    normal, covariance, points = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    line, count, kind = np.empty(5), 0, UNKNOWN
    known = follows.size - np.count_nonzero(follows == UNKNOWN)
    majority = BEYOND if 2 * np.count_nonzero(follows == BEYOND) >= known else CREASE
    u, v = columns.astype(np.float64), rows
    for what in (majority, UNKNOWN):
        usable = in_view(rows, follows, height) if what == UNKNOWN else follows == what
        u, v = columns[usable].astype(np.float64), rows[usable]
        if u.size < max(least, (follows.size if what == UNKNOWN else known) // 2):
            continue
        count, kind = fit_line(u, v, near, line), what
        # A line past which nothing is known has to hold half of the end.
        if count >= max(least, u.size // 2 if what == UNKNOWN else 0):
            break
        count = 0
    a, v0, u0 = line[0], line[1], line[2]
    # Other ends at the surface's level, beyond a wall next to the flight, do not belong to the line.
    on = u[np.abs(v - v0 - a * (u - u0)) < near]
    if count == 0 or on.size < 2:
        return 0, kind, normal, covariance, points
    for k, at in enumerate((u0, on[0], on[-1])):
        ray = points[k]
        ray[0], ray[1], ray[2] = (at - pinhole[2]) / pinhole[0], (v0 + a * (at - u0) - pinhole[3]) / pinhole[1], 1.0
        nearness = along(ray, plane)
        if nearness <= 0.0:  # behind the camera
            return 0, kind, normal, covariance, points
        ray /= nearness
    # Line y = A x + B in normalised image coordinates; m is the normalised (A, -1, B).
    fx, fy, cx, cy = pinhole
    normal[0], normal[1], normal[2] = a * fx / fy, -1.0, (v0 + a * (cx - u0) - cy) / fy
    length = math.sqrt(dot(normal, normal))
    normal /= length
    by_a, by_v = np.array([fx / fy / length, 0.0, (cx - u0) / fy / length]), np.array([0.0, 0.0, 1.0 / fy / length])
    across_a, across_v = dot(normal, by_a), dot(normal, by_v)
    var_a, var_v = line[3] + (aliasing / (on[-1] - on[0])) ** 2, line[4]
    by_a, by_v = by_a - across_a * normal, by_v - across_v * normal
    covariance[:] = var_a * np.outer(by_a, by_a) + var_v * np.outer(by_v, by_v)
    return count, kind, normal, covariance, points


@njit(cache=True, error_model="numpy")
def height_of_end(columns, rows, follows, plane, up, height, pinhole):
    """Return the median height of a surface's end; NaN if an object in front or the image border cuts off most of it.

    Args:
        height: Number of image rows.
    """
    seen = in_view(rows, follows, height)
    x, y = (columns[seen] - pinhole[2]) / pinhole[0], (rows[seen] - pinhole[3]) / pinhole[1]
    if 2 * x.size < columns.size or x.size == 0:
        return np.nan
    return np.median((up[0] * x + up[1] * y + up[2]) / (plane[0] * x + plane[1] * y + plane[2]))
