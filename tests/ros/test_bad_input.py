"""What a node cannot work with is reported in one line, with what to do."""

import itertools
import json
import re
import sys
from pathlib import Path
from threading import Event as Flag
from threading import Timer
from types import SimpleNamespace
from typing import Any

import pytest
from wires import Air
from world import limits

from treadline.cli import doctor, main
from treadline.core.errors import SettingsError, TreadlineError
from treadline.core.signals import PlantState, SeatReading, VelocityCommand
from treadline.mission.mission_blocks import build_blocks, guard_config
from treadline.mission.mission_config import MissionConfig
from treadline.mission.replay_plant import ReplayPlant
from treadline.ros import channels as on
from treadline.ros import node_process as process
from treadline.ros import ros1
from treadline.ros.assembly import node_of
from treadline.ros.block_nodes import GuardNode, SeatNode
from treadline.ros.lockstep import InProcess
from treadline.ros.node_process import NodeRunner, PlantRunner
from treadline.ros.plant_node import PlantNode
from treadline.scenario.chair import read_chair

SEAT_STATE = "treadline_msgs/msg/SeatState"


def seat() -> SeatNode:
    config = MissionConfig(chair=read_chair("wheelchair"), loop="open")
    blocks = build_blocks(config)
    return SeatNode(blocks.leveller, guard_config(config, blocks.driver.period_s))


