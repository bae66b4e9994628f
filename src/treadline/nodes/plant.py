"""The plant's node: a chair, simulated or real, at the other end of the wire from all that thinks.

``TrackCommand, SeatCommand, FlipperCommand -> readings``, each on its channel; the last watchdog is here.
"""

from treadline.mission.guard.latch import Button
from treadline.mission.rates import seat_now
from treadline.nodes import channels as on
from treadline.ports import Plant, Transport, TruthPlant
from treadline.signals import (
    TICK_S,
    FlipperCommand,
    FlipperReading,
    FrameQuality,
    HeadingMeasurement,
    ImuSample,
    OperatorInput,
    Reading,
    RgbdFrame,
    SeatCommand,
    SeatReading,
    StairMap,
    TrackCommand,
    TrackReading,
)

COMMAND_TIMEOUT_S = 0.3
"""The last watchdog lives at the actuator: without a command for so long it brakes by itself."""
LOST_S = 1.0
"""Without a command for so long the guard has died under way, and one that takes its place knows nothing of why it held: the brake
stays on until a person re-arms."""
FLIPPER_TIMEOUT_S = 0.1
"""How old what is asked of the flipper may be: it comes anew at each tick."""
TRUTH_TICKS = 10
"""A simulator tells people and tests how it is ten times a second; no node listens."""
SPOKEN: dict[type, str] = {
    ImuSample: on.IMU,
    TrackReading: on.TRACKS,
    SeatReading: on.SEAT,
    FlipperReading: on.FLIPPER,
    OperatorInput: on.OPERATOR,
    RgbdFrame: on.CAMERA,
    FrameQuality: on.CAMERA_QUALITY,
    HeadingMeasurement: on.CAMERA_HEADING,
    StairMap: on.CAMERA_MAP,
}
"""The channel of each reading of a plant."""


def spoken(reading: Reading) -> str:
    """Return the channel of a reading; a plant may have its own kind of frame."""
    return next(SPOKEN[kind] for kind in type(reading).__mro__ if kind in SPOKEN)


class PlantNode:
    """``TrackCommand, SeatCommand, FlipperCommand -> readings``: a chair, simulated or real, behind the ``Plant`` port."""

    name = "plant"
    publishes = (*SPOKEN.values(), on.TRUTH)
    needs = ()

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._seat = SeatCommand(t_s=0.0, rate_m_s=0.0)
        self._flipper: FlipperCommand | None = None
        self._t_s = self._heard_s = 0.0
        self._button = Button()
        self._driven = self._lost = False
        """Whether the chair was ever let go; whether its guard was lost since."""
        self.commanded_s = 0.0
        """Stamp of the newest command: how far the guard has come."""

    def listen(self, transport: Transport) -> None:
        """Take commands from the guard."""
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
        """Go on to this time, and tell what the sensors read."""
        silent_s = t_s - self._heard_s
        if silent_s > COMMAND_TIMEOUT_S:
            self._lost |= self._driven and silent_s > LOST_S
            self._brake(t_s)
        self._t_s = t_s
        self._plant.advance(t_s)
        for reading in self._plant.read():
            if isinstance(reading, OperatorInput):
                self._obey(reading)  # not every wire lets a node hear itself
            self._publish(spoken(reading), reading)
        if isinstance(self._plant, TruthPlant):
            for truth in self._plant.truth():
                if round(truth.t_s / TICK_S) % TRUTH_TICKS == 0:
                    self._publish(on.TRUTH, truth)

    def _write(self, tracks: TrackCommand) -> None:
        self._heard_s, self.commanded_s = self._t_s, tracks.t_s
        if self._lost:
            self._brake(tracks.t_s)
            return
        self._driven |= not tracks.brake
        flipper = self._flipper if self._flipper is not None and abs(tracks.t_s - self._flipper.t_s) <= FLIPPER_TIMEOUT_S else None
        self._plant.write(tracks, seat_now(self._seat, tracks.t_s), flipper)

    def _brake(self, t_s: float) -> None:
        self._plant.write(TrackCommand.stop(t_s), SeatCommand(t_s=t_s, rate_m_s=0.0), None)

    def _obey(self, operator: OperatorInput) -> None:
        """Let go of a brake that stayed on; a button that is stuck is not pressed."""
        if self._button.press(down=operator.rearm) and not operator.stop and operator.dead_man:
            self._lost = False

    def _level(self, command: SeatCommand) -> None:
        self._seat = command

    def _raise(self, command: FlipperCommand) -> None:
        self._flipper = command
