"""Process of a live run or of the images of a log: ``Order -> messages``, commands in.

Nothing heavy is imported here: the process that serves the page starts the simulation before it knows more.
"""

import os
import queue
import sys
import threading
from contextlib import suppress
from importlib import import_module
from multiprocessing import get_context
from multiprocessing.context import SpawnProcess
from typing import Any

from treadline.core.errors import TreadlineError
from treadline.core.processes import end_with_parent
from treadline.view._messages import MESSAGES_MAX, ImageOrder, Order

NICENESS = 10
"""Niceness of what the first picture need not wait for: that of the command ``nice`` without a number."""


class Worker:
    """Process of an order, seen from the viewer."""

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
        return waiting_in(self._messages)

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


def waiting_in(messages: Any) -> list[Any]:
    """Return what waits in a queue."""
    received = []
    with suppress(queue.Empty):
        while True:
            received.append(messages.get_nowait())
    return received


def work(order: Order | ImageOrder, messages: Any, commands: Any) -> None:
    """Run an order in a process: messages out, commands in."""
    end_with_parent()

    def send(message: Any) -> bool:
        try:
            messages.put_nowait(message)
        except queue.Full:
            return False
        return True

    try:
        if isinstance(order, ImageOrder):
            if hasattr(os, "nice"):
                os.nice(NICENESS)
            from treadline.view._images import send_frames

            send_frames(order, messages.put)
        else:
            load_behind("treadline.view._live_run")
            from treadline.view._live_run import LiveRun

            LiveRun(order, send, lambda: waiting_in(commands)).run()
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
