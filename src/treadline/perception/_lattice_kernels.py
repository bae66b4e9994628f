"""Search of one staircase that explains treads, risers and their ends, and its log-evidence; compiled.

A staircase is a lattice: nosing k lies at (x0 + k·run, z0 + k·rise) in the plane across the edges. Tread k has the height of
nosing k, starts there and ends under nosing k + 1; riser k stands under nosing k. Coordinates rise along x; a falling flight is
mirrored by its caller.

Columns of ``treads``: height and its variance, front and its variance, back and its variance, lateral range, extent along x.
Columns of ``risers``: place and its variance, top and its variance, bottom and its variance, lateral range, extent along z. Unknown
values have an infinite variance.
"""

import math

import numpy as np

from treadline.core.kernel_cache import njit

SEARCHED_RISE_M, SEARCHED_RUN_M = (0.05, 0.55), (0.10, 1.30)
"""Ranges of rise and run in which lattices compete [m]: steps of half a usual size to the tiers of a stand, 0.5 by 1.2 m, and a
tenth more for the error of a single step."""
STEEPEST = 1.75
"""Largest ratio of rise to run: 60°, between the steepest stairs and ladders (ISO 14122-1: stairs to 45°, ladders from 60°)."""
USUAL_RISE_M, USUAL_RUN_M = (0.17, 0.035), (0.29, 0.06)
"""Mean and standard deviation of rise and run of usual steps [m]: building codes allow rises of 0.10 to 0.22 m, homes have up to
0.24 m; codes ask for runs of 0.22 to 0.35 m, gardens have up to 0.45 m."""
ANY_RISE_M, ANY_RUN_M = (
    (sum(limits) / len(limits), (limits[1] - limits[0]) / math.sqrt(12)) for limits in (SEARCHED_RISE_M, SEARCHED_RUN_M)
)
"""Mean and standard deviation of rise and run of other steps [m]: those of uniform distributions over the searched ranges."""
UNUSUAL_LOG_ODDS = math.log(0.05 / 0.95)
"""Logarithm of the prior odds of a flight of other than usual size: stands, terraces, climbing frames."""
RISE_IRREGULAR_M, RUN_IRREGULAR_M = 0.006, 0.008
"""Standard deviation of a nosing from the lattice, height and place [m]: building codes allow 5 to 10 mm between steps."""
RISE_GAP_M, RUN_GAP_M = 0.57, 1.17
"""Range in which the next surface of a scene without a stair lies with uniform probability, height and place [m]: the heights of
furniture, and the depth of a room divided by its surfaces."""
OVERHANG_SIGMA_M, HIDDEN_SIGMA_M = 0.02, 0.03
"""Standard deviation of a nosing's overhang, and of the height of riser it hides [m]: building codes allow up to 32 mm of
overhang."""
LAST = 40
"""Largest step number on either side of the first."""
STEPS_APART = 4
"""Largest number of steps between two that are seen."""
OVERLAP_M = 0.08
"""Least common width of steps in view one after another [m]: two blocks 2 m away."""
SIGMAS = 3.0
"""Largest residual of a part of the lattice, and largest difference in rise and run of the same flight, in standard deviations."""
CONTRADICTED, EMPTY = -3.0, -2.0
"""Log-probabilities of a step that the depth image contradicts, in parts of it if it does so at fewer points, and of a step without
any part between others that have some: 1 % of those of drawn flights (20 of 1,890), 20 % from 5 m."""
PROBES = ((0.15, 0.0), (0.4, 0.0), (0.65, 0.0), (0.0, 0.1))
"""Points of a step that are compared with the depth image: place behind its nosing [runs], and below it [rises]. Of a falling
flight the part next to the nosing is in view; the front is as high as the board of an open step."""
ASIDES = 7
"""Number of these points across the step."""
CONTRADICTED_SHARE = 0.5
"""Fraction of these points at which the depth image shows something further away, or something nearer, by half a step, of a step
that counts as contradicted."""
BELOW_EYE_M = 0.10
"""Least height of the camera above a tread that is compared with the depth image [m]."""
HIDDEN_SHARE = 0.1
"""Least height above a nosing at which a ray passes it for certain, in rises: more than its irregularity."""
FITS = 2
"""Number of fits of a lattice to its parts."""
NONE = -1000
"""Step number of a part outside the lattice."""
LOG_2PI = math.log(math.tau)


