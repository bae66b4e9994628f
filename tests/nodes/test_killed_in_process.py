"""A node that falls silent: the guard holds within 0.8 s, whichever it is; without a guard the plant brakes by itself."""

import pytest

from treadline.experiments.shipped import shipped_controller
from treadline.experiments.traverse import mission_config
from treadline.mission.config import build_blocks, guard_config
from treadline.mission.guard import GuardConfig
from treadline.nodes import channels as on
from treadline.nodes.inproc import InProcess
from treadline.nodes.lockstep import LockStep
from treadline.nodes.shells import GuardNode
from treadline.nodes.words import Drive, GuardState
from treadline.scenario import Scenario
from treadline.signals import TrackCommand
from treadline.sim import open_plant

KILLED_S, WITHIN_S = 1.0, 0.8


def turning() -> tuple[LockStep, object]:
    values = {"start": {"place": "flight", "step": 4}, "stair": {"steps": 12}, "sensors": {"camera": "statistical"}}
    scenario = Scenario.model_validate(values)
    config = mission_config(scenario, shipped_controller(scenario.chair.model))
    blocks = build_blocks(config)
    plant = open_plant(scenario, 0)
    return LockStep(plant, blocks, guard_config(config, blocks.driver.period_s)), plant


def kill(graph: LockStep, name: str) -> None:
    node = next(node for node in graph.nodes if node.name == name)
    graph.nodes.remove(node)
    node._say = lambda *_: None  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ["camera", "heading", "seat", "driver"])
def test_the_guard_holds_for_a_node_that_is_gone(name: str) -> None:
    graph, _ = turning()
    states: list[GuardState] = []
    graph.transport.subscribe(on.GUARD, states.append)
    while graph.tick() < KILLED_S:
        pass
    assert all(state.holding is None for state in states)
    kill(graph, name)
    while graph.tick() < KILLED_S + WITHIN_S:
        pass
    assert states[-1].holding is not None
    assert states[-1].t_s - KILLED_S <= WITHIN_S


def test_without_a_guard_the_plant_brakes_by_itself() -> None:
    graph, plant = turning()
    while graph.tick() < KILLED_S:
        pass
    kill(graph, "guard")
    plant.truth()
    while graph.tick() < KILLED_S + WITHIN_S:
        pass
    truths: list[object] = []
    graph.transport.subscribe(on.TRUTH, truths.append)
    while graph.tick() < KILLED_S + WITHIN_S + 0.2:
        pass
    assert [truth.left_m_s for truth in truths] == [0.0] * len(truths)
    assert truths


def test_a_stick_drives_through_the_guard_and_no_faster_than_it_allows() -> None:
    transport = InProcess()
    guard = GuardNode(GuardConfig(needs_heading=False, watches_motion=False), gauge_m=0.5)
    guard.listen(transport)
    commands: list[TrackCommand] = []
    transport.subscribe(on.TRACKS_CMD, commands.append)
    for k in range(10):
        transport.publish(on.TWIST, Drive(speed_m_s=0.2, turn_rad_s=0.1))
        guard.tick(0.01 * k)
    assert (commands[-1].left_m_s, commands[-1].right_m_s) == pytest.approx((0.175, 0.225))
    transport.publish(on.TWIST, Drive(speed_m_s=5.0, turn_rad_s=0.0))
    guard.tick(0.1)
    assert commands[-1].left_m_s <= 1.0
    transport.publish(on.TWIST, Drive(speed_m_s=float("nan"), turn_rad_s=0.0))
    guard.tick(0.11)
    assert commands[-1].brake
