"""What viewers see of the stair: its frame in the odometry's, and markers from the newest signals.

``HeadingEstimate, StairMap, FreeGround, MotionPlan, GuardState, Odometry -> X_OS, StairMarkers``.
"""

import math
from typing import Any, TypeVar

import numpy as np

from treadline.core.rotations import Rotation, Vector3, rotation_of, rotation_y, rotation_z
from treadline.core.signals import MEMORY_S, FreeGround, HeadingEstimate, MotionPlan, StairMap
from treadline.io.scene_messages import Marker
from treadline.io.stair_markers import drop_marker, heading_marker, hold_marker, stair_markers
from treadline.mission.odometry import Odometry
from treadline.ros import channels as on

T = TypeVar("T")


class StairView:
    """Newest signals that say where the stair is, and what the chair intends."""

    def __init__(self) -> None:
        self._newest: dict[type, Any] = {}

    def update(self, signal: HeadingEstimate | StairMap | FreeGround | MotionPlan | on.GuardState) -> None:
        """Store a signal."""
        self._newest[type(signal)] = signal

    def pose(self, odometry: Odometry) -> tuple[Rotation, Vector3] | None:
        """Return R_OS and p_OS; None before the first heading.

        S is on the nearest nosing in view, and below the chair where none is: level then.
        """
        estimate: HeadingEstimate | None = self._newest.get(HeadingEstimate)
        if estimate is None:
            return None
        stair = self._recent(StairMap, odometry.t_s)
        R_OB = rotation_of(odometry.orientation)
        ahead = R_OB @ rotation_z(-estimate.heading_rad)[:, 0]
        R_OS = rotation_z(math.atan2(ahead[1], ahead[0]))
        if stair is None or not stair.nosings_B:
            return R_OS, odometry.p_OB
        return R_OS @ rotation_y(-stair.slope_rad), odometry.p_OB + R_OB @ np.array(stair.nosings_B[0])

    def markers(self, t_s: float) -> on.StairMarkers:
        """Return the markers of what is not older than ``MEMORY_S``."""
        markers: list[Marker | None] = []
        stair, ground, plan = self._recent(StairMap, t_s), self._recent(FreeGround, t_s), self._recent(MotionPlan, t_s)
        estimate, guard = self._newest.get(HeadingEstimate), self._newest.get(on.GuardState)
        if estimate is not None:
            markers += [] if stair is None else stair_markers(stair, estimate.heading_rad)
            markers += [] if plan is None else [heading_marker(plan)]
        markers += [] if ground is None else [drop_marker(ground)]
        markers += [] if guard is None or guard.holding is None else [hold_marker(guard.holding)]
        return on.StairMarkers(t_s=t_s, markers=tuple(marker for marker in markers if marker is not None))

    def _recent(self, kind: type[T], t_s: float) -> T | None:
        signal: Any = self._newest.get(kind)
        return signal if signal is not None and t_s - signal.t_s <= MEMORY_S else None