@njit(cache=True, error_model="numpy")
def _add(sums, k, kind, value, variance):
    sums[k + LAST, kind, 0] += 1.0 / variance
    sums[k + LAST, kind, 1] += value / variance


@njit(cache=True, error_model="numpy")
def _assign(treads, risers, rise, run, x0, z0, of_tread, front_on, of_riser, heights, places, spans):
    """Assign parts to steps, and sum their heights and places.

    Args:
        of_tread, of_riser: Filled with the step of each tread and riser, ``NONE`` outside the lattice.
        front_on: Filled with whether a tread's front is a nosing of the lattice.
        heights, places: Filled with the sums of weights and of weighted values of each step: those of treads, those of risers.
        spans: Filled with the lateral range of each step.
    """
    heights[:] = 0.0
    places[:] = 0.0
    spans[:, 0], spans[:, 1] = np.inf, -np.inf
    irregular_z, irregular_x = RISE_IRREGULAR_M**2, RUN_IRREGULAR_M**2
    for r in range(risers.shape[0]):
        k = int(round((risers[r, 0] - x0) / run))
        off = risers[r, 0] - x0 - k * run
        of_riser[r] = NONE
        if abs(k) >= LAST or off * off > SIGMAS**2 * (risers[r, 1] + irregular_x + OVERHANG_SIGMA_M**2):
            continue
        top = risers[r, 2] - z0 - k * rise
        has_top = top * top < SIGMAS**2 * (risers[r, 3] + irregular_z + HIDDEN_SIGMA_M**2) and risers[r, 3] < np.inf
        # No riser goes on above its nosing.
        if top > 0.0 and not has_top and risers[r, 3] < np.inf:
            continue
        bottom = risers[r, 4] - z0 - (k - 1) * rise
        has_bottom = bottom * bottom < SIGMAS**2 * (risers[r, 5] + irregular_z) and risers[r, 5] < np.inf
        # A riser whose ends are seen, neither of them on the lattice, is a part of something else at this place.
        if not (has_top or has_bottom) and (risers[r, 3] < np.inf or risers[r, 5] < np.inf):
            continue
        # A riser lies between its tread and its nosing; a wall behind open steps is at the place of one, at other heights.
        overlap = min(risers[r, 9], z0 + k * rise) - max(risers[r, 8], z0 + (k - 1) * rise)
        if overlap < 0.5 * min(rise, risers[r, 9] - risers[r, 8]):
            continue
        of_riser[r] = k
        _add(places, k, 1, risers[r, 0], risers[r, 1])
        if has_top:
            _add(heights, k, 1, risers[r, 2], risers[r, 3])
        if has_bottom:
            _add(heights, k - 1, 0, risers[r, 4], risers[r, 5])
        spans[k + LAST, 0], spans[k + LAST, 1] = min(spans[k + LAST, 0], risers[r, 6]), max(spans[k + LAST, 1], risers[r, 7])
    for t in range(treads.shape[0]):
        k = int(round((treads[t, 0] - z0) / rise))
        off = treads[t, 0] - z0 - k * rise
        of_tread[t], front_on[t] = NONE, False
        if abs(k) >= LAST or off * off > SIGMAS**2 * (treads[t, 1] + irregular_z):
            continue
        # A tread lies between its nosing and the next, except for a floor and a landing.
        here, next_one = x0 + k * run, x0 + (k + 1) * run
        off = treads[t, 2] - here
        front = treads[t, 3] < np.inf and off * off < SIGMAS**2 * (treads[t, 3] + irregular_x + OVERHANG_SIGMA_M**2)
        off = treads[t, 4] - next_one
        back = treads[t, 5] < np.inf and off * off < SIGMAS**2 * (treads[t, 5] + irregular_x + OVERHANG_SIGMA_M**2)
        overlap = min(treads[t, 9], next_one) - max(treads[t, 8], here)
        if not (front or back) and overlap < 0.5 * min(run, treads[t, 9] - treads[t, 8]):
            continue
        of_tread[t], front_on[t] = k, front
        _add(heights, k, 0, treads[t, 0], treads[t, 1])
        if front:
            _add(places, k, 0, treads[t, 2], treads[t, 3])
        if back:
            _add(places, k + 1, 1, treads[t, 4], treads[t, 5])
        spans[k + LAST, 0], spans[k + LAST, 1] = min(spans[k + LAST, 0], treads[t, 6]), max(spans[k + LAST, 1], treads[t, 7])


