"""A node's clock where it is the wall's: it goes on, and steps back as the wall's does."""

import time
from types import SimpleNamespace
from typing import Any

import pytest
from wires import Air

from treadline.core.signals import SeatReading
from treadline.ros import channels as on
from treadline.ros.node_process import NodeRunner


class Listening:
    """A node that notes its ticks, and for each reading its stamp and the node's clock then."""

    name = "heading"
    publishes: tuple[str, ...] = ()
    needs: tuple[tuple[str, ...], ...] = ()

    def __init__(self) -> None:
        self.now_s, self.ticks, self.taken_at = 0.0, list[float](), list[tuple[float, float]]()

    def listen(self, transport: Any) -> None:
        transport.subscribe(on.SEAT, lambda reading: self.taken_at.append((reading.t_s, self.now_s)))

    def advance(self, t_s: float) -> None:
        self.now_s = t_s

    def tick(self, t_s: float) -> None:
        self.now_s = t_s
        self.ticks.append(t_s)


@pytest.mark.parametrize(("step_s", "ticks"), [(-5.0, 100), (-0.05, 95), (5.0, 100)])
def test_a_wall_clock_that_steps_mutes_no_node(monkeypatch: pytest.MonkeyPatch, step_s: float, ticks: int) -> None:
    """Test: a second of ticks after the wall's clock was set by 5 s, or by 50 ms. Expected result: ticks on the new time at once;
    50 ms are waited for."""
    wall = SimpleNamespace(now_s=1000.0)
    monkeypatch.setattr("treadline.ros.node_process.time", SimpleNamespace(time=lambda: wall.now_s, monotonic=time.monotonic))
    node = Listening()
    runner = NodeRunner(node, Air(), clock="wall")
    for _ in range(100):
        wall.now_s += 0.01
        runner.turn()
    before = len(node.ticks)
    wall.now_s += step_s
    for _ in range(100):
        wall.now_s += 0.01
        runner.turn()
    assert len(node.ticks) - before == pytest.approx(ticks, abs=1)
    assert node.ticks[-1] == pytest.approx(wall.now_s, abs=0.011)


def test_a_node_that_was_kept_from_running_compares_stamps_with_the_newest_clock() -> None:
    """Test: a node stands for a second, and the messages of that second wait, the clock's last. Expected result: a sample 1 s newer
    than the last tick finds the node's clock at the newest time received, before that tick."""
    wire, node = Air(), Listening()
    NodeRunner(node, wire, clock="sim")
    wire.say(on.CLOCK, on.Clock(t_s=5.0))
    wire.deliver(0.0)
    assert node.ticks == [5.0]
    wire.say(on.SEAT, SeatReading(t_s=6.0, pitch_rad=0.0, stroke_m=0.0))
    wire.say(on.CLOCK, on.Clock(t_s=6.0))
    wire.deliver(0.0)
    assert node.taken_at == [(6.0, 6.0)]
    assert node.ticks == [5.0, 6.0]
