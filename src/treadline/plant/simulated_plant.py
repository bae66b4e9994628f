"""Common part of the plants of both simulators: commands to the actuators, readings and ground truth from the states."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence

from treadline.core.ports import Reading, Truth
from treadline.core.signals import FlipperCommand, SeatCommand, TrackCommand
from treadline.plant.actuators import Actuators
from treadline.plant.sensors.instruments import ChairState, Instruments


class InstrumentedPlant(ABC):
    """Plant with actuators and instruments; a simulator moves the bodies."""

    def __init__(self, drives: Actuators, instruments: Instruments) -> None:
        self._drives = drives
        self._instruments = instruments
        self._readings: list[Reading] = []
        self._truth: list[Truth] = []

    def read(self) -> Sequence[Reading]:
        """Return the samples that arrived since the last call, each kind in time order, camera readings with a delay."""
        self._sense()
        readings, self._readings = self._readings, []
        return readings

    def truth(self) -> Sequence[Truth]:
        """Return the ground truth of each tick since the last call."""
        self._sense()
        truth, self._truth = self._truth, []
        return truth

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        """Set the commands; they hold until the next call."""
        self._drives.take(tracks, seat, flipper)

    @abstractmethod
    def _passed(self) -> Iterator[tuple[ChairState, float]]:
        """Yield the states since the last call, each with the remaining fraction of the stair's friction."""

    def _forget(self) -> None:
        """Discard all unread samples at a restart."""
        self._readings.clear()
        self._truth.clear()

    def _sense(self) -> None:
        for state, grip in self._passed():
            readings, truth = self._instruments.read(state, grip)
            self._readings.extend(readings)
            self._truth.append(truth)
