"""A node that falls silent: the guard holds within 0.8 s, whichever it is; without a guard the plant brakes by itself."""

import math
from types import SimpleNamespace

import pytest
from node_messages import SIGNALS
from world import health, limits

from treadline.core.ports import Truth
from treadline.core.signals import HeadingHealth, OperatorInput, TrackCommand, VelocityCommand
from treadline.mission.mission_blocks import build_blocks, guard_config
from treadline.mission.replay_plant import ReplayPlant
from treadline.plant.mujoco import open_plant
from treadline.ros import channels as on
from treadline.ros.block_nodes import GuardNode, HeadingNode
from treadline.ros.lockstep import InProcess, LockStep
from treadline.ros.plant_node import PlantNode
from treadline.run.resolve import mission_config
from treadline.scenario.scenario import Scenario
from treadline.scenario.shipped_files import shipped_controller

# Literals, so that a changed value in the code is detected here.
LOST_S = 1.0

KILLED_S, WITHIN_S = 1.0, 0.8


def turning() -> tuple[LockStep, object]:
    values = {"start": {"place": "flight", "step": 4}, "stair": {"steps": 12}, "sensors": {"camera": "statistical"}}
    scenario = Scenario.model_validate(values)
    config = mission_config(scenario, shipped_controller(scenario.chair.model))
    blocks = build_blocks(config)
    plant = open_plant(scenario, 0)
    return LockStep(plant, blocks, guard_config(config, blocks.driver.period_s)), plant


def run_until(graph: LockStep, t_s: float) -> None:
    while graph.tick() < t_s:
        pass


def kill(graph: LockStep, name: str) -> None:
    node = next(node for node in graph.nodes if node.name == name)
    graph.nodes.remove(node)
    node._publish = lambda *_: None  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ["camera", "heading", "seat", "driver"])
def test_the_guard_holds_for_a_node_that_is_gone(name: str) -> None:
    graph, _ = turning()
    states: list[on.GuardState] = []
    graph.transport.subscribe(on.GUARD, states.append)
    run_until(graph, KILLED_S)
    assert all(state.holding is None for state in states)
    kill(graph, name)
    run_until(graph, KILLED_S + WITHIN_S)
    assert states[-1].holding is not None
    assert states[-1].t_s - KILLED_S <= WITHIN_S


@pytest.mark.parametrize("is_second", [True, False], ids=["a second one", "one in the place of the first"])
def test_a_second_driver_is_held_and_named_within_a_second(*, is_second: bool) -> None:
    graph, other = turning()[0], turning()[0]
    states: list[on.GuardState] = []
    graph.transport.subscribe(on.GUARD, states.append)
    run_until(graph, KILLED_S)
    if not is_second:
        kill(graph, "driver")
    driver = next(node for node in other.nodes if node.name == "driver")
    driver.listen(graph.transport.end(driver.name))
    graph.nodes.insert(0, driver)
    graph.transport.publish(on.DIAGNOSTICS, on.Beat(t_s=KILLED_S, node="viewer"))  # nobody awaits the next
    run_until(graph, KILLED_S + LOST_S)
    held = ["two sources of /plan, driver and driver 2; stop one of them"] if is_second else []
    assert [state.holding for state in states] == held


FIRST = dict(reversed(SIGNALS))


@pytest.mark.parametrize("channel", sorted(FIRST.keys() - {on.DIAGNOSTICS, on.CLOCK, on.ODOM}))
def test_two_publishers_of_what_a_node_hears_are_held_and_named_within_a_second(channel: str) -> None:
    """Test: two nodes publish, 2 s apart, then within 0.9 s; the camera's node alone hears images. Expected result: a hold then."""
    now, held = [0.0], list[str | None]()
    bus = InProcess(lambda: now[0])
    for node in (GuardNode(limits()), PlantNode(ReplayPlant([]), limits())):
        node.listen(bus.end(node.name))
    for heard in (on.CAMERA, on.CAMERA_QUALITY):
        bus.end("camera").subscribe(heard, lambda _: None)
    bus.subscribe(on.GUARD, lambda state: held.append(state.holding))
    left, right = bus.end("left"), bus.end("right")
    found = f"two sources of {channel}, left and right; stop one of them"
    for now[0], end in ((0.0, left), (2.0, right), (4.0, left), (4.1, right), (4.9, left)):
        assert found not in held
        end.publish(channel, FIRST[channel])
    assert found in held


