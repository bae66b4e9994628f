"""``treadline node``: one node of the graph in a process of its own; ``treadline record``: the recorder, or a log converted."""

import os
import signal
import time
from contextlib import ExitStack, closing
from pathlib import Path
from threading import TIMEOUT_MAX, Event, Thread, Timer
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from treadline.cli._arguments import Force, PlantName, check_times, claim, make_way
from treadline.cli._output import Answer
from treadline.cli.compile import compile_once
from treadline.core.errors import SettingsError

if TYPE_CHECKING:
    from treadline.mission.mission_config import MissionConfig
    from treadline.ros.wire import WireTransport

STARTED_BY = "TREADLINE_STARTED_BY"
"""Environment variable with the id of the process that a node must not outlive."""
RECORDER_SPARE = 100
"""Queue length of a recorder [messages]: it keeps every image, however late."""
TransportName = Literal["inproc", "ros1"]


def node(
    name: str,
    scenario: str = "default",
    /,
    *remappings: str,
    transport: TransportName = "ros1",
    controller: str | None = None,
    plant: PlantName = "mujoco",
    seed: int = 0,
    clock: Literal["sim", "wall"] = "sim",
    pace: float = 1.0,
    duration: float | None = None,
    patience: float = 60.0,
    wait: bool = False,
    out: Path | None = None,
    force: Force = False,
) -> Answer:
    """Run one node on ROS 1: plant, camera, heading, seat, driver, guard or recorder.

    On ROS 2: ros2 launch treadline_ros2 graph.launch.xml

    treadline node guard default

    Args:
        name: Name of the node.
        scenario: Settings that the whole graph shares: scenario file, or the name of a shipped scenario.
        remappings: Remappings of ROS 1, as /camera/color/image_raw:=/camera, after a lone --.
        transport: ros1 needs a roscore; inproc is for treadline nodes alone.
        controller: Controller file that treadline tune wrote, or a plug-in. Default: the controller shipped for the vehicle.
        plant: Simulator of the plant node: mujoco or gazebo.
        seed: Random seed of the simulated plant.
        clock: sim where a plant publishes /clock, wall where drivers stamp with the machine's clock.
        pace: Simulated seconds per second, of the plant.
        duration: Duration of the plant in seconds. Default: as in the scenario.
        patience: Startup timeout for required topics, in seconds.
        wait: Let the driver stand, so that /cmd_vel moves the chair.
        out: Run folder, or .mcap, .bag or .db3 file, that the recorder writes.
    """
    from treadline.ros.assembly import driving_nodes, node_of, reject_unknown
    from treadline.ros.node_process import NodeRunner, PlantRunner
    from treadline.ros.plant_node import PlantNode
    from treadline.ros.recorder import RecorderNode
    from treadline.run.resolve import resolve

    if transport == "inproc":
        raise SettingsError("--transport inproc: one node alone hears nobody; treadline nodes runs all in one process")
    reject_unknown(name)
    check_times(pace=pace, duration=duration, patience=patience)
    if out is not None:
        claim(out, force=force, kind="either")
        make_way(out, force=force)
    setup = resolve(scenario, controller, seed, open_plant=plant)
    setup.require_controller()
    config = setup.mission
    if name in driving_nodes(config.chair):
        compile_once()  # a node that compiles while the graph runs is silent for seconds, for which the guard holds
    stop = stopping()
    with ExitStack() as opened:
        wire = opened.enter_context(closing(wired(name, config, remappings)))
        wire.spare = RECORDER_SPARE if name == "recorder" else 1
        made = node_of(name, config, plant=setup.open_plant, out=out, goals=wait)
        if isinstance(made, PlantNode | RecorderNode):
            opened.callback(made.close)
        if isinstance(made, PlantNode):
            t_s = PlantRunner(made, wire, pace=pace, patience_s=patience).run(stop, duration or setup.scenario.drive.duration_s)
            return Answer(values={"node": name, "t_s": t_s}, summary=[f"plant: {t_s:.1f} s simulated"])
        NodeRunner(made, wire, clock=clock, patience_s=patience).run(stop)
    lost, broken = dict(wire.inbox.lost), dict(wire.broken)
    summary = [f"{name}: done" + (f", lost {lost}" if lost else "") + (f", broken {broken}" if broken else "")]
    if isinstance(made, RecorderNode) and made.left_out is not None:
        summary.append(made.left_out)
    return Answer(values={"node": name, "lost": lost, "broken": broken}, summary=summary)


