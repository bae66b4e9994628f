"""A simulated chair with faults: a ``TruthPlant`` around another.

Sensors are spoilt on their way out, orders on their way in; what is broken of the chair itself the chair plays. Chance comes
from the seed, one stream per fault, so that a fault more or less changes no other; before and after a fault readings pass as
they are.
"""

from collections.abc import Sequence

from treadline.attendant import OperatorAct
from treadline.errors import SettingsError
from treadline.faults import Fault
from treadline.ports import Truth, TruthPlant
from treadline.scenario import Scenario
from treadline.signals import TICK_S, FlipperCommand, Reading, SeatCommand, TrackCommand
from treadline.sim.faults.damage import PHYSICAL, Breakable, Damage, damage_of
from treadline.sim.faults.orders import Line, Order, Watchdog
from treadline.sim.faults.sensors import SensorFaults


class FaultyPlant:
    """Injects each fault from its ``at_s`` for its ``for_s``, and what the person in charge does.

    Raises:
        SettingsError: If a fault is one of the chair itself, and this chair cannot be broken.
    """

    def __init__(self, plant: TruthPlant, faults: Sequence[Fault], seed: int, acts: Sequence[OperatorAct] = ()) -> None:
        physical = [fault.kind for fault in faults if fault.kind in PHYSICAL]
        self._chair = plant if isinstance(plant, Breakable) else None
        if physical and self._chair is None:
            raise SettingsError(f"fault.kind '{physical[0]}': this plant cannot be broken, only a simulated chair can")
        self._plant = plant
        self._faults = tuple(faults)
        self._seed = seed
        self._acts = tuple(acts)
        self._reset()

    def _reset(self) -> None:
        self._tick = 0
        self._readings: list[Reading] = []
        self._damage = Damage()
        self._sensors = SensorFaults(self._faults, self._seed, self._acts)
        self._line = Line(self._faults)
        self._watchdog = Watchdog()

    def start(self) -> None:
        """Put the chair at its start; every fault is still to come."""
        self._plant.start()
        self._reset()
        self._meet(0.0)

    def advance(self, until_s: float) -> None:
        """Go on to ``until_s``, tick by tick: each fault begins and ends at its own."""
        for tick in range(self._tick + 1, round(until_s / TICK_S) + 1):
            # What was seen so far was seen before this tick's faults.
            self._readings += self._plant.read()
            self._plant.advance(tick * TICK_S)
            self._tick = tick
            self._meet(tick * TICK_S)

    def read(self) -> Sequence[Reading]:
        """Return every sample that has arrived since the last call, in time order unless a fault says otherwise."""
        readings, self._readings = [*self._readings, *self._plant.read()], []
        return self._sensors.deliver(self._tick * TICK_S, readings)

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        """Send commands on their way."""
        t_s = self._tick * TICK_S
        self._line.send(t_s, Order(tracks, seat, flipper))
        self._act(t_s)

    def truth(self) -> Sequence[Truth]:
        """Return the truth of every tick since the last call."""
        return self._plant.truth()

    def close(self) -> None:
        """Release the plant."""
        self._plant.close()

    def _meet(self, t_s: float) -> None:
        """Break and mend what is due, and let arrive what is under way."""
        damage = damage_of(self._faults, t_s)
        if damage != self._damage and self._chair is not None:
            self._chair.suffer(damage)
        self._damage = damage
        self._act(t_s)

    def _act(self, t_s: float) -> None:
        order = self._watchdog.step(t_s, self._line.arrived(t_s), powered=not self._damage.power_cut)
        if order is not None:
            self._plant.write(*order)


def faulty(plant: TruthPlant, scenario: Scenario, seed: int) -> TruthPlant:
    """Return a plant with the scenario's faults and operator; the plant itself where there are none."""
    if not (scenario.fault or scenario.operator):
        return plant
    return FaultyPlant(plant, scenario.fault, seed, scenario.operator)