def test_a_velocity_drives_through_the_guard_and_no_faster_than_it_allows() -> None:
    """Test: velocities with and without a stamp, too fast, two in a tick, and not finite. Expected: belts by the gauge of 0.65 m,
    the newer of the two; a hold."""
    transport = InProcess()
    guard = GuardNode(limits(needs_heading=False, watches_motion=False))
    guard.listen(transport)
    commands: list[TrackCommand] = []
    transport.subscribe(on.TRACKS_CMD, commands.append)
    transport.publish(on.DIAGNOSTICS, on.Beat(t_s=0.0, node="recorder"))  # its end holds nothing
    for k in range(100):
        t_s = 0.01 * k if k % 2 else math.nan
        transport.publish(on.TWIST, VelocityCommand(t_s=t_s, speed_m_s=0.2, turn_rad_s=0.1))
        guard.tick(0.01 * k)
    assert (commands[-1].left_m_s, commands[-1].right_m_s) == pytest.approx((0.1675, 0.2325))
    transport.publish(on.TWIST, VelocityCommand(t_s=1.0, speed_m_s=5.0, turn_rad_s=0.0))
    guard.tick(1.0)
    assert commands[-1].left_m_s == pytest.approx(0.55)
    for t_s, stamp_s in ((1.01, 1.01), (1.02, math.nan)):  # a stop right after a speed
        for speed_m_s in (0.2, 0.0):
            transport.publish(on.TWIST, VelocityCommand(t_s=stamp_s, speed_m_s=speed_m_s, turn_rad_s=0.0))
        guard.tick(t_s)
        assert commands[-1].left_m_s == 0.0
    transport.publish(on.TWIST, VelocityCommand(t_s=1.03, speed_m_s=math.nan, turn_rad_s=0.0))
    guard.tick(1.03)
    assert commands[-1].brake


def test_health_is_repeated_three_times_in_the_time_for_which_the_guard_awaits_it() -> None:
    transport, published = InProcess(), list[HeadingHealth]()
    node = HeadingNode(SimpleNamespace(health=health(0.0, "disagreement", 0.0)), limits())  # type: ignore[arg-type]
    node.listen(transport)
    transport.subscribe(on.HEALTH, published.append)
    for tick in range(250):
        node.tick(0.01 * tick)
    assert 2.5 / 0.1 - 2 <= len(published) <= 2.5 / 0.1 + 1


def speak(graph: LockStep, **said: bool) -> None:
    graph.transport.publish(on.OPERATOR, OperatorInput(t_s=graph.tick(), **said))


def test_a_guard_that_is_started_anew_lets_nothing_go_that_a_person_has_stopped() -> None:
    """Test: a person stops the chair; the guard dies, and another takes its place. Expected result: the brake stays on until the
    button to re-arm is pressed, and a button that is stuck is not; then the chair drives on."""
    graph, _ = turning()
    run_until(graph, KILLED_S)
    speak(graph, stop=True)
    place = next(index for index, node in enumerate(graph.nodes) if node.name == "guard")
    kill(graph, "guard")
    run_until(graph, KILLED_S + LOST_S + 0.2)
    anew = GuardNode(limits())
    anew.listen(graph.transport)
    graph.nodes.insert(place, anew)
    truths: list[Truth] = []
    graph.transport.subscribe(on.TRUTH, truths.append)
    states: list[on.GuardState] = []
    graph.transport.subscribe(on.GUARD, states.append)
    began_s = graph.tick()
    run_until(graph, began_s + 2.0)
    assert {truth.left_m_s for truth in truths} == {0.0}
    assert states[-1].holding == "the plant braked by itself: no command for 0.31 s"
    speak(graph, rearm=True)
    while graph.tick() < began_s + 8.0:  # its flipper is laid first
        speak(graph)
    assert max(truth.left_m_s for truth in truths) > 0.05
