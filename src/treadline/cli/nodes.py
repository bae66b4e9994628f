"""``treadline nodes``: the complete node graph, in one process or each node in its own process."""

import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from treadline.cli._arguments import Force, PlantName, check_times, claim, make_way
from treadline.cli._output import Answer
from treadline.cli.compile import compile_once
from treadline.cli.node import STARTED_BY, TransportName, stopping, wired
from treadline.core.errors import SettingsError
from treadline.core.printing import say

GONE_S = 4.0
"""Time to keep the graph running after a node was lost [s], so that the guard can hold and the hold is recorded."""
LEAVE_S = 5.0
"""Time given to a node to end before it is killed [s]."""


def nodes(
    scenario: str = "default",
    /,
    *,
    transport: TransportName = "inproc",
    controller: str | None = None,
    plant: PlantName = "mujoco",
    seed: int = 0,
    pace: float = 1.0,
    duration: float | None = None,
    without: Literal["plant"] | None = None,
    out: Path | None = None,
    force: Force = False,
) -> Answer:
    """Run the complete node graph of Fig. 7 on a scenario, and report the outcome.

    treadline nodes default --out runs/graph

    Args:
        scenario: Scenario file, or the name of a shipped scenario.
        transport: inproc runs all nodes in this process, tick by tick; ros1 starts one process per node.
        controller: Controller file that treadline tune wrote, or a plug-in. Default: the controller shipped for the vehicle.
        plant: Simulator: mujoco or gazebo.
        seed: Random seed of the simulated plant.
        pace: Simulated seconds per second; slower on a busy machine.
        duration: Duration in simulated seconds. Default: as in the scenario.
        without: Leave out the plant node; the drivers of a real chair take its place.
        out: Run folder, or .mcap, .bag or .db3 file, to record to. Default: no recording.
    """
    from treadline.run.resolve import resolve
    from treadline.scenario.operator_actions import rearms_until_s

    check_times(pace=pace, duration=duration)
    if without is not None and transport == "inproc":
        raise SettingsError(f"--without {without} needs --transport ros1: in one process nobody else can be the {without}")
    if out is not None:
        claim(out, force=force, kind="either")
        make_way(out, force=force)
    setup = resolve(scenario, controller, seed, open_plant=plant)
    setup.require_controller()
    settings, config = setup.scenario, setup.mission
    seconds = duration or settings.drive.duration_s
    if transport == "inproc":
        return _in_one_process(config, setup.open_plant, seconds, out, rearms_until_s(settings.operator))
    compile_once()  # a node that compiles while the graph runs is silent for seconds, for which the guard holds
    wire = wired("supervisor", config)
    options = ["--transport", transport, "--plant", plant, "--seed", str(seed), "--pace", str(pace), "--duration", str(seconds)]
    options += [] if controller is None else ["--controller", controller]
    from treadline.ros.assembly import driving_nodes

    names = [name for name in driving_nodes(config.chair) if name != without] + (["recorder"] if out is not None else [])
    running: dict[str, subprocess.Popen[bytes]] = {}
    watch = _Watch(seconds, rearms_until_s(settings.operator))
    watch.listen(wire)
    stop = stopping()
    try:
        for name in names:
            extra = ["--out", str(out), "--force"] if name == "recorder" else []
            command = [sys.executable, "-m", "treadline", "node", name, scenario, *options, *extra]
            environment = os.environ | {STARTED_BY: str(os.getpid())}
            running[name] = subprocess.Popen(command, stdout=subprocess.DEVNULL, env=environment)  # noqa: S603 - our own command
        _say_where({name: f"pid {process.pid}" for name, process in running.items()}, transport)
        ended = _supervise(running, wire, watch, stop)
    finally:
        _end(running)
        wire.close()
    return watch.answer(ended, {name: process.pid for name, process in running.items()}, transport)


def _supervise(running: dict[str, subprocess.Popen[bytes]], wire: Any, watch: "_Watch", stop: Any) -> str | None:
    """Wait until the traversal is over; return the node that ended by itself, after the time in which the guard holds for it."""
    ended, until_s = None, math.inf
    while not stop.is_set() and not watch.over and time.monotonic() < until_s:
        wire.deliver(0.1)
        gone = next((name for name, process in running.items() if process.poll() is not None), None)
        if gone == "plant" and running[gone].returncode == 0:
            return None
        if gone is not None and ended is None:
            ended, until_s = gone, time.monotonic() + GONE_S
    return ended


def _end(running: dict[str, subprocess.Popen[bytes]]) -> None:
    for process in running.values():
        process.terminate()
    until_s = time.monotonic() + LEAVE_S
    for process in running.values():
        try:
            process.wait(max(until_s - time.monotonic(), 0.1))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


