"""Fault injection: a ``TruthPlant`` that wraps another plant.

Sensor readings are modified on output, commands on input; the wrapped plant simulates damage of the chair itself. Random numbers
derive from the seed with one stream per fault, so that an additional fault leaves the others unchanged; before and after a fault
readings pass unmodified.
"""

from collections.abc import Sequence

from treadline.core.errors import SettingsError
from treadline.core.ports import Reading, Truth, TruthPlant
from treadline.core.signals import TICK_S, FlipperCommand, SeatCommand, TrackCommand
from treadline.plant.faults.command_channel import Command, CommandChannel, Watchdog
from treadline.plant.faults.damage import PHYSICAL, UNCHANGED, Breakable, Damage, damage_of
from treadline.plant.faults.sensor_faults import SensorFaults
from treadline.scenario.faults import Conditions, Fault
from treadline.scenario.operator_actions import OperatorAct
from treadline.scenario.scenario import Scenario


class FaultyPlant:
    """Plant with faults, each active from ``at_s`` for ``for_s`` seconds, and with operator actions.

    Raises:
        SettingsError: If a fault damages the chair itself, and the wrapped plant does not support damage.
    """

    def __init__(self, plant: TruthPlant, faults: Sequence[Fault], seed: int, acts: Sequence[OperatorAct] = ()) -> None:
        physical = [fault.kind for fault in faults if fault.kind in PHYSICAL]
        self._chair = plant if isinstance(plant, Breakable) else None
        if physical and self._chair is None:
            raise SettingsError(f"fault.kind '{physical[0]}': this plant cannot be broken, only a simulated chair can")
        self._plant = plant
        self._given = tuple(faults)
        self._faults: list[Fault] = []
        self._seed = seed
        self._acts = tuple(acts)
        self._reset()

    def _reset(self) -> None:
        self._tick = 0
        self._readings: list[Reading] = []
        self._damage = Damage()
        self._conditions = UNCHANGED
        self._faults[:] = self._given
        self._sensors = SensorFaults(self._faults, self._seed, self._acts)
        self._channel = CommandChannel(self._faults)
        self._watchdog = Watchdog()

    @property
    def faults(self) -> Sequence[Fault]:
        """Faults of the run, those added while it runs included; the sequence grows with ``inject``."""
        return self._faults

    def inject(self, fault: Fault) -> None:
        """Add a fault while the chair runs; a fault that began earlier begins now.

        An obstacle needs a plant that was made with one among its faults, however late: the body belongs to the model.

        Raises:
            SettingsError: If the fault damages the chair itself, and the wrapped plant does not support damage.
        """
        if fault.kind in PHYSICAL and self._chair is None:
            raise SettingsError(f"fault.kind '{fault.kind}': this plant cannot be broken, only a simulated chair can")
        self._faults.append(fault)
        self._sensors.add(fault, self._tick * TICK_S)
        self._meet(self._tick * TICK_S)

    def adjust(self, conditions: Conditions) -> None:
        """Replace the present conditions while the chair runs; they hold until the next call or start.

        Raises:
            SettingsError: If the wrapped plant does not support damage.
        """
        if self._chair is None:
            raise SettingsError("friction and payload of this plant cannot be changed, only those of a simulated chair can")
        self._conditions = conditions
        self._meet(self._tick * TICK_S)

    @property
    def damage(self) -> Damage:
        """Present damage by faults and conditions."""
        return self._damage

    def start(self) -> None:
        """Put the chair at its start pose and reset all faults."""
        self._plant.start()
        self._reset()
        self._meet(0.0)

    def advance(self, until_s: float) -> None:
        """Advance to ``until_s`` tick by tick, so that each fault starts and ends at its own tick."""
        for tick in range(self._tick + 1, round(until_s / TICK_S) + 1):
            # These readings precede the faults of this tick.
            self._readings += self._plant.read()
            self._plant.advance(tick * TICK_S)
            self._tick = tick
            self._meet(tick * TICK_S)

    def read(self) -> Sequence[Reading]:
        """Return all samples since the last call, in time order unless a fault changes the order."""
        readings, self._readings = [*self._readings, *self._plant.read()], []
        return self._sensors.deliver(self._tick * TICK_S, readings)

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        """Send commands through the command channel."""
        t_s = self._tick * TICK_S
        self._channel.send(t_s, Command(tracks, seat, flipper))
        self._act(t_s)

    def truth(self) -> Sequence[Truth]:
        """Return the ground truth of each tick since the last call."""
        return self._plant.truth()

    def close(self) -> None:
        """Release the wrapped plant."""
        self._plant.close()

    def _meet(self, t_s: float) -> None:
        """Apply the damage at this time, and deliver commands that are due."""
        damage = damage_of(self._faults, t_s, self._conditions)
        if damage != self._damage and self._chair is not None:
            self._chair.set_damage(damage)
        self._damage = damage
        self._act(t_s)

    def _act(self, t_s: float) -> None:
        command = self._watchdog.step(t_s, self._channel.arrived(t_s), powered=not self._damage.power_cut)
        if command is not None:
            self._plant.write(*command)


def faulty(plant: TruthPlant, scenario: Scenario, seed: int) -> TruthPlant:
    """Return a plant with the scenario's faults and operator actions, or the plant itself without any."""
    if not (scenario.fault or scenario.operator):
        return plant
    return FaultyPlant(plant, scenario.fault, seed, scenario.operator)
