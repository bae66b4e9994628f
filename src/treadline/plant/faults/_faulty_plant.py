"""Fault injection: a plant that wraps another plant.

Sensor readings are modified on output, commands on input; the wrapped plant simulates damage of the chair itself. Random numbers
derive from the seed with one stream per fault, so that an additional fault leaves the others unchanged; before and after a fault
readings pass unmodified.

A timeout in the computer cannot act if the computer or its connection fails, so the last watchdog is in the actuators (hazards 11
and 22). The watchdog belongs to the faulty plant only: experiments and tests without faults write once and let time pass, and a
mission writes a hundred times per second.
"""

from collections.abc import Sequence
from typing import NamedTuple

from treadline.core.errors import SettingsError
from treadline.core.ports import Plant, Reading, Truth
from treadline.core.signals import ROUNDING_S, STATE_TICKS, TICK_S, FlipperCommand, PlantState, SeatCommand, TrackCommand
from treadline.guard import SILENCE_S
from treadline.plant.faults._damage import PHYSICAL, UNCHANGED, Breakable, Damage, damage_of
from treadline.plant.faults._sensor_faults import SensorFaults
from treadline.scenario.faults import Conditions, Fault, Process, is_killed
from treadline.scenario.operator_actions import OperatorAct
from treadline.scenario.scenario import Scenario

RATE_SILENCE_S = 0.05
"""Longest time without a command before seat and flipper stop [s]: rates are commanded a hundred times per second."""