class _Watch:
    """Monitor of a traversal: guard state, plan, events, and the simulator's ground truth."""

    AFTER_S = 1.0
    """How long a held chair is watched."""

    def __init__(self, until_s: float, rearms_until_s: float) -> None:
        self._until_s = until_s
        self._rearms_until_s = rearms_until_s
        self.over = False
        self._phase = "search"
        self._holding: str | None = None
        self._held_s: float | None = None
        self._events: list[dict[str, Any]] = []
        self._headings: list[float] = []
        self._t_s = 0.0
        self._x_m = 0.0

    def listen(self, transport: Any) -> None:
        from treadline.ros import channels as on

        takers = ((on.PLAN, self._plan), (on.GUARD, self._guard), (on.DIAGNOSTICS, self._event), (on.TRUTH, self._truth))
        for channel, take in takers:
            transport.subscribe(channel, take)

    def answer(self, ended: str | None, where: dict[str, Any], transport: str) -> Answer:
        """Return the outcome."""
        from treadline.core.angles import DEG

        verdict = "time_up"
        if self._holding is not None:
            verdict = "held"
        elif ended is not None:
            verdict = "ended"
        elif self._phase in ("arrived", "refused"):
            verdict = self._phase
        count = len(self._headings)
        rms_deg = (sum(heading**2 for heading in self._headings) / count) ** 0.5 / DEG if count else None
        cause = self._holding or (f"node {ended} ended" if ended else None)
        final_deg = self._headings[-1] / DEG if count else None
        values = {
            "verdict": verdict,
            "cause": cause,
            "phase": self._phase,
            "duration_s": self._t_s,
            "rms_heading_deg": rms_deg,
            "final_heading_deg": final_deg,
            "x_m": self._x_m,
            "events": self._events,
            "transport": transport,
            "nodes": where,
        }
        heading = "" if rms_deg is None or final_deg is None else f"; heading {rms_deg:.2f}° RMS, {final_deg:.2f}° at the end"
        lines = [f"{verdict}" + (f": {cause}" if cause else "") + f" after {self._t_s:.1f} s in phase {self._phase}{heading}"]
        return Answer(values=values, summary=lines, code=0 if verdict in ("arrived", "time_up") else 1)

    def _plan(self, plan: Any) -> None:
        self._phase = plan.phase
        self._note(plan.t_s)
        self.over = self.over or plan.phase in ("arrived", "refused")

    def _guard(self, state: Any) -> None:
        if state.t_s >= self._until_s:
            return  # the plant has ended: that it is silent is as it should be
        self._holding = state.holding
        if state.holding is None:
            self._held_s = None
        elif self._held_s is None:
            self._held_s = state.t_s

    def _event(self, event: Any) -> None:
        from treadline.core.signals import Event

        if isinstance(event, Event) and event.t_s < self._until_s:
            self._events.append({"t_s": event.t_s, "name": event.name, "cause": event.cause})

    def _truth(self, truth: Any) -> None:
        if self._phase != "turn":  # from the heading of one flight to that of the next
            self._headings.append(truth.heading_rad)
        self._x_m = truth.x_m
        self._note(truth.t_s)

    def _note(self, t_s: float) -> None:
        self._t_s = max(self._t_s, t_s)
        held_s = 0.0 if self._held_s is None or self._t_s < self._rearms_until_s else self._t_s - self._held_s
        self.over = self.over or held_s > self.AFTER_S


def _in_one_process(config: Any, plant_of: Callable[[], Any], seconds: float, out: Path | None, rearms_until: float) -> Answer:
    from treadline.cli._output import SimulatedTime
    from treadline.mission.mission_blocks import build_blocks, guard_config
    from treadline.ros.assembly import driving_nodes
    from treadline.ros.lockstep import LockStep
    from treadline.ros.recorder import RecorderNode

    blocks = build_blocks(config)
    limits = guard_config(config, blocks.driver.period_s)
    plant = plant_of()
    recorder = None if out is None else RecorderNode(out, blocks.driver.period_s)
    graph = LockStep(plant, blocks, limits, beside=() if recorder is None else (recorder,), mount=config.camera)
    watch = _Watch(seconds, rearms_until)
    watch.listen(graph.transport)
    stop = stopping()
    t_s = 0.0
    try:
        with SimulatedTime("nodes") as progress:
            while t_s < seconds and not watch.over and not stop.is_set():
                t_s = graph.tick()
                progress.at(t_s, seconds)
    finally:
        plant.close()
        if recorder is not None:
            recorder.close()
    where = dict.fromkeys(driving_nodes(config.chair), "this process")
    _say_where(where, "inproc")
    return watch.answer(None, where, "inproc")


def _say_where(where: dict[str, str], transport: str) -> None:
    """Write the table of the nodes and their processes."""
    from treadline.ros.assembly import ROLES

    for name, place in where.items():
        say(f"treadline: {name:9} {place:13} {transport:7} {ROLES[name]}")
