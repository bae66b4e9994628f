"""Feed of a viewer: the recording of a run, complete or growing, with frames, obstacles and contact forces that no log holds.

A live run and a recorded one are the same to scene and panels: a recording that may grow.
"""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from treadline.core.camera_images import PinholeCamera
from treadline.core.signals import TICK_S
from treadline.guard import SILENCE_S
from treadline.playback import NosingComparison, Recording, RecordingBuilder, staircase_of
from treadline.scenario.chair import ChairDescription
from treadline.scenario.faults import Conditions, Fault, payload_shift_m
from treadline.vehicle.staircase import Staircase
from treadline.view._messages import ContactForces, Obstacle, Order, Script, ShownFrame, Way, latest
from treadline.view._process import Worker

FASTEST = 0.0
"""Speed of a worker that means as fast as possible."""
PICTURES_MAX = 1500
"""Camera images kept: two and a half minutes at 10 Hz, 40 MB; older frames keep their text."""
CONTACTS_MAX = 30_000
"""Ticks whose contact forces are kept: five minutes, 30 MB with 40 contacts; older ones are forgotten."""


@dataclass(kw_only=True)
class Feed:
    """Run that is shown, and its workers: of the simulation, of the images of a log, and of the repetition for contact forces."""

    order: Order
    recording: Recording
    """Recording up to now."""
    builder: RecordingBuilder | None = None
    """Builder of the recording of a run in progress."""
    frames: list[ShownFrame] = field(default_factory=list)
    obstacles: list[Obstacle] = field(default_factory=list)
    contacts: list[ContactForces] = field(default_factory=list)
    """Contact forces of the ticks at which they were asked for."""
    way: Way | None = None
    """What ``check`` expected; None without a walk."""
    script: Script = field(default_factory=list)
    error: str | None = None
    workers: dict[str, Worker] = field(default_factory=dict)
    """Processes that extend the feed: ``run`` simulates, ``images`` runs the detector on the images of a log, and ``repeat``
    simulates the run again for the contact forces."""
    illustrated: int = 0
    """Number of frames that came from the images of a log."""

    @classmethod
    def live(cls, order: Order, chair: ChairDescription) -> "Feed":
        """Return the feed of a run to be simulated."""
        builder = RecordingBuilder(chair, order.scenario, seed=order.seed)
        return cls(order=order, builder=builder, recording=builder.build(), script=list(order.script))

    @classmethod
    def recorded(cls, recording: Recording, order: Order) -> "Feed":
        """Return the feed of a recorded run; each stair map stands for its frame until the images are seen again."""
        frames = [
            ShownFrame(
                t_s=seen.t_s,
                taken_s=seen.taken_s,
                summary=f"stair map with {len(seen.nosings_B)} nosings (from the log)",
                nosings_B=seen.nosings_B,
            )
            for seen in recording.maps
        ]
        return cls(order=order, recording=recording, frames=frames)

    def start(self, make: Callable[[Order], Worker] = Worker) -> None:
        """Start the simulation."""
        self.workers["run"] = make(self.order)

    def start_repeat(self, make: Callable[[Order], Worker] = Worker) -> None:
        """Repeat the run, which has ended, for its contact forces."""
        self.contacts.clear()
        script = tuple(self.script or self.order.script)
        self.workers["repeat"] = make(replace(self.order, script=script, speed=FASTEST, pictures=False, contacts=True))

    def close(self, *names: str) -> None:
        """End the named workers, or all."""
        for name in names or tuple(self.workers):
            worker = self.workers.pop(name, None)
            if worker is not None:
                worker.close()

    # What is known of an instant

    @property
    def is_live(self) -> bool:
        """Whether the simulation still runs."""
        return "run" in self.workers

    @property
    def is_empty(self) -> bool:
        """Whether nothing is known of the run yet."""
        return not len(self.recording.t_s)

    @property
    def knows_stair(self) -> bool:
        """Whether the true stair is known and the chair's place on it: else neither stair nor true nosings are drawn."""
        return not self.recording.is_reckoned or self.is_empty

    @cached_property
    def staircase(self) -> Staircase:
        """Staircase that is drawn."""
        return staircase_of(self.order.scenario, self.order.seed)

    @cached_property
    def camera(self) -> PinholeCamera:
        """Camera of the mission."""
        scenario = self.order.scenario
        return self.recording.chair.camera_at(scenario.sensors.rows_px, rear=scenario.drive.direction == "down")

    @cached_property
    def nosings(self) -> NosingComparison:
        """Comparison of perceived and true nosings."""
        return NosingComparison(self.staircase, self.camera)

    def frame_at(self, t_s: float) -> ShownFrame | None:
        """Return the newest camera frame that the mission had received at a time, None before the first."""
        return latest(self.frames, t_s, "taken_s")

    def fresh_frame_at(self, t_s: float) -> ShownFrame | None:
        """Return the newest camera frame that the mission had received at a time; None if the camera is silent since then."""
        frame = self.frame_at(t_s)
        return frame if frame is not None and t_s - frame.taken_s <= SILENCE_S + 1e-6 else None

    def contacts_at(self, t_s: float) -> ContactForces | None:
        """Return the contact forces of the last tick at or before a time, None if they were not asked for then."""
        found = latest(self.contacts, t_s)
        return found if found is not None and t_s - found.t_s < 1.5 * TICK_S else None

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Faults of the scenario and those that were injected."""
        return (*self.order.scenario.fault, *(command for _, command in self.script if isinstance(command, Fault)))

    def payload_shift_at(self, t_s: float) -> tuple[float, float, float]:
        """Return the shift of the passenger's centre of mass by faults and conditions [m]: forward, left, up."""
        given = [
            command for tick, command in self.script if isinstance(command, Conditions) and tick * TICK_S <= t_s + 0.5 * TICK_S
        ]
        x, y, z = given[-1].payload_m if given else (0.0, 0.0, 0.0)
        dx, dy, dz = payload_shift_m(self.faults, t_s)
        return x + dx, y + dy, z + dz

    # What the workers send

    def drain(self) -> None:
        """Take what the workers have sent."""
        for name, worker in tuple(self.workers.items()):
            messages = worker.receive()
            for kind, value in messages:
                self.take(kind, value, name)
            if name == "run" and self.is_live and not messages and not worker.is_alive:
                self.error = self.error or "the simulation ended unexpectedly; treadline view --debug shows more"
                self.close()

    def take(self, kind: str, value: Any, worker: str = "run") -> None:
        """Take a message of a worker; of a repetition, only the contact forces count."""
        match kind:
            case "contacts":
                self.contacts += value
                del self.contacts[:-CONTACTS_MAX]
            case "error":
                self.error = value
                self.close(worker)
            case "end":
                if worker == "run":
                    self.recording = replace(self.recording, verdict=value[0], cause=value[1])
                self.close(worker)
            case "frame":
                self._illustrate(value)
            case "ticks" if self.builder is not None and worker == "run":
                signals, frames = value
                self.builder.add(signals)
                self.recording = self.builder.build()
                self.frames += frames
                self._forget_pictures(len(frames))
            case "limits" if self.builder is not None and worker == "run":
                self.builder.limits = value
            case "obstacle" | "script" if worker == "run":
                (self.obstacles if kind == "obstacle" else self.script).append(value)
            case "way" if worker == "run":
                self.way = value

    def _illustrate(self, frame: ShownFrame) -> None:
        """Replace the stair map of a log by the frame that it came from."""
        if frame.is_judged:
            maps = [other for other in self.frames[self.illustrated :] if other.t_s > frame.t_s + 0.5 * TICK_S]
            self.frames[self.illustrated :] = [frame, *maps]
            self.illustrated += 1
        else:
            place = bisect_left(self.frames, frame.t_s - 0.5 * TICK_S, key=lambda other: other.t_s)
            if place < len(self.frames) and self.frames[place].t_s <= frame.t_s + 0.5 * TICK_S:
                self.frames[place] = replace(self.frames[place], picture=frame.picture)
            else:
                self.frames.insert(place, frame)
        self._forget_pictures(1)

    def _forget_pictures(self, count: int) -> None:
        old = max(len(self.frames) - PICTURES_MAX, 0)
        for number in range(max(old - count, 0), old):
            self.frames[number] = replace(self.frames[number], picture=None, depth_m=None)