@njit(cache=True, error_model="numpy")
def _line_sums(parts, offset_sigma, irregular, bounds, sums):
    """Fill ``sums`` with the weighted sums of evenly spaced values over their step numbers, and the number of values.

    In this order: those of 1, k, k², y, k·y and y², the logarithm of the variances' product, and the number.

    Args:
        parts: Sums of weights and of weighted values of both kinds of parts; the second has a common unknown offset to the first.
        bounds: First and last step that counts.
    """
    weight, off = 1.0 / offset_sigma**2, 0.0
    steps = range(bounds[0] + LAST, bounds[1] + LAST + 1)
    for index in steps:
        if parts[index, 0, 0] > 0.0 and parts[index, 1, 0] > 0.0:
            own = 1.0 / (1.0 / parts[index, 0, 0] + 1.0 / parts[index, 1, 0])
            weight += own
            off += own * (parts[index, 1, 1] / parts[index, 1, 0] - parts[index, 0, 1] / parts[index, 0, 0])
    off /= weight
    sums[:] = 0.0
    for index in steps:
        total = parts[index, 0, 0] + parts[index, 1, 0]
        if total > 0.0:
            y = (parts[index, 0, 1] + parts[index, 1, 1] - off * parts[index, 1, 0]) / total
            variance, k = 1.0 / total + irregular**2, float(index - LAST)
            w = 1.0 / variance
            sums[0] += w
            sums[1] += w * k
            sums[2] += w * k * k
            sums[3] += w * y
            sums[4] += w * k * y
            sums[5] += w * y * y
            sums[6] += LOG_2PI + math.log(variance)
            sums[7] += 1.0


@njit(cache=True, error_model="numpy")
def _line_evidence(sums, prior, gap, solution):
    """Return the log-evidence of evenly spaced values against independent ones within a gap of each other.

    The first value has a flat prior, the spacing a normal one; both are integrated out.

    Args:
        sums: As from ``_line_sums``, of one value at least.
        prior: Mean and standard deviation of the spacing.
        solution: Filled with the first value and the spacing.
    """
    mean, weight = prior[0], 1.0 / prior[1] ** 2
    a11, a12, a22 = sums[0], sums[1], sums[2] + weight
    b1, b2 = sums[3], sums[4] + mean * weight
    det = a11 * a22 - a12 * a12
    solution[0] = (a22 * b1 - a12 * b2) / det
    solution[1] = (a11 * b2 - a12 * b1) / det
    chi = sums[5] + mean * mean * weight - solution[0] * b1 - solution[1] * b2
    of_prior = 0.5 * (LOG_2PI - math.log(weight))
    return -0.5 * (sums[6] + chi + math.log(det)) - of_prior + LOG_2PI + (sums[7] - 1.0) * math.log(gap)


@njit(cache=True, error_model="numpy")
def _group(heights, places, spans, bounds):
    """Fill ``bounds`` with first and last step of the group in view with most heights and places."""
    best, count, first, last = 0, 0, 0, -2 * LAST
    bounds[0], bounds[1] = 0, -1
    low, high = np.inf, -np.inf
    for index in range(heights.shape[0]):
        held = int(heights[index, 0, 0] + heights[index, 1, 0] > 0.0) + int(places[index, 0, 0] + places[index, 1, 0] > 0.0)
        if held == 0:
            continue
        k = index - LAST
        has_span = spans[index, 1] > spans[index, 0]
        beside = has_span and high > low and min(high, spans[index, 1]) - max(low, spans[index, 0]) < OVERLAP_M
        if k - last > STEPS_APART or beside:
            first, count = k, 0
            low, high = np.inf, -np.inf
        if has_span:
            low, high = spans[index, 0], spans[index, 1]
        last = k
        count += held
        if count > best:
            best = count
            bounds[0], bounds[1] = first, last


@njit(cache=True, error_model="numpy")
def _is_step(rise, run):
    """Return whether a step has dimensions within the searched ranges."""
    return (
        SEARCHED_RISE_M[0] <= rise <= SEARCHED_RISE_M[1]
        and SEARCHED_RUN_M[0] <= run <= SEARCHED_RUN_M[1]
        and rise <= STEEPEST * run
    )


