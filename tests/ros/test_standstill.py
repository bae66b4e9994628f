"""Guard and plant as two processes on a wire, one of which is stopped: the wall's clock is the test's."""

import re
from types import SimpleNamespace
from typing import Any

import pytest
from wires import Air
from world import limits

from treadline.core.signals import PlantState, TrackCommand, VelocityCommand
from treadline.mission.replay_plant import ReplayPlant
from treadline.ros import channels as on
from treadline.ros.block_nodes import GuardNode
from treadline.ros.node_process import POLL_S, NodeRunner, PlantRunner
from treadline.ros.plant_node import PlantNode

LIMITS = limits(needs_heading=False, watches_motion=False)


class Noting(ReplayPlant):
    """Plant without readings that keeps the newest command."""

    def write(self, tracks: TrackCommand, *_: object) -> None:
        self.newest = tracks


class Graph:
    """Two processes, and a third that asks for 0.2 m/s and hears what both say."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s, self.t_s, nodes = 50.0, 0.0, list[Air]()
        clock = SimpleNamespace(monotonic=lambda: self.now_s, time=lambda: self.now_s)
        for module in ("ros.node_process", "core.loop_watchdog"):
            monkeypatch.setattr(f"treadline.{module}.time", clock)
        self.plant, self.beside = Noting([]), Air(nodes=nodes)
        self.heard: dict[str, list[Any]] = {channel: [] for channel in (on.TRACKS_CMD, on.PLANT, on.GUARD)}
        for channel, heard in self.heard.items():
            self.beside.subscribe(channel, heard.append)
        self.beside.subscribe(on.CLOCK, lambda clock: setattr(self, "t_s", clock.t_s))
        self.wires = {name: Air(nodes=nodes) for name in ("guard", "plant")}
        self.runners = {
            "guard": NodeRunner(GuardNode(LIMITS, awaited=("plant",), sender="guard-1"), self.wires["guard"]),
            "plant": PlantRunner(PlantNode(self.plant, LIMITS), self.wires["plant"]),
        }
        for runner in self.runners.values():
            runner.__enter__()

    def run(self, seconds: float, *, stopped: str = "") -> None:
        until_s = self.now_s + seconds
        while self.now_s < until_s:
            for name, runner in self.runners.items():
                if name != stopped:
                    while self.wires[name].deliver(0.0):
                        pass
                    runner.turn()
            while self.beside.deliver(0.0):
                pass
            self.beside.publish(on.TWIST, VelocityCommand(t_s=self.t_s, speed_m_s=0.2, turn_rad_s=0.0))
            self.now_s += POLL_S


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Graph:
    made = Graph(monkeypatch)
    made.run(1.0)
    assert made.plant.newest.left_m_s == pytest.approx(0.2)
    assert not any(command.brake for command in made.heard[on.TRACKS_CMD] if command.t_s > 0.5)
    return made


def test_a_guard_that_is_stopped_holds_when_it_returns_and_the_plant_brakes_meanwhile(graph: Graph) -> None:
    """Test: the guard's process does not run for 2 s. Expected result: the plant, which waits for it, brakes within 0.33 s of the
    wall's clock and 0.31 s of its own, and says so; the guard's first command after the return is HOLD, with its cause."""
    stopped_s, sent = graph.t_s, len(graph.heard[on.TRACKS_CMD])
    graph.run(0.33, stopped="guard")
    assert graph.plant.newest.brake
    graph.run(1.67, stopped="guard")
    fault: PlantState = next(state for state in graph.heard[on.PLANT] if state.fault)
    assert fault.t_s - stopped_s <= 0.31
    assert str(fault.fault).startswith("no command for 0.3")
    assert graph.plant.newest.brake
    assert len(graph.heard[on.TRACKS_CMD]) == sent
    graph.run(1.0)
    later = graph.heard[on.TRACKS_CMD][sent:]
    assert later
    assert all(command.brake for command in later)
    held: on.GuardState = graph.heard[on.GUARD][-1]
    assert re.fullmatch(r"the loop stood still for 2\.\d s in .*", str(held.holding))


def test_a_plant_that_is_stopped_is_held_and_says_so_when_it_returns(graph: Graph) -> None:
    """Test: the plant's process does not run for 2 s. Expected result: the guard holds 0.6 s after the last clock and does not let
    go; the plant brakes, with its own standstill as the cause."""
    stopped_s = graph.now_s
    while not graph.heard[on.GUARD][-1].holding and graph.now_s < stopped_s + 2.0:
        graph.run(POLL_S, stopped="plant")
    assert graph.now_s - stopped_s <= 0.65
    graph.run(stopped_s + 2.0 - graph.now_s, stopped="plant")
    sent = len(graph.heard[on.TRACKS_CMD])
    graph.run(1.0)
    assert len(graph.heard[on.TRACKS_CMD]) > sent
    assert all(command.brake for command in graph.heard[on.TRACKS_CMD][sent:])
    assert graph.plant.newest.brake
    assert graph.heard[on.GUARD][-1].holding == "no /clock for 0.6 s: the simulated plant stands still"
    assert re.match(r"the loop stood still for 2\.\d s in ", graph.heard[on.PLANT][-1].fault)
