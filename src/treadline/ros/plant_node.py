"""The plant node: a chair, simulated or real, behind the ``Plant`` port and the last guard.

``TrackCommand, SeatCommand, FlipperCommand -> readings``, each on its channel, at the tick of its arrival.
"""

from collections.abc import Callable

from treadline.core.ports import Plant, Transport, TruthPlant
from treadline.core.signals import (
    STATE_TICKS,
    TICK_S,
    FlipperCommand,
    FrameQuality,
    HeadingMeasurement,
    OperatorInput,
    PlantState,
    SeatCommand,
    StairMap,
    TrackCommand,
)
from treadline.guard import GuardConfig, LastGuard
from treadline.io.messages import topic_of
from treadline.ros import channels as on

OF_THE_CAMERA: dict[type, str] = {
    FrameQuality: on.CAMERA_QUALITY,
    HeadingMeasurement: on.CAMERA_HEADING,
    StairMap: on.CAMERA_MAP,
}
"""Channels of a camera that measures by itself; the camera node publishes on those of a log."""


class PlantNode:
    """``TrackCommand, SeatCommand, FlipperCommand -> readings``: a chair, simulated or real, behind the ``Plant`` port."""

    name = "plant"
    publishes = (*on.SENSORS, on.PLANT, *OF_THE_CAMERA.values(), on.GROUND, on.TRUTH)
    needs = ()

    def __init__(self, plant: Plant, config: GuardConfig) -> None:
        self._plant = plant
        self.last_guard = LastGuard(config)
        """Admission of the guard's commands; its ``fault`` is published as the plant's state."""
        self.brake: Callable[[], object] | None = getattr(plant, "brake", None)
        """Brake out of band, which a second thread may call; None if the plant has none."""
        self._published: str | None = None
        self.commanded_s = 0.0
        """Stamp of the newest command: progress of the guard."""

    def listen(self, transport: Transport) -> None:
        """Subscribe to the guard's commands and the operator."""
        self._publish = transport.publish
        for channel in on.COMMANDS:
            transport.subscribe(channel, self._obey)
        transport.subscribe(on.OPERATOR, self.last_guard.operate)

    def start(self) -> None:
        """Put the chair at its start."""
        self._plant.start()

    def close(self) -> None:
        """Leave the chair, or its simulator."""
        self._plant.close()

    def advance(self, t_s: float) -> None:
        """Do nothing: the plant makes the time."""

    def tick(self, t_s: float) -> None:
        """Advance the plant, and publish the readings that arrive."""
        self.last_guard.advance(t_s)
        self._brake()
        self._plant.advance(t_s)
        for reading in self._plant.read():
            if isinstance(reading, OperatorInput):
                self.last_guard.operate(reading)  # not every transport delivers a node's own messages
            self._publish(OF_THE_CAMERA.get(type(reading)) or topic_of(reading), reading)
        tick = round(t_s / TICK_S)
        if self.last_guard.fault != self._published or tick % STATE_TICKS == 0:
            self._published = self.last_guard.fault
            self._publish(on.PLANT, PlantState(t_s=t_s, fault=self._published))
        if isinstance(self._plant, TruthPlant):
            for truth in self._plant.truth():
                if round(truth.t_s / TICK_S) % STATE_TICKS == 0:
                    self._publish(on.TRUTH, truth)

    def trip(self, cause: str) -> None:
        """Brake by itself, until a person re-arms."""
        self.last_guard.trip(cause)
        self._brake()

    def hear_nothing(self, silent_s: float) -> None:
        """Brake where the guard has not answered for too long by the wall clock, while the plant's own clock stands."""
        if not self.last_guard.is_braking:
            self.last_guard.check_silence(silent_s)
            self._brake()

    def _brake(self) -> None:
        if self.last_guard.is_braking:
            self._plant.write(*self.last_guard.commands())

    def _obey(self, command: TrackCommand | SeatCommand | FlipperCommand) -> None:
        accepted = self.last_guard.accept(command)
        if not accepted:
            self._brake()
        elif isinstance(command, TrackCommand):
            self.commanded_s = command.t_s
            self._plant.write(*self.last_guard.commands())
