"""Interrupts never leave half a record: a Ctrl-C inside ``deferred`` is raised at the end of the block."""

import os
import signal
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.writer import Writer

from treadline.core.processes import Interrupts, Terminated, deferred, on_terminate
from treadline.core.signals import TrackCommand
from treadline.io.mcap_log import RunLog
from treadline.io.mcap_read import read_log


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """Install our handlers for one test."""
    before = [(number, signal.getsignal(number)) for number in (signal.SIGINT, signal.SIGTERM)]
    signal.signal(signal.SIGINT, Interrupts())
    signal.signal(signal.SIGTERM, on_terminate)
    yield
    for number, handler in before:
        signal.signal(number, handler)


def test_an_interrupt_waits_for_the_end_of_the_outermost_block() -> None:
    reached = []

    def nested() -> None:
        with deferred():
            with deferred():
                os.kill(os.getpid(), signal.SIGINT)
                reached.append("inner")
            reached.append("outer")

    with pytest.raises(KeyboardInterrupt):
        nested()
    assert reached == ["inner", "outer"]


def test_a_request_to_end_keeps_its_kind() -> None:
    with pytest.raises(Terminated), deferred():
        os.kill(os.getpid(), signal.SIGTERM)


def test_outside_a_block_an_interrupt_is_raised_at_once() -> None:
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)


def test_a_log_that_is_interrupted_in_the_middle_of_a_message_is_readable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Test: interrupt between two records of one message. Expected result: the log holds that message and all before it."""
    path = tmp_path / "log.mcap"
    add = Writer.add_message

    def interrupted(writer: Writer, channel: int, time_ns: int, data: bytes, published_ns: int, count: int) -> None:
        if count == 3:
            os.kill(os.getpid(), signal.SIGINT)
        add(writer, channel, time_ns, data, published_ns, count)

    monkeypatch.setattr(Writer, "add_message", interrupted)
    commands = [TrackCommand(t_s=tick * 0.25, left_m_s=0.1, right_m_s=0.1) for tick in range(5)]
    with pytest.raises(KeyboardInterrupt), RunLog(path) as log:
        deque(map(log, commands))
    assert [message.t_s for message in read_log(path)] == [0.0, 0.25, 0.5, 0.75]