@njit(cache=True, error_model="numpy")
def _fit(treads, risers, lattice, of_tread, front_on, of_riser, room):
    """Assign parts to a lattice, and fit it to them; return the log-evidence, -inf with fewer than two heights or places.

    Args:
        lattice: Rise, run, x0, z0; filled with the fitted ones, and with whether the size is not a usual one.
        of_tread, front_on, of_riser: Filled as in ``_assign``.
        room: Buffers: sums of heights and places and spans of each step, bounds, both lines.
    """
    heights, places, spans, bounds, up, along = room
    _assign(treads, risers, lattice[0], lattice[1], lattice[2], lattice[3], of_tread, front_on, of_riser, heights, places, spans)
    _group(heights, places, spans, bounds)
    _line_sums(heights, HIDDEN_SIGMA_M, RISE_IRREGULAR_M, bounds, up)
    _line_sums(places, OVERHANG_SIGMA_M, RUN_IRREGULAR_M, bounds, along)
    if up[7] < 2 or along[7] < 2:
        return -np.inf
    lines = np.empty((2, 2, 2))
    usual = _line_evidence(up, USUAL_RISE_M, RISE_GAP_M, lines[0, 0]) + _line_evidence(along, USUAL_RUN_M, RUN_GAP_M, lines[0, 1])
    other = _line_evidence(up, ANY_RISE_M, RISE_GAP_M, lines[1, 0]) + _line_evidence(along, ANY_RUN_M, RUN_GAP_M, lines[1, 1])
    other += UNUSUAL_LOG_ODDS
    (z0, rise), (x0, run) = lines[1] if other > usual else lines[0]
    lattice[0], lattice[1], lattice[2], lattice[3], lattice[4] = rise, run, x0, z0, other > usual
    return max(usual, other) + math.log1p(math.exp(-abs(usual - other)))


@njit(cache=True, error_model="numpy")
def best_lattice(points, treads, risers, nearness, pinhole, axes, of_tread, front_on, of_riser):
    """Return the staircase with the most evidence of those that pairs of points propose; NaN evidence without one.

    Args:
        points: Seeds of the search: kind (0 fronts of treads, 1 tops of risers, 2 feet of risers, one rise below their nosing), x,
            z, lateral range.
        nearness: Inverse depth, one row per column of the image; ``pinhole``: fx, fy, cx, cy.
        axes: Rows: directions in C of x, z and the lateral coordinate.
        of_tread, front_on, of_riser: Filled with the assignment of the parts, as in ``_assign``.

    Returns:
        Evidence, rise, run, z0, first and last step, number of steps with a height, and whether the size is not a usual one.
    """
    size = 2 * LAST + 1
    heights, places, spans = np.empty((size, 2, 2)), np.empty((size, 2, 2)), np.empty((size, 2))
    bounds = np.empty(2, dtype=np.int64)
    room = heights, places, spans, bounds, np.empty(8), np.empty(8)
    mine, mine_on, my_risers = np.empty_like(of_tread), np.empty_like(front_on), np.empty_like(of_riser)
    lattice, found = np.empty(5), np.full(8, np.nan)
    for i in range(points.shape[0]):
        for j in range(points.shape[0]):
            along, up = points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            overlap = min(points[i, 4], points[j, 4]) - max(points[i, 3], points[j, 3])
            if points[i, 0] != points[j, 0] or not along > 0.0 or not up > 0.0 or overlap < OVERLAP_M:
                continue
            for count in range(1, STEPS_APART + 1):
                lattice[0], lattice[1], lattice[2] = up / count, along / count, points[i, 1]
                lattice[3] = points[i, 2] + (lattice[0] if points[i, 0] == 2.0 else 0.0)
                evidence = -np.inf
                for _ in range(FITS):
                    if not _is_step(lattice[0], lattice[1]):
                        evidence = -np.inf
                        break
                    evidence = _fit(treads, risers, lattice, mine, mine_on, my_risers, room)
                # What the depth image says against it lowers the evidence.
                if evidence == -np.inf or evidence <= found[0]:
                    continue
                evidence += _contradictions(nearness, pinhole, axes, lattice, bounds, spans)
                if not evidence <= found[0]:
                    found[0], found[1], found[2], found[3] = evidence, lattice[0], lattice[1], lattice[3]
                    found[4], found[5], found[6], found[7] = bounds[0], bounds[1], room[4][7], lattice[4]
                    of_tread[:], front_on[:], of_riser[:] = mine, mine_on, my_risers
    return found


