"""Camera that follows a chair and films it: image size, frame rate and view, the same in every simulator.

Its lengths and angles are *drawn only*: chosen for the look, without an origin.
"""

import math

from treadline.core.rotations import Vector3

SIZE_PX = (720, 405)
FRAMES_PER_S = 10.0
FRAME_S = 4.0 / FRAMES_PER_S
"""Mission time between two images [s]: the film plays four times as fast as the chair drives."""
BACKGROUND = (0.93, 0.945, 0.96)
ACROSS_RAD = 2.0 * math.atan(SIZE_PX[0] / SIZE_PX[1] * math.tan(0.31))
"""Field of view across the width; across the height 0.62 rad, as in the player's scene."""
AZIMUTH_RAD, ELEVATION_RAD, DISTANCE_M = -2.05, 0.27, 4.1
"""Place of the camera as seen from its target: from behind and from the right of a chair that climbs."""
TARGET_M = (0.1, 0.0, 0.55)
"""What the camera looks at, from the chair's origin, along the world's axes."""


def pose(p_WB: Vector3) -> tuple[float, ...]:
    """Return position [m] and roll, pitch and yaw [rad] of the camera, whose x axis looks ahead, for a chair's position."""
    level_m = DISTANCE_M * math.cos(ELEVATION_RAD)
    shift_m = (level_m * math.cos(AZIMUTH_RAD), level_m * math.sin(AZIMUTH_RAD), DISTANCE_M * math.sin(ELEVATION_RAD))
    place = (float(p) + target + shift for p, target, shift in zip(p_WB, TARGET_M, shift_m, strict=True))
    return (*place, 0.0, ELEVATION_RAD, AZIMUTH_RAD + math.pi)
