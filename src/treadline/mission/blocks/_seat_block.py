"""Seat block: ``ImuSample, SeatReading -> SeatCommand``."""

from typing import Protocol, runtime_checkable

from treadline.core.signals import ImuSample, SeatCommand, SeatReading


@runtime_checkable
class SeatLeveller(Protocol):
    """Control loop of the seat."""

    def step(self, reading: SeatReading, imu: ImuSample | None) -> SeatCommand:
        """Return the rate of the seat actuator."""


class SeatBlock:
    """Levels the seat by its own reading and the last sample of the chassis' IMU."""

    def __init__(self, leveller: SeatLeveller) -> None:
        self._leveller = leveller
        self._imu: ImuSample | None = None

    def update(self, sample: ImuSample) -> None:
        """Remember an IMU sample."""
        self._imu = sample

    def step(self, reading: SeatReading) -> SeatCommand:
        """Return the command that answers a reading."""
        return self._leveller.step(reading, self._imu)
