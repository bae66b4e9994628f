"""Threads of one device: what may wait for the device waits here, and the guard's tick takes from queues alone.

Even a non-blocking read of a terminal or serial line waits for a kernel worker of ordinary priority (``tty_buffer_flush_work``): on
a busy computer a quarter of a second, whatever the priority of the reader.
"""

import contextlib
import os
import select
import time
from collections import deque
from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Generic, TypeVar

from treadline.core.errors import LinkError

WAKE_S = 0.1
"""Longest wait of the reader for an item [s]; it looks then whether the device was closed."""
CLOSE_S = 3.0 * WAKE_S
"""Longest wait for the end of each thread [s]: a reader looks up three times."""
ARRIVED, WAITING = 1024, 32
"""Items that wait for the tick, and items that wait for the device: three of the largest bursts of a tick, a re-arm of two axes."""
CHUNK = 65536
"""Bytes read at once, more than a system buffers."""
In = TypeVar("In")
Out = TypeVar("Out")


class DeviceThreads(Generic[In, Out]):
    """Reader and writer of one device, with the scheduling of the thread that starts them. No call but ``close`` waits.

    Args:
        receive: Waits for an item for the given time at most [s], and returns it, or a false value.
        transmit: Writes an item; None for a device that is only read.
        gone: Returns the text for the person when one of the two has raised an error.
    """

    def __init__(
        self, receive: Callable[[float], In | None], transmit: Callable[[Out], object] | None, gone: Callable[[Exception], str]
    ) -> None:
        self._receive, self._transmit, self._gone = receive, transmit, gone
        self._arrived: deque[tuple[float, In]] = deque(maxlen=ARRIVED)
        self._waiting: SimpleQueue[Out | None] = SimpleQueue()
        self._error: LinkError | None = None
        self._is_closed = False
        self.awake_s = time.monotonic()
        """Monotonic time at which the reader last came by [s]."""
        works = [self._read] if transmit is None else [self._read, self._write]
        self._threads = [Thread(target=self._run, args=(work,), daemon=True) for work in works]
        for thread in self._threads:
            thread.start()

    def read(self) -> list[tuple[float, In]]:
        """Return the items since the last call, each with the monotonic time of its arrival [s]; of too many the newest.

        Raises:
            LinkError: If a thread has ended with an error, once all that arrived before was returned.
        """
        error = self._error
        arrived = [self._arrived.popleft() for _ in range(len(self._arrived))]
        if error is not None and not arrived:
            raise error
        return arrived

    def write(self, item: Out) -> None:
        """Queue an item; a device that takes nothing keeps the newest alone, because older commands are out of date."""
        if self._waiting.qsize() >= WAITING:
            with contextlib.suppress(Empty):
                while True:
                    self._waiting.get_nowait()
        self._waiting.put(item)

    def close(self) -> None:
        """Write what is queued and end both threads; one that is stuck in its device is left behind."""
        self._is_closed = True
        self._waiting.put(None)
        for thread in self._threads:
            thread.join(CLOSE_S)

    def _run(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception as error:  # noqa: BLE001 - a driver may raise anything
            self._error = error if isinstance(error, LinkError) else LinkError(self._gone(error))

    def _read(self) -> None:
        while not self._is_closed:
            item = self._receive(WAKE_S)
            self.awake_s = time.monotonic()
            if item:
                self._arrived.append((self.awake_s, item))

    def _write(self) -> None:
        assert self._transmit is not None  # noqa: S101 - for the type checker
        while (item := self._waiting.get()) is not None:
            self._transmit(item)


def received_bytes(descriptor: int, within_s: float) -> bytes:
    """Return the bytes that arrive at a descriptor within a time [s], or none.

    Raises:
        OSError: If the other end is closed.
    """
    if not select.select([descriptor], [], [], within_s)[0]:
        return b""
    data = os.read(descriptor, CHUNK)
    if not data:
        raise OSError("it returned no data")
    return data


def write_or_lose(descriptor: int, data: bytes) -> None:
    """Write bytes to a descriptor that does not block; what it does not take is lost."""
    with contextlib.suppress(OSError):
        os.write(descriptor, data)
