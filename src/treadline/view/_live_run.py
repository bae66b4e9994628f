"""Simulation of a live run in a process of its own, which never waits for the viewer.

``Order`` in; signals, frames and the verdict out, through a bounded queue: what finds no room stays with the worker until there is
some, and images are dropped. Commands of the person at the screen are applied between two ticks and returned as the script.
"""

import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from treadline.core.camera_images import RgbdFrame
from treadline.core.ports import Reading
from treadline.core.signals import BUTTONS, TICK_S, HeadingEstimate, MotionPlan, OperatorInput
from treadline.mission import Detection
from treadline.mission.planner import Planner, PlannerInput
from treadline.plant.faults import FaultyPlant
from treadline.plant.mujoco import open_plant
from treadline.playback import Limits, SignalCollector
from treadline.run.episode import Sink, Traverse, run_episode
from treadline.run.resolve import Setup, resolve
from treadline.run.scene_log import WatchedDetector
from treadline.scenario.faults import Conditions, Fault
from treadline.scenario.operator_actions import REPORT_TICKS
from treadline.scenario.scenario import Scenario
from treadline.vehicle.stair_solids import Box
from treadline.view._images import shown
from treadline.view._messages import MESSAGES_MAX, SEND_S, Command, ContactForces, Handset, Obstacle, Order, Script, ShownFrame
from treadline.view._what_if import FOREVER_S

PAUSED_S = 0.02
"""Interval at which a paused simulation looks for commands [s]."""


class Stopped(Exception):
    """The viewer ends the run."""


@dataclass(slots=True, kw_only=True)
class Pacer:
    """Holds a simulation to a multiple of real time."""

    speed: float
    """Simulated seconds per second; 0 is as fast as possible, negative is paused."""
    steps: int = 0
    """Ticks that a paused simulation may still make."""
    _began: tuple[float, float] | None = None

    def change(self, speed: float) -> None:
        """Set the speed from now on."""
        self.speed, self._began = speed, None

    def wait(self, t_s: float, look: Callable[[], None]) -> None:
        """Wait until the simulation may pass ``t_s``.

        Args:
            look: Looks for commands; called at least once, and in intervals during a pause.
        """
        look()
        while self.speed < 0.0 and self.steps <= 0:
            time.sleep(PAUSED_S)
            look()
        if self.speed <= 0.0:
            self.steps -= 1
            self._began = None
            return
        now = time.perf_counter()
        if self._began is None or now - self._began[1] - (t_s - self._began[0]) / self.speed > 1.0:
            self._began = (t_s, now)  # a second late: real time goes on from here, nothing is caught up
        early_s = (t_s - self._began[0]) / self.speed - (now - self._began[1])
        if early_s > 0.0:
            time.sleep(early_s)


class AttendedPlant(FaultyPlant):
    """Simulated chair with faults, whose readings include the reports of the handset in the browser."""

    handset: Handset | None = None
    """State of the handset; None before its first use: an unused handset does not report."""

    def read(self) -> list[Reading]:
        """Return the readings of the plant, and ten times a second the state of a handset in use."""
        readings = list(super().read())
        state = self.handset
        if state is not None and self._tick % REPORT_TICKS == 0:
            pressed = {name: getattr(state, name) for name in ("dead_man", *BUTTONS)}
            readings.append(OperatorInput(t_s=self._tick * TICK_S, **pressed))
        return readings


class AttendedPlanner:
    """Planner whose speeds a person replaces while steering; the phases go on by what the chair does."""

    def __init__(self, planner: Planner, plant: AttendedPlant) -> None:
        self._planner, self._plant = planner, plant

    def update(self, signal: PlannerInput) -> None:
        """Update the planner."""
        self._planner.update(signal)

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> MotionPlan:
        """Return the plan of this tick, with a person's speeds where a person steers."""
        plan, state = self._planner.step(t_s, estimate), self._plant.handset
        if state is None or not state.manual:
            return plan
        return replace(plan, speed_m_s=state.speed_m_s, turn_m_s=state.turn_m_s, min_inner_speed_ratio=None)

    @property
    def to_go_m(self) -> float | None:
        """Distance along the belts to the last nosing of the flight [m]; None while it is not known."""
        return self._planner.to_go_m


