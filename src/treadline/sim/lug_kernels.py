"""Lugs of the belts, compiled: each contact of a belt follows a periodic profile that runs with the belt.

A contact finds a belt's smooth outline, through the lugs' tips. At arc length σ along the outline, in the direction in which the
surface moves, the belt stands back by the gap c(φ), φ = (σ - s)/p, with s the belt's travel since the start and p the lugs' pitch.
The contact's distance grows by c, and its normal turns with the slope c' = dc/dσ. Friction stays Coulomb: what hooks a nosing is a
flank, and the next lug.
"""

import math
from typing import no_type_check

from numba import njit

REAR, FRONT, NOSE, FLAT, APPROACH = 0, 1, 2, 3, 4
"""Parts of a belt, in the order of the plant's geom ids."""
PARTS = 5
SMOOTH = -1
"""Part of a geom that is no belt."""
FAR_M = 1.0
"""Distance of a contact that the profile has opened: too far to carry."""
ACROSS = 5
"""Places across the belt's width at which an askew nosing may meet a lug."""
HEIGHT, PITCH, TIP, FLANK, DAMPING_S, FLAT_RUN, APPROACH_M, RADIUS, HALF_WIDTH, GAUGE, STEP_S = range(11)
"""Entries of the lugs' numbers [m, s]; the damping is B/K of MuJoCo's reference acceleration, 2 · dmax · time constant."""


@njit(cache=True)
@no_type_check
def profile(along, lug):
    """Return gap and slope of the profile at a distance along the belt from the middle of a tip."""
    pitch, tip, flank, height = lug[PITCH], lug[TIP], lug[FLANK], lug[HEIGHT]
    place = along - pitch * math.floor(along / pitch + 0.5)
    beyond = abs(place) - 0.5 * tip
    if beyond <= 0.0:
        return 0.0, 0.0
    if beyond >= flank:
        return height, 0.0
    angle = math.pi * beyond / flank
    slope = 0.5 * height * math.pi / flank * math.sin(angle)
    return 0.5 * height * (1.0 - math.cos(angle)), math.copysign(slope, place)


@njit(cache=True)
@no_type_check
def standing(along, rise, lug):
    """Return gap and slope where the next lug uphill stands on the tread that ends at the nosing.

    ``rise`` is the height gained per distance along the belt; the tread is level.
    """
    pitch = lug[PITCH]
    place = along - pitch * math.floor(along / pitch)
    # Uphill is towards smaller arc lengths where the belt descends along them.
    distance = (place if rise < 0.0 else pitch - place) - 0.5 * lug[TIP]
    return max(distance, 0.0) * abs(rise), (-rise if distance > 0.0 else 0.0)


@njit(cache=True)
@no_type_check
def arc_length(part, x, z, ox, oz, approach_rad, lug):
    """Return the place along the outline of a contact at (x, z) in B with outward normal (ox, oz), from mid-track."""
    half, radius = 0.5 * lug[FLAT_RUN], lug[RADIUS]
    if part == FLAT:
        return -x
    if part == REAR:
        return half + radius * math.atan2(-ox, -oz)
    if part == FRONT:
        return -half - radius * math.atan2(ox, -oz)
    if part == NOSE:
        return -half - lug[APPROACH_M] - radius * math.atan2(ox, -oz)
    outward = (x - half) * math.cos(approach_rad) + (z - radius) * math.sin(approach_rad)
    return -half - radius * approach_rad - outward


@njit(cache=True)
@no_type_check
def follow_lugs(count, real, whole, frame, surfacevel, geom, part_of, speed, approach_rad, qpos, xmat, lug, travel):
    """Advance the belts' travel by a step and let their contacts, turned to the belt already, follow the profile.

    Args:
        part_of: Part of each geom, ``side · PARTS + part``, or ``SMOOTH``.
        speed: Belt speeds, left and right [m/s].
        approach_rad: Angle of the approach section over the flat run.
        lug: Numbers of the lugs, entries as ``HEIGHT`` and after it.
        travel: Distance that each belt has run [m]; changed in place.
    """
    for side in range(2):
        travel[side] += speed[side] * lug[STEP_S]
    for i in range(count):
        row = real[i]
        sign, name = 1.0, part_of[whole[i, geom]]
        if name == SMOOTH:
            sign, name = -1.0, part_of[whole[i, geom + 1]]
        if name == SMOOTH:
            continue
        side, part = name // PARTS, name % PARTS
        ox, oy, oz = sign * row[frame], sign * row[frame + 1], sign * row[frame + 2]
        if abs(ox * xmat[1] + oy * xmat[4] + oz * xmat[7]) > 0.99:  # the belt's side has no lugs
            row[0] = row[0] + lug[HEIGHT] if row[0] < 0.0 else FAR_M
            continue
        tx, ty, tz = row[frame + 3], row[frame + 4], row[frame + 5]
        dx, dy, dz = row[frame - 3] - qpos[0], row[frame - 2] - qpos[1], row[frame - 1] - qpos[2]
        x = xmat[0] * dx + xmat[3] * dy + xmat[6] * dz
        y = xmat[1] * dx + xmat[4] * dy + xmat[7] * dz
        z = xmat[2] * dx + xmat[5] * dy + xmat[8] * dz
        along = arc_length(
            part, x, z, xmat[0] * ox + xmat[3] * oy + xmat[6] * oz, xmat[2] * ox + xmat[5] * oy + xmat[8] * oz, approach_rad, lug
        )
        along -= travel[side]
        # A nosing runs along the world's y: how far it goes along the belt per distance across.
        askew = ty / xmat[4] if abs(xmat[4]) > 0.1 else 0.0
        inward = y - (1.0 - 2.0 * side) * 0.5 * lug[GAUGE]
        gap, slope = standing(along, tz, lug)
        for k in range(ACROSS):
            place = (-1.0 + 2.0 * k / (ACROSS - 1)) * lug[HALF_WIDTH]
            c, dc = profile(along + askew * (place - inward), lug)
            if c <= gap:
                gap, slope = c, dc
        size = math.sqrt(1.0 + slope * slope)
        # The flank's own normal speed enters as a distance: MuJoCo knows moving surfaces along the tangents alone.
        distance = (row[0] - lug[HEIGHT] + gap) / size
        if distance >= 0.0:
            row[0] = FAR_M
            continue
        row[0] = distance + lug[HEIGHT] - lug[DAMPING_S] * slope * speed[side] / size
        row[frame] = sign * (ox + slope * tx) / size
        row[frame + 1] = sign * (oy + slope * ty) / size
        row[frame + 2] = sign * (oz + slope * tz) / size
        row[frame + 3], row[frame + 4], row[frame + 5] = (
            (tx - slope * ox) / size,
            (ty - slope * oy) / size,
            (tz - slope * oz) / size,
        )
        row[surfacevel] /= size