def test_without_ros_1_or_gazebo_a_line_and_the_doctor_say_what_to_install(
    capsys: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    find = doctor.util.find_spec
    monkeypatch.setattr(doctor.util, "find_spec", lambda name: None if name == "rospy" else find(name))
    monkeypatch.setattr(ros1, "DEBIAN", tmp_path / "none")
    monkeypatch.setenv("TREADLINE_GAZEBO", str(tmp_path))
    monkeypatch.setitem(sys.modules, "rospy", None)
    assert main(["node", "guard"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("treadline: --transport ros1 needs rospy, which is not installed: apt-get install ros-core")
    assert main(["doctor", "--json"]) == 0  # the rest does without
    parts = {part["name"]: part for part in json.loads(capsys.readouterr().out)["parts"]}
    assert parts["rospy"]["remedy"].startswith("apt-get install ros-core")
    assert parts["Gazebo"]["remedy"].startswith("no Gazebo 11 in ")


def test_an_unknown_node() -> None:
    with pytest.raises(
        SettingsError, match="no node is called 'gard'; there are: guard, camera, heading, seat, driver, plant, rec"
    ):
        node_of("gard", MissionConfig(chair=read_chair("wheelchair"), loop="open"))


@pytest.mark.parametrize(
    ("kinds", "said"),
    [
        ({}, "seat: nothing on /seat/state after 0 s: nobody publishes /seat/state$"),
        ({"/seat/state": "sensor_msgs/msg/Imu"}, ".*published as sensor_msgs/msg/Imu; treadline_msgs/msg/SeatState is read$"),
        (
            {"/seat/state": SEAT_STATE},
            "seat: no /clock after 0 s: start a simulated plant .* or give --clock wall",
        ),
    ],
    ids=["nobody publishes", "another type", "no clock"],
)
def test_a_topic_that_does_not_come(kinds: dict[str, str], said: str) -> None:
    runner = NodeRunner(seat(), Air(kinds), patience_s=0.1)
    with pytest.raises(TreadlineError, match=f"^{said}"):
        runner.run(Flag())


@pytest.mark.parametrize(
    ("stamp_s", "said"),
    [
        (1.7e9, r"stamped 1700000000.000 s where the clock shows 1.000 s: stamps of another clock; --clock wall is for drivers"),
        (2.0, r"stamped 2.000 s where the clock shows 1.000 s: clocks that differ; set those of all machines by one server"),
    ],
    ids=["another clock", "1 s ahead"],
)
def test_clocks_that_differ_at_the_start(capsys: Any, monkeypatch: pytest.MonkeyPatch, stamp_s: float, said: str) -> None:
    """Test: a sensor stamps by another clock for 2 s. Expected result: the node goes on and moves nothing; one line says why, its
    heartbeat keeps the guard waiting, and the node ends with the line where its patience ends."""
    wall = itertools.count(50.0, 0.005)
    monkeypatch.setattr(process, "time", SimpleNamespace(monotonic=lambda: next(wall), time=lambda: 1.0))
    air = Air({"/seat/state": SEAT_STATE})
    runner = NodeRunner(seat(), air, patience_s=0.1)
    air.say(on.CLOCK, on.Clock(t_s=1.0))
    for _ in range(200):
        air.say(on.SEAT, SeatReading(t_s=stamp_s, pitch_rad=0.0, stroke_m=0.2))
        air.deliver(0.0)
        runner.beat(next(wall))
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert re.match(f"treadline: seat: /seat/state: {said}", lines[0])
    assert not [signal for channel, signal in air.sent if channel == on.SEAT_PROPOSED]
    beat = next(signal for channel, signal in reversed(air.sent) if channel == on.DIAGNOSTICS)
    guard = GuardNode(limits(), awaited=("seat",))
    bus = InProcess()
    guard.listen(bus)
    bus.publish(on.DIAGNOSTICS, beat)
    assert guard.waits_for.startswith(f"waits for seat (/seat/state: stamped {stamp_s:.3f} s")
    with pytest.raises(TreadlineError, match=rf"^seat: nothing on /seat/state after 0 s: /seat/state: {said}"):
        runner.run(Flag())


def test_two_guards_on_one_bus_hold_and_name_each_other() -> None:
    """Test: a second guard appears while the first drives. Expected result: both hold, the plant brakes whatever either commands,
    and each line names both and says what to do."""
    bus, plant = InProcess(), PlantNode(ReplayPlant([]), limits())
    guards = [GuardNode(limits(needs_heading=False, watches_motion=False), sender=f"guard-{k}") for k in (1, 2)]
    states: list[PlantState] = []
    held: list[on.GuardState] = []
    bus.subscribe(on.PLANT, states.append)
    bus.subscribe(on.GUARD, held.append)
    plant.listen(bus)
    for tick in range(40):
        if tick in (0, 21):
            guards[tick > 20].listen(bus.end(f"guard-{1 + (tick > 20)}"))
        for guard in guards[: 1 + (tick > 20)]:
            guard.advance(0.01 * tick)
        plant.tick(0.01 * tick)
        bus.publish(on.TWIST, VelocityCommand(t_s=0.01 * tick, speed_m_s=0.2, turn_rad_s=0.0))
        for guard in guards[: 1 + (tick > 20)]:
            guard.tick(0.01 * tick)
            guard.repeat_state()
    assert states[-1].fault == "two guards send commands, guard-1 and guard-2; stop one of them"
    causes = {state.sender: str(state.holding) for state in held}
    assert causes.keys() == {"guard-1", "guard-2"}
    for cause in causes.values():
        assert re.fullmatch("two sources of /(guard/state|seat/cmd), guard-1 and guard-2; stop one of them", cause)


def test_a_guard_without_a_plant_waits_and_says_for_what(capsys: Any) -> None:
    air = Air()
    guard = GuardNode(limits(), awaited=("plant",))
    runner, stop = NodeRunner(guard, air, clock="wall", patience_s=0.0), Flag()
    Timer(0.5, stop.set).start()
    runner.run(stop)
    assert capsys.readouterr().err.splitlines() == ["treadline: guard: waits for plant after 0 s; start the missing nodes"]
    assert all(command.brake for channel, command in air.sent if channel == on.TRACKS_CMD)


def test_a_guard_that_is_never_ready() -> None:
    node = PlantNode(ReplayPlant([]), limits())
    with pytest.raises(TreadlineError, match=r"^plant: the guard is not ready after 0 s: not heard; start the missing nodes$"):
        PlantRunner(node, Air(), patience_s=0.1).run(Flag())


def test_a_first_tick_that_compiles_is_no_standstill(monkeypatch: pytest.MonkeyPatch) -> None:
    air, wall = Air(), itertools.count(50.0, 0.005)

    plant = ReplayPlant([])
    plant.start = lambda: air.say(on.DIAGNOSTICS, on.Beat(t_s=0.0, node="guard"))  # type: ignore[method-assign]
    plant.advance = lambda _: next(itertools.islice(wall, 200, None))  # type: ignore[assignment, method-assign]
    for module in ("ros.node_process", "core.loop_watchdog"):
        monkeypatch.setattr(f"treadline.{module}.time", SimpleNamespace(monotonic=lambda: next(wall)))
    node = PlantNode(plant, limits())
    PlantRunner(node, air).run(Flag(), 0.01)
    assert node.last_guard.fault is None


def test_a_node_that_stays_behind_is_waited_for_and_then_given_up() -> None:
    node = PlantNode.__new__(PlantNode)
    node.commanded_s = 9.99
    peers = process._Peers(node)
    peers.receive(on.Beat(t_s=9.5, node="camera"))
    assert peers.keep_waiting(10.0, 0.1)
    assert not peers.keep_waiting(10.0, 0.6)
    assert not peers.keep_waiting(10.02, 0.0)
    peers.receive(on.Beat(t_s=10.0, node="camera"))
    assert not peers.keep_waiting(10.03, 0.0)
    assert peers.keep_waiting(10.5, 0.0)
