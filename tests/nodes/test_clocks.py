"""A node's clock where it is the wall's: it goes on, and steps back as the wall's does."""

import time
from types import SimpleNamespace
from typing import Any

import pytest

from treadline.nodes.process import Turning
from treadline.nodes.wire import WireTransport


class Silent(WireTransport):
    """A wire on which nobody speaks."""

    def _advertise(self, *_: Any) -> None:
        pass

    def _send(self, *_: Any) -> None:
        pass

    def _receive(self, *_: Any) -> None:
        pass


class Ticking:
    """A node that notes its ticks."""

    name = "heading"
    says: tuple[str, ...] = ()
    needs: tuple[tuple[str, ...], ...] = ()

    def __init__(self) -> None:
        self.ticks: list[float] = []

    def listen(self, transport: Any) -> None:
        pass

    def tick(self, t_s: float) -> None:
        self.ticks.append(t_s)


@pytest.mark.parametrize(("step_s", "ticks"), [(-5.0, 100), (-0.05, 95), (5.0, 100)])
def test_a_wall_clock_that_steps_mutes_no_node(monkeypatch: pytest.MonkeyPatch, step_s: float, ticks: int) -> None:
    """Test: a second of ticks after the wall's clock was set by 5 s, or by 50 ms. Expected result: ticks on the new time at once;
    50 ms are waited for."""
    wall = SimpleNamespace(now_s=1000.0)
    monkeypatch.setattr("treadline.nodes.process.time", SimpleNamespace(time=lambda: wall.now_s, monotonic=time.monotonic))
    node = Ticking()
    turning = Turning(node, Silent(), clock="wall")  # type: ignore[arg-type]
    for _ in range(100):
        wall.now_s += 0.01
        turning._turn()
    before = len(node.ticks)
    wall.now_s += step_s
    for _ in range(100):
        wall.now_s += 0.01
        turning._turn()
    assert len(node.ticks) - before == pytest.approx(ticks, abs=1)
    assert node.ticks[-1] == pytest.approx(wall.now_s, abs=0.011)
