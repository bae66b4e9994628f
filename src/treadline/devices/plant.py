"""What the plants of both simulators do alike: orders go to the drives, ticks become readings and truth once somebody asks."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence

from treadline.devices.drives import Drives
from treadline.devices.instruments import ChairState, Instruments
from treadline.ports import Truth
from treadline.signals import FlipperCommand, Reading, SeatCommand, TrackCommand


class InstrumentedPlant(ABC):
    """Drives and instruments about a chair that a simulator moves."""

    def __init__(self, drives: Drives, instruments: Instruments) -> None:
        self._drives = drives
        self._instruments = instruments
        self._readings: list[Reading] = []
        self._truth: list[Truth] = []

    def read(self) -> Sequence[Reading]:
        """Return the samples that arrived since the last call; each kind in time order, camera readings later than their stamp."""
        self._sense()
        readings, self._readings = self._readings, []
        return readings

    def truth(self) -> Sequence[Truth]:
        """Return the truth of every tick since the last call."""
        self._sense()
        truth, self._truth = self._truth, []
        return truth

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        """Take the commands; they hold until the next call."""
        self._drives.take(tracks, seat, flipper)

    @abstractmethod
    def _passed(self) -> Iterator[tuple[ChairState, float]]:
        """Yield the states since the last call, each with the share of its friction that the stair had left."""

    def _forget(self) -> None:
        """Begin anew: what was not yet read is nobody's."""
        self._readings.clear()
        self._truth.clear()

    def _sense(self) -> None:
        for state, grip in self._passed():
            readings, truth = self._instruments.read(state, grip)
            self._readings.extend(readings)
            self._truth.append(truth)
