"""Scan of a depth image for ground, its ends and what stands on it, column by column from near to far; compiled.

Each pixel says something about the point at which its ray meets the ground's height: if the pixel lies lower, nothing bears there;
if it lies higher or has no depth, nothing is known of that point. ``pinhole`` is fx, fy, cx, cy in pixels.
"""

import numpy as np

from treadline.core.kernel_cache import njit

EDGE_PX, BELOW_PX = 3, 12
"""Rows at an edge whose depth may be that of neither side, half of a matching window, and last row whose depth counts for the level
below."""


@njit(cache=True, error_model="numpy")
def scan(depth, step, pinhole, view, start, half, clear, limits, seen, standing):
    """Return where the ground ends in each image column, and count pixels of ground and of what stands on it.

    The height of the ground is followed from pixel to pixel with a limited slope, so that single pixels hardly move it.

    Args:
        step: Distance of two columns [px].
        view: Directions ahead, to the left and up, as rows in C; coordinates of the camera along these, from mid-track and the
            level of the ground [m]; direction of the belts and their normal, as rows in C, with the camera's coordinate, or no rows
            where both do not matter.
        start: Distance and height at which the ground begins [m].
        half: Half of the swept width [m].
        clear: Least and largest height of what is in the way, above the ground and the belts [m].
        limits: Largest slope of ground; least height of a drop, of which half is the tolerance of ground; longest gap; length of a
            cell [m].
        seen: Pixels of ground less those below it, by cells along the way and strips of the swept width.
        standing: Pixels of what is in the way, and their least distance, by cells along the way.

    Returns:
        For each column with ground, or with what rises: lateral position, last distance with ground, -1 without any, and first one
        without, -1 if no end is seen, depth of what is seen below that end, NaN if nothing is; distance and lateral position of
        what rises there by more than the least height of what is in the way, NaN if nothing does [m].
    """
    fx, fy, cx, cy = pinhole
    axes, origin, belts = view
    slope, drop, bridge, cell = limits
    rows, columns = depth.shape
    furthest, per_m = len(seen) * cell, 0.5 * seen.shape[1] / half
    ends, count = np.empty((columns // step + 1, 6)), 0
    for u in range(0, columns, step):
        x, is_open = (u - cx) / fx, True
        base, height = start
        lowest = height
        known, through, place = -1.0, -1.0, 0.0
        below, lower = 0, 0.0
        foot, foot_left, rises = np.nan, np.nan, False
        for v in range(rows - 1, -1, -1):
            z = depth[v, u]
            if not 0.0 < z < 1e3:
                continue
            y = (v - cy) / fy
            ahead = axes[0, 0] * x + axes[0, 1] * y + axes[0, 2]
            aside = axes[1, 0] * x + axes[1, 1] * y + axes[1, 2]
            up = axes[2, 0] * x + axes[2, 1] * y + axes[2, 2]
            far, left, above = origin[0] + z * ahead, origin[1] + z * aside, origin[2] + z * up - height
            within = 0.0 < far < furthest and abs(left) < half
            if within and clear[0] < above < clear[1]:
                along, over = far, above
                for k in range(len(belts)):
                    value = z * (belts[k, 0] * x + belts[k, 1] * y + belts[k, 2]) + belts[k, 3]
                    along, over = (min(far, value), over) if k == 0 else (along, value)
                if over > clear[0] and along > 0.0:
                    standing[int(along / cell), 0] += 1.0
                    standing[int(along / cell), 1] = min(along, standing[int(along / cell), 1])
            # Behind a gap the ground goes on at its level: a slope is none that begins with a drop.
            slack = slope * max(far - base, 0.0) if through < 0.0 else 0.0
            if through >= 0.0 and above < -0.5 * drop and below < BELOW_PX:
                below, lower = below + 1, lower + above * (below >= EDGE_PX)
            if not is_open:
                continue
            if above > 0.5 * drop + slack:
                # What rises from the ground bears as well; what stands in front of it does not touch it in this column.
                touches = known >= 0.0 and known - cell < far < min(known + bridge, furthest)
                if touches:
                    known = far
                    if within:
                        seen[int(far / cell), int((left + half) * per_m)] += 1
                if touches or (known < 0.0 and 0.0 < far < furthest):  # the foot of a near wall is below the image
                    if np.isnan(foot):
                        foot, foot_left = far, left
                    rises = rises or above > clear[0]
                continue
            meets = (height - origin[2]) / up if up < 0.0 else np.inf
            crossing, crossing_left = origin[0] + meets * ahead, origin[1] + meets * aside
            is_low = above < -0.5 * drop - slack
            last = through if through >= 0.0 else known
            is_open = crossing < furthest and (last < 0.0 or crossing - last < bridge or (is_low and through < 0.0))
            if not is_open or far <= 0.0 or crossing <= 0.0:
                continue
            if not is_low:
                known, through, place = max(known, far), -1.0, left
                foot, rises = np.nan, False
                if within:
                    seen[int(far / cell), int((left + half) * per_m)] += 1
                if far > base:
                    height += min(max(above, -slack), slack)
                    base, lowest = far, min(lowest, height)
            elif above < lowest - height - drop - slack:  # back from a ramp to the level before it is no drop
                if abs(crossing_left) < half:
                    seen[int(crossing / cell), int((crossing_left + half) * per_m)] -= 1
                if known >= 0.0 and through < 0.0:
                    through, place = crossing, crossing_left
        if known >= 0.0 or rises:
            beneath = -lower / (below - EDGE_PX) if below > EDGE_PX else np.nan
            ends[count] = place, known, through, beneath, foot if rises else np.nan, foot_left
            count += 1
    return ends[:count].copy()