def record(
    log: Path | None = None,
    /,
    *,
    out: Path,
    transport: Literal["ros1"] = "ros1",  # noqa: ARG001 - the only one, which users name
    duration: float | None = None,
    scenario: str = "default",
    images: Annotated[bool, Parameter(negative="--no-images")] = True,
    force: Force = False,
) -> Answer:
    """Record the messages of the node graph on ROS 1, or convert a log into another bag format.

    On ROS 2: ros2 launch treadline_ros2 graph.launch.xml, and ros2 bag record

    treadline record --duration 60 --out drive.bag
    treadline record runs/first --out first.bag

    Args:
        log: Run folder or bag to convert. Default: record live messages until Ctrl-C.
        out: Run folder (record.csv and log.mcap), or a file: .mcap, .bag (ROS 1) or .db3 (ROS 2).
        transport: Transport of the nodes; nodes in one process are recorded by treadline nodes --out.
        duration: Duration of the recording in seconds. Default: until Ctrl-C.
        scenario: Settings that the graph shares; they hold the camera's mount.
        images: Keep images.
    """
    check_times(duration=duration)
    claim(out, force=force, kind="either")
    if log is not None:
        return _copied(log, out, force=force)
    from treadline.run.resolve import resolve

    make_way(out, force=force)
    config = resolve(scenario).mission
    with closing(wired("recorder", config)) as wire:
        wire.spare = RECORDER_SPARE
        count, left_out = _listened(wire, out, duration, images=images)
    lost = dict(wire.inbox.lost)
    lines = [f"{out}: {count} signals" + (f"; lost {lost}" if lost else ""), *([] if left_out is None else [left_out])]
    return Answer(values={"out": str(out), "signals": count, "lost": lost}, summary=lines, code=0 if count else 1)


def _listened(wire: "WireTransport", out: Path, duration_s: float | None, *, images: bool) -> tuple[int, str | None]:
    from treadline.core import paper
    from treadline.ros.node_process import NodeRunner
    from treadline.ros.recorder import RecorderNode

    with closing(RecorderNode(out, 1.0 / paper.CONTROL_RATE_HZ, frames=images)) as node:
        stop = stopping()
        timer = Timer(duration_s or TIMEOUT_MAX, stop.set)
        runner = NodeRunner(node, wire, patience_s=float("inf"))
        timer.start()
        try:
            runner.run(stop)
        finally:
            timer.cancel()
    return node.count, node.left_out


def _copied(log: Path, out: Path, *, force: bool) -> Answer:
    """Convert a log, signal by signal in order of time."""
    from treadline.io.sensor_log import SensorLog
    from treadline.ros.recorder import open_bag

    source = log / "log.mcap" if (log / "log.mcap").is_file() else log
    recording = SensorLog(source)
    if out.resolve() == source.resolve():
        raise SettingsError(f"--out {out}: is the log itself; give another")
    make_way(out, force=force)
    count = 0
    with closing(open_bag(out)) as bag:

        def write(signal: Any, taken_s: float | None = None) -> None:
            nonlocal count
            bag(signal, taken_s)
            count += 1

        for taken_s, signal in recording.arrivals(write):
            write(signal, taken_s)
    dropped = dict(recording.dropped)
    lines = [f"{out}: {count} signals from {source}", *(f"  dropped {number}: {reason}" for reason, number in dropped.items())]
    return Answer(values={"out": str(out), "signals": count, "dropped": dropped}, summary=lines)


def wired(name: str, config: "MissionConfig", arguments: tuple[str, ...] = ()) -> "WireTransport":
    """Return the transport of one node: ROS 1."""
    from treadline.ros.ros1 import Ros1Transport

    return Ros1Transport(name, arguments=arguments, mount=config.camera)


def stopping() -> Event:
    """Return a flag that Ctrl-C and a request to end set, and the loss of whoever started the graph: nodes end between messages."""
    stop = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    started_by = os.environ.get(STARTED_BY)
    if started_by is not None:
        Thread(target=_follow, args=(int(started_by), stop), daemon=True).start()
    return stop


def _follow(parent: int, stop: Event) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    stop.set()
