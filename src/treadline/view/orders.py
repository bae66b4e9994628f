"""Orders to the simulation of a live run, and its process: ``Order -> messages``, commands in.

Nothing heavy is imported here: the process that serves the page starts the simulation before it knows more.
"""

import os
import queue
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import get_context
from multiprocessing.context import SpawnProcess
from typing import Any, Literal

from treadline.core.errors import TreadlineError
from treadline.core.images import PinholeCamera
from treadline.core.processes import end_with_parent
from treadline.scenario.faults import Conditions, Fault
from treadline.scenario.scenario import Scenario

MESSAGES_MAX = 50
"""Messages on the way to the viewer: two seconds' worth; a viewer further behind gets no images."""

NICENESS = 10
"""Niceness of what the first picture need not wait for: that of the command ``nice`` without a number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Handset:
    """State of the handset in the browser."""

    dead_man: bool = True
    stop: bool = False
    rearm: bool = False
    manual: bool = False
    """Whether the person steers instead of the planner."""
    speed_m_s: float = 0.0
    """Mean belt speed of a person who steers [m/s]."""
    turn_m_s: float = 0.0
    """Half the difference of the belt speeds of a person who steers, right minus left [m/s]; positive turns left."""


Command = Fault | Handset | Conditions
"""Command of a person to a running simulation."""
Script = list[tuple[int, Command]]
"""Commands with the tick before which each was given."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """Run for a worker."""

    scenario: Scenario
    seed: int
    controller: Any = None
    detector: str | None = None
    estimator: str | None = None
    script: tuple[tuple[int, Command], ...] = ()
    """Commands that are applied at their ticks."""
    speed: float = 1.0
    """Simulated seconds per second; 0 is as fast as possible."""
    attended: bool = False
    """Whether a person may command the run, so that it goes on after a hold."""
    pictures: bool = True
    """Whether camera images are drawn."""
    contacts: bool = False
    """Whether the contact forces of every tick are sent: a tenth of the time of the physics."""
    until_s: float | None = None
    """Time at which the run is ended [s]; None: at its own end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageOrder:
    """Images of a log, for a worker that runs the detector on them."""

    log: str
    """MCAP file."""
    vision: Literal["robust", "paper"] = "robust"
    """Method of the detector."""
    camera: PinholeCamera
    """Camera with its mount on the chair, which images in a log do not have."""
    swept_half_m: float
    """Half width of the volume swept by the chair [m]."""
    latency_s: float = 0.0
    """Time from exposure to the mission [s]."""


def work(order: Order | ImageOrder, messages: Any, commands: Any) -> None:
    """Run an order in a process: messages out, commands in."""
    end_with_parent()

    def send(message: Any) -> bool:
        try:
            messages.put_nowait(message)
        except queue.Full:
            return False
        return True

    def receive() -> list[Any]:
        received = []
        while True:
            try:
                received.append(commands.get_nowait())
            except queue.Empty:
                return received

    try:
        if isinstance(order, ImageOrder):
            if hasattr(os, "nice"):
                os.nice(NICENESS)
            from treadline.view.images import send_looks

            send_looks(order, messages.put)
        else:
            load_behind("treadline.view.worker")
            from treadline.view.worker import LiveRun

            LiveRun(order, send, receive).run()
    except TreadlineError as error:
        messages.put(("error", str(error)))
    except KeyboardInterrupt:
        pass


def load_behind(module: str) -> None:
    """Import a module at low priority, so that the browser's first picture does not share the processor with it.

    Without privileges, a priority cannot be raised again; so a further thread imports, and the run keeps its priority.
    Only Linux has priorities of threads; elsewhere the import has the priority of the process.
    """

    def load() -> None:
        if sys.platform == "linux":
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
        with suppress(ImportError):  # raised again, in the main thread, by the import that follows
            import_module(module)

    thread = threading.Thread(target=load, name="load")
    thread.start()
    thread.join()


class Worker:
    """Process of a live run or of the images of a log, seen from the viewer."""

    def __init__(self, order: Order | ImageOrder) -> None:
        context = get_context("spawn")
        self._messages = context.Queue(MESSAGES_MAX)
        self._commands = context.Queue()
        self._process: SpawnProcess = context.Process(
            target=work, args=(order, self._messages, self._commands), name="treadline-view", daemon=True
        )
        self._process.start()

    def receive(self) -> list[Any]:
        """Return the messages since the last call."""
        received = []
        while True:
            try:
                received.append(self._messages.get_nowait())
            except queue.Empty:
                return received

    def send(self, kind: str, value: Any = None) -> None:
        """Send a command."""
        self._commands.put((kind, value))

    @property
    def is_alive(self) -> bool:
        """Whether the process runs."""
        return self._process.is_alive()

    def close(self) -> None:
        """End the process."""
        self.send("end")
        self._process.join(1.0)
        if self._process.is_alive():
            self._process.terminate()
            self._process.join(1.0)
        self._commands.cancel_join_thread()
        self._commands.close()
