"""The faults a scenario may inject."""

from typing import Annotated, Literal

from pydantic import Field

from treadline.settings import Settings

FaultKind = Literal[
    "camera_lost", "camera_frozen", "camera_dark", "depth_holes", "false_edges", "imu_nan", "imu_stuck", "imu_bias",
    "imu_lost", "clock_back", "late_tick", "track_stalled", "track_slip", "low_friction", "operator_stop",
    "link_lost", "seat_stuck", "process_killed", "power_cut", "obstacle",
]  # fmt: skip


class Fault(Settings):
    """One fault: from ``at_s``, for ``for_s`` seconds, of size ``value`` (its unit depends on the kind)."""

    kind: FaultKind
    at_s: Annotated[float, Field(ge=0.0)] = 10.0
    for_s: Annotated[float, Field(gt=0.0)] = 3.0
    value: float = 0.0

    def active(self, t_s: float) -> bool:
        """Say whether the fault is on at ``t_s``."""
        return self.at_s <= t_s < self.at_s + self.for_s