class LiveRun:
    """One run that is watched, commanded and paced.

    Args:
        order: The run.
        send: Takes a message if there is room for it, and returns whether there was.
        receive: Returns the commands since the last call.
        log: Receives every signal, as the log of a run does.
    """

    def __init__(
        self, order: Order, send: Callable[[Any], bool], receive: Callable[[], list[Any]], log: Sink | None = None
    ) -> None:
        self._order, self._send, self._receive, self._log = order, send, receive, log
        self._script: Script = sorted(order.script, key=lambda entry: entry[0])
        self._next = 0
        self._pacer = Pacer(speed=order.speed)
        self._tick = 0
        self._sent_at = 0.0
        self._waiting: list[Any] = []
        self._signals = SignalCollector()
        self._frames: list[ShownFrame] = []
        self._obstacle: Any = None
        self._asks_contacts = order.contacts
        self._contacts: list[ContactForces] = []

    def run(self) -> None:
        """Simulate to the end, and report the verdict."""
        order = self._order
        setup = resolve(
            with_reserve(order.scenario), order.controller, order.seed, detector=order.detector, estimator=order.estimator
        )
        walk = setup.report.walk
        if walk is not None and setup.seat_shift is None:
            self._waiting.append(("way", (walk.ground, walk.columns)))
        self._chair = open_plant(setup.scenario, setup.seed, chair=setup.chair)
        self._plant = AttendedPlant(self._chair, setup.scenario.fault, setup.seed, setup.scenario.operator)
        try:
            run = self._episode(setup)
        except Stopped:
            self._flush(None, None)
            return
        self._flush(run.verdict, run.cause)

    def _episode(self, setup: Setup) -> Traverse:
        blocks = None
        if not setup.refusal:
            built = setup.build_blocks()
            self._waiting.append(("limits", Limits.of_guard(asdict(built.guard.config))))
            blocks = replace(
                built, detector=WatchedDetector(built.detector, self._note), planner=AttendedPlanner(built.planner, self._plant)
            )
        return run_episode(
            setup,
            blocks=blocks,
            sink=self._sink,
            watch=lambda tick: self._after(tick.t_s),
            after_hold_s=0.0,
            plant=self._plant,
            faults=self._plant.faults,
            attended=self._order.attended,
            pace=lambda t_s: self._pacer.wait(t_s, self._look),
        )

    def _sink(self, signal: Any, taken_s: float) -> None:
        self._signals(signal, taken_s)
        if self._log is not None:
            self._log(signal, taken_s)

    def _note(self, frame: RgbdFrame, detection: Detection) -> None:
        roomy = self._order.pictures and len(self._waiting) < MESSAGES_MAX
        self._frames.append(shown(frame, detection, self._tick * TICK_S, with_picture=roomy))

    def _after(self, t_s: float) -> None:
        """Send and obey after a tick."""
        self._tick = round(t_s / TICK_S) + 1
        self._show_obstacle(t_s)
        if self._asks_contacts:
            points_W, forces_W = self._chair.contacts()
            contacts = ContactForces(t_s=t_s, points_W=points_W.astype(np.float32), forces_W=forces_W.astype(np.float32))
            self._contacts.append(contacts)
        now = time.perf_counter()
        if now - self._sent_at >= SEND_S:
            self._sent_at = now
            self._post()
        while self._next < len(self._script) and self._script[self._next][0] <= self._tick:
            self._apply(self._script[self._next][1])
            self._next += 1

    def _look(self) -> None:
        for kind, value in self._receive():
            match kind:
                case "speed":
                    self._pacer.change(value)
                    self._post()
                case "step":
                    self._pacer.steps += value
                case "act":
                    self._apply(value)
                    self._waiting.append(("script", (self._tick, value)))
                case "contacts":
                    self._asks_contacts = value
                case "end":
                    raise Stopped
                case _:
                    pass

    def _apply(self, command: Command) -> None:
        match command:
            case Handset():
                self._plant.handset = command
            case Conditions():
                self._plant.adjust(command)
            case Fault():
                self._plant.inject(command)

    def _show_obstacle(self, t_s: float) -> None:
        box = self._chair.obstacle
        if (box is None) != (self._obstacle is None):
            self._obstacle = box
            drawn = None
            if box is not None:
                (x, y, z), (a, b, c) = box.centre_W.tolist(), box.half_m.tolist()
                yaw_rad = math.atan2(box.R_WK[1, 0], box.R_WK[0, 0])
                drawn = Box(kind="obstacle", index=-1, centre_W=(x, y, z), half_m=(a, b, c), yaw_rad=yaw_rad)
            self._waiting.append(("obstacle", Obstacle(t_s=t_s, box=drawn)))

    def _post(self) -> None:
        if self._contacts:
            self._waiting.append(("contacts", self._contacts))
            self._contacts = []
        signals, frames = self._signals.take(), self._frames
        self._frames = []
        if frames or not signals.is_empty:
            self._waiting.append(("ticks", (signals, frames)))
        while self._waiting and self._send(self._waiting[0]):
            del self._waiting[0]

    def _flush(self, verdict: str | None, cause: str | None) -> None:
        """Send the rest and the verdict, however long the viewer takes: the simulation is over."""
        self._post()
        self._waiting.append(("end", (verdict, cause)))
        while self._waiting:
            if self._send(self._waiting[0]):
                del self._waiting[0]
            elif any(kind == "end" for kind, _ in self._receive()):
                return
            else:
                time.sleep(PAUSED_S)


def with_reserve(scenario: Scenario) -> Scenario:
    """Return a scenario whose model has the body of an obstacle, so that one can be put down at any time."""
    if any(fault.kind == "obstacle" for fault in scenario.fault):
        return scenario
    return scenario.model_copy(update={"fault": (*scenario.fault, Fault(kind="obstacle", at_s=FOREVER_S))})
