"""The plant node: a chair, simulated or real, behind the ``Plant`` port.

``TrackCommand, SeatCommand, FlipperCommand -> readings``, each on its channel, at the tick of its arrival. It holds the last
watchdog.
"""

from treadline.core.camera_images import RgbdFrame
from treadline.core.ports import Plant, Reading, Transport, TruthPlant
from treadline.core.signals import (
    TICK_S,
    FlipperCommand,
    FlipperReading,
    FrameQuality,
    FreeGround,
    HeadingMeasurement,
    ImuSample,
    OperatorInput,
    SeatCommand,
    SeatReading,
    StairMap,
    TrackCommand,
    TrackReading,
)
from treadline.guard.stop_latch import Button
from treadline.mission import seat_now
from treadline.ros import channels as on
from treadline.ros.block_nodes import FLIPPER_TIMEOUT_S

COMMAND_TIMEOUT_S = 0.3
"""Command timeout of the watchdog at the actuator [s]: without a command for longer the plant brakes by itself."""
LOST_S = 1.0
"""Command timeout after which the guard counts as dead [s]. Its successor does not know why it held: the brake stays on until a
person re-arms."""
TRUTH_TICKS = 10
"""Ticks between two messages of the ground truth, for people and tests; no node subscribes."""
CHANNEL_OF: dict[type, str] = {
    ImuSample: on.IMU,
    TrackReading: on.TRACKS,
    SeatReading: on.SEAT,
    FlipperReading: on.FLIPPER,
    OperatorInput: on.OPERATOR,
    RgbdFrame: on.CAMERA,
    FrameQuality: on.CAMERA_QUALITY,
    FreeGround: on.GROUND,
    HeadingMeasurement: on.CAMERA_HEADING,
    StairMap: on.CAMERA_MAP,
}
"""The channel of each reading of a plant."""


def channel_of(reading: Reading) -> str:
    """Return the channel of a reading; a plant may have its own subclass of a frame."""
    return next(CHANNEL_OF[kind] for kind in type(reading).__mro__ if kind in CHANNEL_OF)


class PlantNode:
    """``TrackCommand, SeatCommand, FlipperCommand -> readings``: a chair, simulated or real, behind the ``Plant`` port."""

    name = "plant"
    publishes = (*CHANNEL_OF.values(), on.TRUTH)
    needs = ()

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._seat = SeatCommand(t_s=0.0, rate_m_s=0.0)
        self._flipper: FlipperCommand | None = None
        self._t_s = self._commanded_at_s = 0.0
        self._button = Button()
        self._driven = self._lost = False
        """Whether the brake was ever released; whether the guard was lost since."""
        self.commanded_s = 0.0
        """Stamp of the newest command: progress of the guard."""

    def listen(self, transport: Transport) -> None:
        """Subscribe to the guard's commands and the operator."""
        self._publish = transport.publish
        transport.subscribe(on.TRACKS_CMD, self._write)
        transport.subscribe(on.SEAT_CMD, self._level)
        transport.subscribe(on.FLIPPER_CMD, self._raise)
        transport.subscribe(on.OPERATOR, self._obey)

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
        silent_s = t_s - self._commanded_at_s
        if silent_s > COMMAND_TIMEOUT_S:
            self._lost |= self._driven and silent_s > LOST_S
            self._brake(t_s)
        self._t_s = t_s
        self._plant.advance(t_s)
        for reading in self._plant.read():
            if isinstance(reading, OperatorInput):
                self._obey(reading)  # not every transport delivers a node's own messages
            self._publish(channel_of(reading), reading)
        if isinstance(self._plant, TruthPlant):
            for truth in self._plant.truth():
                if round(truth.t_s / TICK_S) % TRUTH_TICKS == 0:
                    self._publish(on.TRUTH, truth)

    def _write(self, tracks: TrackCommand) -> None:
        self._commanded_at_s, self.commanded_s = self._t_s, tracks.t_s
        if self._lost:
            self._brake(tracks.t_s)
            return
        self._driven |= not tracks.brake
        flipper = self._flipper if self._flipper is not None and abs(tracks.t_s - self._flipper.t_s) <= FLIPPER_TIMEOUT_S else None
        self._plant.write(tracks, seat_now(self._seat, tracks.t_s), flipper)

    def _brake(self, t_s: float) -> None:
        self._plant.write(TrackCommand.stop(t_s), SeatCommand(t_s=t_s, rate_m_s=0.0), None)

    def _obey(self, operator: OperatorInput) -> None:
        """Release a brake that stayed on; a button that is stuck does not count as pressed."""
        if self._button.press(down=operator.rearm) and not operator.stop and operator.dead_man:
            self._lost = False

    def _level(self, command: SeatCommand) -> None:
        self._seat = command

    def _raise(self, command: FlipperCommand) -> None:
        self._flipper = command
