"""``treadline record``: messages of nodes into a bag, or a log from one bag format into another; neither needs ROS."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from treadline.cli.answer import Answer
from treadline.cli.node import RECORDER_SPARE, WireName, stopping, wired
from treadline.cli.numbers import check_times
from treadline.cli.out import Force, claim, make_way

if TYPE_CHECKING:
    from treadline.ros.wire import WireTransport


def record(
    log: Path | None = None,
    /,
    *,
    out: Path,
    transport: WireName = "zenoh",
    duration: float | None = None,
    scenario: str = "default",
    images: Annotated[bool, Parameter(negative="--no-images")] = True,
    endpoint: str = "tcp/127.0.0.1:7447",
    domain: int = 0,
    force: Force = False,
) -> Answer:
    """Record the messages of the node graph, or convert a log into another bag format.

    treadline record --transport ros1 --duration 60 --out drive.bag
    treadline record runs/first --out first.bag

    Args:
        log: Run folder or bag to convert. Default: record live messages until Ctrl-C.
        out: Run folder (record.csv and log.mcap), or a file: .mcap, .bag (ROS 1) or .db3 (ROS 2).
        transport: Transport of the nodes; nodes in one process are recorded by treadline nodes --out.
        duration: Duration of the recording in seconds. Default: until Ctrl-C.
        scenario: Settings that the graph shares; they hold the camera's mount.
        images: Keep images.
        endpoint: Address at which the nodes of zenoh connect.
        domain: ROS_DOMAIN_ID of ROS 2.
    """
    check_times(duration=duration)
    claim(out, force=force, kind="either")
    if log is not None:
        return _copied(log, out, force=force)
    from treadline.run.resolve import resolve

    make_way(out, force=force)
    config = resolve(scenario).mission
    wire = wired(transport, "recorder", config, endpoint=endpoint, domain=domain)
    wire.spare = RECORDER_SPARE
    try:
        count, left_out = _listened(wire, out, duration, images=images)
    finally:
        wire.close()
    lost = dict(wire.inbox.lost)
    lines = [f"{out}: {count} signals" + (f"; lost {lost}" if lost else ""), *([] if left_out is None else [left_out])]
    return Answer(values={"out": str(out), "signals": count, "lost": lost}, summary=lines, code=0 if count else 1)


def _listened(wire: "WireTransport", out: Path, duration_s: float | None, *, images: bool) -> tuple[int, str | None]:
    from threading import Timer

    from treadline.core import paper
    from treadline.ros.node_process import NodeRunner
    from treadline.ros.recorder import RecorderNode

    node = RecorderNode(out, 1.0 / paper.CONTROL_RATE_HZ, frames=images)
    stop = stopping()
    timer = Timer(duration_s, stop.set) if duration_s is not None else None
    try:
        runner = NodeRunner(node, wire, patience_s=float("inf"))
        if timer is not None:
            timer.start()
        runner.run(stop)
    finally:
        if timer is not None:
            timer.cancel()
        node.close()
    return node.count, node.left_out


def _copied(log: Path, out: Path, *, force: bool) -> Answer:
    """Convert a log, signal by signal in order of time."""
    from treadline.core.errors import SettingsError
    from treadline.io.sensor_log import SensorLog
    from treadline.ros.bag_writer import open_bag

    source = log / "log.mcap" if (log / "log.mcap").is_file() else log
    recording = SensorLog(source)
    if out.resolve() == source.resolve():
        raise SettingsError(f"--out {out}: is the log itself; give another")
    make_way(out, force=force)
    bag = open_bag(out)
    aside: list[Any] = []
    count = 0
    try:
        for taken_s, signal in recording.arrivals(aside.append):
            for kept in aside:
                bag(kept)
            bag(signal, taken_s)
            count += 1 + len(aside)
            aside.clear()
        for kept in aside:
            bag(kept)
    finally:
        bag.close()
    count += len(aside)
    dropped = dict(recording.dropped)
    lines = [f"{out}: {count} signals from {source}", *(f"  dropped {number}: {reason}" for reason, number in dropped.items())]
    return Answer(values={"out": str(out), "signals": count, "dropped": dropped}, summary=lines)