@njit(cache=True, error_model="numpy")
def _is_hidden(along, height, rise, run, x0, z0, last):
    """Return whether steps up to the last one of a lattice hide a point from the camera, which is at the origin."""
    if along > 0.0:
        first, stop = int(math.ceil(-x0 / run)), int(math.ceil((along - x0) / run))
    else:
        first, stop = int(math.floor((along - x0) / run)) + 1, int(math.ceil(-x0 / run))
    for k in range(max(first, -LAST), min(stop, last + 1)):
        place = x0 + k * run
        if height * place / along < z0 + (k + HIDDEN_SHARE) * rise and abs(place) < abs(along) - HIDDEN_SHARE * run:
            return True
    return False


@njit(cache=True, error_model="numpy")
def _contradictions(nearness, pinhole, axes, lattice, bounds, spans):
    """Return the log-probability of the treads that would be in view where the depth image shows something else.

    Past a tread that is not there it shows something further away; where a tread would lie inside of something solid, something
    nearer. The lowest step rises from another tread or a floor: a seat or a shelf does not have one there.
    """
    fx, fy, cx, cy = pinhole
    rise, run, x0, z0 = lattice[:4]
    total, low, high = 0.0, np.inf, -np.inf
    own_low, own_high = -np.inf, np.inf
    for k in range(bounds[1], bounds[0] - 2, -1):
        # Compared is the width that a step shares with the one above; a floor and a landing are wider than the flight.
        if spans[k + LAST, 1] > spans[k + LAST, 0] and k >= bounds[0]:
            low, high = max(spans[k + LAST, 0], own_low), min(spans[k + LAST, 1], own_high)
            own_low, own_high = spans[k + LAST, 0], spans[k + LAST, 1]
        elif k > bounds[0]:
            total += EMPTY
        if not high > low:
            continue
        further = nearer = seen = 0
        for part, below in PROBES:
            along, height = x0 + (k + part) * run, z0 + (k - below) * rise
            # A tread is seen from above, the front of a rising step from before it.
            is_in_view = axes[0, 2] > 0.0 and along > 0.0 if below > 0.0 else height < -BELOW_EYE_M
            if not is_in_view or _is_hidden(along, height, rise, run, x0, z0, bounds[1]):
                continue
            for i in range(ASIDES):
                aside = low + (i + 1.0) / (ASIDES + 1.0) * (high - low)
                x = along * axes[0, 0] + height * axes[1, 0] + aside * axes[2, 0]
                y = along * axes[0, 1] + height * axes[1, 1] + aside * axes[2, 1]
                z = along * axes[0, 2] + height * axes[1, 2] + aside * axes[2, 2]
                if not z > 0.1:
                    continue
                u, v = int(round(fx * x / z + cx)), int(round(fy * y / z + cy))
                if not (0 <= u < nearness.shape[0] and 0 <= v < nearness.shape[1]):
                    continue
                w = nearness[u, v]
                if w != w:
                    continue
                seen += 1
                # Steps by which what is seen on this ray lies further away, in run and in height: both are proportional to depth.
                off = (1.0 / (w * z) - 1.0) * (abs(along) / run + abs(height) / rise)
                further += off > 0.5
                nearer += off < -0.5
        # Below the lowest step lies the floor.
        against = max(further, nearer) if k >= bounds[0] else further
        if seen >= ASIDES:
            total += CONTRADICTED * min(against / (CONTRADICTED_SHARE * seen), 1.0)
    return total


@njit(cache=True, error_model="numpy")
def crowding(plan, facing, slack, weights, azimuths, least):
    """Return for each azimuth the sum of squared weights of the points in two adjacent bins of distance.

    Args:
        plan: Points ahead and to the right [bins], those of vertical blocks first.
        facing: Azimuth of each block; it counts at azimuths within its ``slack``.
        weights: Weight of each other point.
        least: Least weight at an azimuth; below it, the sum is zero.
    """
    reach = np.sqrt((plan**2).sum(axis=1)).max() if plan.shape[0] else 0.0
    counts, scores = np.empty(int(reach) + 3), np.zeros(azimuths.shape[0])
    for k in range(azimuths.shape[0]):
        counts[:] = 0.0
        ahead, right = math.cos(azimuths[k]), math.sin(azimuths[k])
        for i in range(plan.shape[0]):
            if i >= facing.shape[0] or abs(facing[i] - azimuths[k]) < slack[i]:
                place = int(max(ahead * plan[i, 0] + right * plan[i, 1], 0.0))
                counts[place] += weights[i - facing.shape[0]] if i >= facing.shape[0] else 1.0
        if counts.sum() > least:
            for place in range(counts.shape[0] - 1):
                scores[k] += (counts[place] + counts[place + 1]) ** 2
    return scores