class FaultyPlant:
    """Plant with faults, each active from ``at_s`` for ``for_s`` seconds, and with operator actions.

    Raises:
        SettingsError: If a fault damages the chair itself, and the wrapped plant does not support damage.
    """

    def __init__(self, plant: Plant, faults: Sequence[Fault], seed: int, acts: Sequence[OperatorAct] = ()) -> None:
        self._chair = plant if isinstance(plant, Breakable) else None
        for fault in faults:
            self._check(fault)
        self._plant = plant
        self.virtual_time: bool = getattr(plant, "virtual_time", False)
        """Whether time advances in ``advance`` alone, as in the wrapped plant."""
        self._given = tuple(faults)
        self.faults: list[Fault] = []
        """Faults of the run, those added while it runs included; the list grows with ``inject``."""
        self._seed = seed
        self._acts = tuple(acts)
        self._reset()

    def _check(self, fault: Fault) -> None:
        if fault.kind in PHYSICAL and self._chair is None:
            raise SettingsError(f"fault.kind '{fault.kind}': this plant cannot be broken, only a simulated chair can")

    def _reset(self) -> None:
        self._tick = 0
        self._readings: list[Reading] = []
        self._damage = Damage()
        self._conditions = UNCHANGED
        self.faults[:] = self._given
        self._sensors = SensorFaults(self.faults, self._seed, self._acts)
        self._channel = CommandChannel(self.faults)
        self._watchdog = Watchdog()
        self._reported: tuple[str | None, int] = (None, 0)

    def inject(self, fault: Fault) -> None:
        """Add a fault while the chair runs; a fault that began earlier begins now.

        An obstacle needs a plant that was made with one among its faults, however late: the body belongs to the model.

        Raises:
            SettingsError: If the fault damages the chair itself, and the wrapped plant does not support damage.
        """
        self._check(fault)
        self.faults.append(fault)
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
        """Return the ground truth of each tick since the last call; none of a plant without it."""
        return getattr(self._plant, "truth", tuple)()

    def close(self) -> None:
        """Release the wrapped plant."""
        self._plant.close()

    def _meet(self, t_s: float) -> None:
        """Apply the damage at this time, and deliver commands that are due."""
        damage = damage_of(self.faults, t_s, self._conditions)
        if damage != self._damage and self._chair is not None:
            self._chair.set_damage(damage)
        self._damage = damage
        self._act(t_s)

    def _act(self, t_s: float) -> None:
        command = self._watchdog.step(t_s, self._channel.arrived(t_s), powered=not self._damage.power_cut)
        fault = self._watchdog.fault
        state = (fault, 0 if fault is None else self._tick // STATE_TICKS)  # repeated: a message may be lost, or come too early
        if state != self._reported:
            self._reported = state
            self._readings.append(PlantState(t_s=t_s, fault=fault))
        if command is not None:
            self._plant.write(*command)


def faulty(plant: Plant, scenario: Scenario, seed: int) -> Plant:
    """Return a plant with the scenario's faults and operator actions, or the plant itself without any."""
    if not (scenario.fault or scenario.operator):
        return plant
    return FaultyPlant(plant, scenario.fault, seed, scenario.operator)


class Command(NamedTuple):
    """Commands of one write."""

    tracks: TrackCommand
    seat: SeatCommand
    flipper: FlipperCommand | None

    @classmethod
    def stop(cls, t_s: float) -> "Command":
        """Return the stop command of the watchdog."""
        return cls(TrackCommand.stop(t_s), SeatCommand(t_s=t_s, rate_m_s=0.0), None)


class CommandChannel:
    """Delay line for commands, with the delays and losses of the active faults."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        self._faults = faults
        self._under_way: list[tuple[float, Command]] = []
        self._seat = SeatCommand(t_s=0.0, rate_m_s=0.0)
        self._seat_s = 0.0

    def send(self, t_s: float, command: Command) -> None:
        """Enqueue a command; it replaces queued commands with a later arrival."""
        if is_killed(self._faults, Process.MISSION, t_s):
            return
        if not is_killed(self._faults, Process.SEAT, t_s):  # the seat actuator's own process may be stopped
            self._seat, self._seat_s = command.seat, t_s
        elif t_s - self._seat_s > SILENCE_S + ROUNDING_S:
            self._seat = SeatCommand(t_s=t_s, rate_m_s=0.0)
        late_s = max((fault.size for fault in self._faults if fault.kind == "late_tick" and fault.active(t_s)), default=0.0)
        due_s = t_s + late_s
        self._under_way = [(due, earlier) for due, earlier in self._under_way if due < due_s]
        self._under_way.append((due_s, command._replace(seat=self._seat)))

    def arrived(self, t_s: float) -> Command | None:
        """Return the newest command that arrived since the last call, or None."""
        arrived = [command for due_s, command in self._under_way if due_s <= t_s + ROUNDING_S]
        self._under_way = self._under_way[len(arrived) :]
        return arrived[-1] if arrived else None


class Watchdog:
    """Watchdog of the actuators: brakes on silence or power loss, and releases after a command to stand still."""

    def __init__(self) -> None:
        self._heard_s: float | None = None
        self._last: Command | None = None
        self._latched = False
        self.fault: str | None = None
        """Reason for the brake; None without one."""

    def step(self, t_s: float, command: Command | None, *, powered: bool) -> Command | None:
        """Return the command for the actuators for a received command or None; None keeps the last one."""
        was_latched = self._latched
        silent = command is None and self._heard_s is not None and t_s - self._heard_s > SILENCE_S + ROUNDING_S
        self._latched = was_latched or silent or not powered
        if self._latched and not was_latched:
            self.fault = f"no command for {t_s - (self._heard_s or 0.0):.2f} s" if silent else "no power"
        if command is None:
            return Command.stop(t_s) if self._latched and not was_latched else self._stilled(t_s)
        self._heard_s, self._last = t_s, command
        if powered and command.tracks.left_m_s == 0.0 and command.tracks.right_m_s == 0.0:
            self._latched, self.fault = False, None
        return command._replace(tracks=TrackCommand.stop(t_s)) if self._latched else command

    def _stilled(self, t_s: float) -> Command | None:
        """Return the last command with seat and flipper at rest, once, after ``RATE_SILENCE_S``; otherwise None."""
        if self._last is None or self._heard_s is None or self._latched or t_s - self._heard_s <= RATE_SILENCE_S + ROUNDING_S:
            return None
        flipper = None if self._last.flipper is None else FlipperCommand(t_s=t_s, rate_rad_s=0.0)
        stilled, self._last = self._last._replace(seat=SeatCommand(t_s=t_s, rate_m_s=0.0), flipper=flipper), None
        return stilled
