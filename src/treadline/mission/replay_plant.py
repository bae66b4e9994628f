"""A recording as a ``Plant``: it delivers the recorded readings, and commands have no effect.

``Mission`` runs on it as on any chair. The IMU of a recording may be mounted in the camera, and may report no attitude; its samples
are converted to the chair's frame, with an attitude.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from treadline.core.ports import Reading
from treadline.core.rotations import Rotation, quaternion_of, rotation_of
from treadline.core.signals import ROUNDING_S, FlipperCommand, ImuSample, SeatCommand, TrackCommand
from treadline.estimation.tilt import Tilt

UNIT = 0.01
"""Largest deviation of a squared quaternion norm from one; recordings keep few digits."""


class ReplayPlant:
    """Recorded readings, delivered at the mission's pace.

    Args:
        arrivals: Readings, each with the mission time at which it is delivered [s], in time order from zero.
        R_BI: Rotation of the IMU's axes in the chair's frame; None where the IMU reads in the chair's frame already.
    """

    virtual_time = True
    """Time advances in ``advance`` alone."""

    def __init__(self, arrivals: Iterable[tuple[float, Reading]], R_BI: Rotation | None = None) -> None:
        self._arrivals = iter(arrivals)
        self._R_BI = R_BI
        self._tilt = Tilt()
        self._next: tuple[float, Reading] | None = None
        self._due: list[Reading] = []

    @property
    def over(self) -> bool:
        """Whether all recorded readings have been delivered."""
        return self._next is None and not self._due

    def start(self) -> None:
        """Fetch the first reading."""
        self._next = next(self._arrivals, None)

    def advance(self, until_s: float) -> None:
        """Collect the readings that arrive until ``until_s``."""
        while self._next is not None and self._next[0] <= until_s + ROUNDING_S:
            recorded = self._next[1]
            reading = self._attitude_of(recorded) if isinstance(recorded, ImuSample) else recorded
            if reading is not None:
                self._due.append(reading)
            self._next = next(self._arrivals, None)

    def read(self) -> Sequence[Reading]:
        """Return every reading since the last call, in the order of arrival."""
        due, self._due = self._due, []
        return due

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        """Ignore commands."""

    def close(self) -> None:
        """Do nothing: a recording holds no resources."""

    def _attitude_of(self, sample: ImuSample) -> ImuSample | None:
        """Return a sample in the chair's frame with an orientation, or None while there can be none."""
        R_BI = self._R_BI
        given = abs(sum(q * q for q in sample.orientation) - 1.0) < UNIT
        if R_BI is not None:
            turned = tuple(quaternion_of(rotation_of(sample.orientation) @ R_BI.T).tolist()) if given else sample.orientation
            sample = replace(
                sample,
                orientation=turned,
                angular_velocity_rad_s=tuple((R_BI @ sample.angular_velocity_rad_s).tolist()),
                linear_acceleration_m_s2=tuple((R_BI @ sample.linear_acceleration_m_s2).tolist()),
            )
        if given:
            return sample
        orientation = self._tilt.step(sample)
        return None if orientation is None else replace(sample, orientation=tuple(orientation.tolist()))
