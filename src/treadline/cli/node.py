"""``treadline node``: one node of the graph in a process of its own."""

import os
import signal
import time
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Literal

from treadline.cli.answer import Answer
from treadline.cli.numbers import check_times
from treadline.cli.out import Force, claim, make_way

if TYPE_CHECKING:
    from treadline.mission.mission_config import MissionConfig
    from treadline.ros.wire import WireTransport

STARTED_BY = "TREADLINE_STARTED_BY"
"""Environment variable with the id of the process that a node must not outlive."""
RECORDER_SPARE = 100
"""Queue length of a recorder [messages]: it keeps every image, however late."""
WireName = Literal["ros1", "zenoh"]
TransportName = Literal["inproc", WireName]
PlantName = Literal["mujoco", "gazebo"]


def node(
    name: str,
    scenario: str = "default",
    /,
    *remappings: str,
    transport: TransportName = "zenoh",
    controller: str | None = None,
    plant: PlantName = "mujoco",
    seed: int = 0,
    clock: Literal["sim", "wall"] = "sim",
    pace: float = 1.0,
    duration: float | None = None,
    endpoint: str = "tcp/127.0.0.1:7447",
    domain: int = 0,
    patience: float = 60.0,
    stick: bool = False,
    out: Path | None = None,
    force: Force = False,
) -> Answer:
    """Run one node: plant, camera, heading, seat, driver, guard or recorder.

    treadline node guard default --transport ros1

    Args:
        name: Name of the node.
        scenario: Settings that the whole graph shares: scenario file, or the name of a shipped scenario.
        remappings: Remappings of ROS 1, as /camera/color/image_raw:=/camera, after a lone --.
        transport: ros1 needs a roscore; zenoh speaks ROS 2's wire and needs no ROS; inproc is for treadline nodes alone.
        controller: Controller file that treadline tune wrote, or a plug-in. Default: the controller shipped for the vehicle.
        plant: Simulator of the plant node: mujoco or gazebo.
        seed: Random seed of the simulated plant.
        clock: sim where a plant publishes /clock, wall where drivers stamp with the machine's clock.
        pace: Simulated seconds per second, of the plant.
        duration: Duration of the plant in seconds. Default: as in the scenario.
        endpoint: Address at which the nodes of zenoh connect; the guard listens there.
        domain: ROS_DOMAIN_ID of ROS 2.
        patience: Startup timeout for required topics, in seconds.
        stick: Let the guard take /cmd_vel (geometry_msgs/Twist) instead of the driver's commands.
        out: Run folder, or .mcap, .bag or .db3 file, that the recorder writes.
    """
    from treadline.core.errors import SettingsError
    from treadline.ros.assembly import node_of
    from treadline.ros.node_process import NodeRunner, run_plant
    from treadline.ros.plant_node import PlantNode
    from treadline.ros.recorder import RecorderNode
    from treadline.run.resolve import resolve

    if transport == "inproc":
        raise SettingsError("--transport inproc: one node alone hears nobody; treadline nodes runs all in one process")
    check_times(pace=pace, duration=duration, patience=patience)
    if out is not None:
        claim(out, force=force, kind="either")
        make_way(out, force=force)
    setup = resolve(scenario, controller, seed, open_plant=plant)
    setup.require_controller()
    config = setup.mission
    stop = stopping()
    wire = wired(transport, name, config, endpoint=endpoint, domain=domain, arguments=remappings)
    wire.spare = RECORDER_SPARE if name == "recorder" else 1
    try:
        made = node_of(name, config, plant=setup.open_plant, out=out, stick=stick)
        if isinstance(made, PlantNode):
            try:
                t_s = run_plant(made, wire, stop=stop, pace=pace, duration_s=duration or setup.scenario.drive.duration_s)
            finally:
                made.close()
            return Answer(values={"node": name, "t_s": t_s}, summary=[f"plant: {t_s:.1f} s simulated"])
        try:
            NodeRunner(made, wire, clock=clock, patience_s=patience).run(stop)
        finally:
            if isinstance(made, RecorderNode):
                made.close()
    finally:
        wire.close()
    lost = dict(wire.inbox.lost)
    left_out = made.left_out if isinstance(made, RecorderNode) else None
    summary = [f"{name}: done" + (f", lost {lost}" if lost else ""), *([] if left_out is None else [left_out])]
    return Answer(values={"node": name, "lost": lost}, summary=summary)


def wired(
    transport: WireName, name: str, config: "MissionConfig", *, endpoint: str, domain: int, arguments: tuple[str, ...] = ()
) -> "WireTransport":
    """Return the transport of one node."""
    from treadline.ros.assembly import mount_of

    if transport == "ros1":
        from treadline.ros.ros1 import Ros1Transport

        return Ros1Transport(name, arguments=arguments, mount=mount_of(config))
    from treadline.ros.zenoh import ZenohTransport

    return ZenohTransport(name, endpoint=endpoint, listen=name == "guard", domain=domain, mount=mount_of(config))


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
