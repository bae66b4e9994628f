"""Sizes of steps that a tracked chair climbs: what the stair detector accepts, what an entry allows, what ``check`` expects."""

import math

RISE_M, RUN_M = (0.08, 0.25), (0.15, 0.52)
"""Ranges of rise and run [m]: building codes allow rises of 0.10 to 0.22 m and ask for runs from 0.22 m; homes have rises to
0.24 m, gardens runs to 0.45 m."""
SINGLE_RISE_M = (0.04, RISE_M[1])
"""Range of heights of a single step [m]: a lower one is ground, on which belts pitch by 5° as on a ramp; a higher one a crate."""
ON_A_FLIGHT_RAD = math.radians(10.0)
"""Pitch above which a chair lies on a flight [rad]: half the slope of the flattest stair of homes, 20°."""
