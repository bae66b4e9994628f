"""Sizes of steps that a tracked chair climbs, and distances that it keeps.

Sizes: what the stair detector accepts, what an entry allows, what ``check`` expects. Distances: those by which the planner plans
and the guard holds.
"""

import math

RISE_M, RUN_M = (0.08, 0.25), (0.15, 0.52)
"""Ranges of rise and run [m]: building codes allow rises of 0.10 to 0.22 m and ask for runs from 0.22 m; homes have rises to
0.24 m, gardens runs to 0.45 m."""
SINGLE_RISE_M = (0.04, RISE_M[1])
"""Range of heights of a single step [m]: a lower one is ground, on which belts pitch by 5° as on a ramp; a higher one a crate."""
ON_A_FLIGHT_RAD = math.radians(10.0)
"""Pitch above which a chair lies on a flight [rad]: half the slope of the flattest stair of homes, 20°."""
OBSTACLE_CLEAR_M = 0.34
"""Distance kept from an obstacle, and from an edge that is not entered, in addition to the stopping distance [m]: 0.3 m are
required (docs/explanation/safety.md, row 25), and the distance is known to a few centimetres."""
TURN_CLEAR_M = 0.05
"""Distance of the chair's outline from walls and edges that are seen on a landing on which the chair turns [m]."""
GAP_SEEN_M = 1.9
"""Distance from mid-track beyond which a gap is not yet called a missing step, nor ground called seen [m]: further away nosings are
often not detected, and one metre suffices to stop."""
