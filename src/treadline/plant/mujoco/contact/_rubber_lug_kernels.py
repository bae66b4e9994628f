"""Belt lugs, compiled: each belt contact follows a periodic profile that moves with the belt.

The collision detection finds a smooth outline through the lug tips. At arc length σ along the outline, in the direction of surface
motion, the belt surface lies behind the outline by the gap c(φ), φ = (σ - s)/p, with s the belt's travel since the start and p the
lug pitch. The contact distance increases by c, and the contact normal rotates by the slope c' = dc/dσ. Friction stays Coulomb
friction: a nosing is held by a lug flank and by the next lug.
"""

import math
from typing import NamedTuple

from treadline.core.kernel_cache import njit

REAR, FRONT, NOSE, FLAT, APPROACH = 0, 1, 2, 3, 4
"""Parts of a belt, in the order of the plant's geom ids."""
PARTS = 5
"""Number of parts of a belt."""
SMOOTH = -1
"""Part of a geom outside the belts."""
FAR_M = 1.0
"""Distance assigned to a contact opened by the profile [m]: too far to carry a load."""
ACROSS = 5
"""Number of positions across the belt's width at which an oblique nosing can touch a lug."""


class LugParameters(NamedTuple):
    """Parameters of the lugs and of the belts that carry them [m, s]; without lugs the height is zero."""

    height: float
    pitch: float
    tip: float
    flank: float
    damping_s: float
    """B/K of MuJoCo's reference acceleration, 2 · dmax · time constant."""
    flat_run: float
    approach: float
    radius: float
    half_width: float
    gauge: float
    step_s: float


@njit(cache=True)
def profile(along, lug):
    """Return gap and slope of the profile at a distance along the belt from the middle of a tip."""
    pitch, tip, flank, height = lug.pitch, lug.tip, lug.flank, lug.height
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
def standing(along, rise, lug):
    """Return gap and slope at a nosing if the next lug uphill stands on the horizontal tread.

    ``rise`` is the height gain per distance along the belt.
    """
    pitch = lug.pitch
    place = along - pitch * math.floor(along / pitch)
    # If the belt descends with increasing arc length, uphill is towards smaller arc lengths.
    distance = (place if rise < 0.0 else pitch - place) - 0.5 * lug.tip
    return max(distance, 0.0) * abs(rise), (-rise if distance > 0.0 else 0.0)


@njit(cache=True)
def arc_length(part, x, z, ox, oz, approach_rad, lug):
    """Return the arc length from mid-track along the outline of a contact at (x, z) in B with outward normal (ox, oz)."""
    half, radius = 0.5 * lug.flat_run, lug.radius
    if part == FLAT:
        return -x
    if part == REAR:
        return half + radius * math.atan2(-ox, -oz)
    if part == FRONT:
        return -half - radius * math.atan2(ox, -oz)
    if part == NOSE:
        return -half - lug.approach - radius * math.atan2(ox, -oz)
    outward = (x - half) * math.cos(approach_rad) + (z - radius) * math.sin(approach_rad)
    return -half - radius * approach_rad - outward


@njit(cache=True)
def follow_lugs(count, real, whole, frame, surfacevel, geom, part_of, speed, approach_rad, qpos, xmat, lug, travel):
    """Advance the belts' travel by one step and apply the lug profile to the belt contacts, after ``turn_contacts``.

    Args:
        part_of: Part of each geom, ``side · PARTS + part``, or ``SMOOTH``.
        speed: Belt speeds, left and right [m/s].
        approach_rad: Angle of the approach section from the flat run.
        travel: Travel of each belt [m]; changed in place.
    """
    for side in range(2):
        travel[side] += speed[side] * lug.step_s
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
            row[0] = row[0] + lug.height if row[0] < 0.0 else FAR_M
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
        # A nosing is parallel to y of the world: its advance along the belt per distance across the belt.
        shear = ty / xmat[4] if abs(xmat[4]) > 0.1 else 0.0
        inward = y - (1.0 - 2.0 * side) * 0.5 * lug.gauge
        gap, slope = standing(along, tz, lug)
        for k in range(ACROSS):
            place = (-1.0 + 2.0 * k / (ACROSS - 1)) * lug.half_width
            c, dc = profile(along + shear * (place - inward), lug)
            if c <= gap:
                gap, slope = c, dc
        size = math.sqrt(1.0 + slope * slope)
        # The normal speed of the flank enters as an equivalent distance, because MuJoCo supports tangential surface motion only.
        distance = (row[0] - lug.height + gap) / size
        if distance >= 0.0:
            row[0] = FAR_M
            continue
        row[0] = distance + lug.height - lug.damping_s * slope * speed[side] / size
        row[frame] = sign * (ox + slope * tx) / size
        row[frame + 1] = sign * (oy + slope * ty) / size
        row[frame + 2] = sign * (oz + slope * tz) / size
        row[frame + 3], row[frame + 4], row[frame + 5] = (
            (tx - slope * ox) / size,
            (ty - slope * oy) / size,
            (tz - slope * oz) / size,
        )
        row[surfacevel] /= size
