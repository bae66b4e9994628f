"""Feed of a viewer: the recording of a run, complete or growing, with frames, obstacles and contact forces that no log holds.

A live run and a recorded one are the same to scene and panels: a recording that may grow.
"""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from treadline.core.images import PinholeCamera
from treadline.core.signals import TICK_S
from treadline.playback import SILENT_S, NosingComparison, Recording, RecordingBuilder, Signals, staircase_of
from treadline.scenario.chair import ChairDescription
from treadline.scenario.faults import Conditions, Fault, payload_shift_m
from treadline.vehicle.staircase import Staircase
from treadline.view._messages import ContactForces, Obstacle, Order, Script, ShownFrame, latest
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
    script: Script = field(default_factory=list)
    error: str | None = None
    worker: Worker | None = None
    images: Worker | None = None
    """Worker that runs the detector on the images of a log."""
    repeat: Worker | None = None
    """Worker that repeats the run from its seed and sends the contact forces."""
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
        self.worker = make(self.order)

    # What is known of an instant

    @property
    def end_s(self) -> float:
        """Time of the last sample [s]."""
        return self.recording.duration_s

    @property
    def is_empty(self) -> bool:
        """Whether nothing is known of the run yet."""
        return not len(self.recording.t_s)

    @cached_property
    def staircase(self) -> Staircase:
        """Staircase that is drawn."""
        return staircase_of(self.order.scenario, self.order.seed)

    @cached_property
    def camera(self) -> PinholeCamera:
        """Camera of the mission."""
        scenario = self.order.scenario
        return self.recording.chair.camera_at(scenario.sensors.image_height_px, rear=scenario.drive.direction == "down")

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
        return frame if frame is not None and t_s - frame.taken_s <= SILENT_S + 1e-6 else None

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
        for kind, value in [] if self.images is None else self.images.receive():
            self.take_image(kind, value)
        for kind, value in [] if self.repeat is None else self.repeat.receive():
            self.take_repeated(kind, value)
        if self.worker is None:
            return
        messages = self.worker.receive()
        for kind, value in messages:
            self.take(kind, value)
        if self.worker is not None and not messages and not self.worker.is_alive:
            self.error = self.error or "the simulation ended unexpectedly; treadline view --debug shows more"
            self.close()

    def take(self, kind: str, value: Any) -> None:
        """Take a message of the simulation."""
        match kind:
            case "ticks":
                signals, frames = value
                self._grow(signals)
                self.frames += frames
                self._forget_pictures(len(frames))
            case "limits" if self.builder is not None:
                self.builder.limits = value
            case "obstacle":
                self.obstacles.append(value)
            case "contacts":
                self.contacts += value
                del self.contacts[:-CONTACTS_MAX]
            case "script":
                self.script.append(value)
            case "end":
                self.recording = replace(self.recording, verdict=value[0], cause=value[1])
                self.close()
            case "error":
                self.error = value
                self.close()

    def _grow(self, signals: Signals) -> None:
        if self.builder is not None:
            self.builder.add(signals)
            self.recording = self.builder.build()

    def start_repeat(self, make: Callable[[Order], Worker] = Worker) -> None:
        """Repeat the run, which has ended, for its contact forces."""
        self.contacts.clear()
        script = tuple(self.script or self.order.script)
        self.repeat = make(replace(self.order, script=script, speed=FASTEST, pictures=False, contacts=True))

    def take_repeated(self, kind: str, value: Any) -> None:
        """Take a message of the repetition, of which only the contact forces count."""
        if kind == "contacts":
            self.take(kind, value)
        elif kind in ("end", "error"):
            self.error = value if kind == "error" else self.error
            self.end_repeat()

    def take_image(self, kind: str, value: Any) -> None:
        """Replace the stair maps of a log by the frames that they came from."""
        if kind != "frame":
            self.error = value if kind == "error" else self.error
            self.end_images()
        elif value.is_judged:
            maps = [frame for frame in self.frames[self.illustrated :] if frame.t_s > value.t_s + 0.5 * TICK_S]
            self.frames[self.illustrated :] = [value, *maps]
            self.illustrated += 1
        else:
            self._add_picture(value)
        self._forget_pictures(1)

    def _add_picture(self, frame: ShownFrame) -> None:
        """Add an image to the stair map of its time; without one, it is shown alone."""
        place = bisect_left(self.frames, frame.t_s - 0.5 * TICK_S, key=lambda other: other.t_s)
        if place < len(self.frames) and self.frames[place].t_s <= frame.t_s + 0.5 * TICK_S:
            self.frames[place] = replace(self.frames[place], picture=frame.picture)
        else:
            self.frames.insert(place, frame)

    def _forget_pictures(self, count: int) -> None:
        old = max(len(self.frames) - PICTURES_MAX, 0)
        for number in range(max(old - count, 0), old):
            self.frames[number] = replace(self.frames[number], picture=None, depth_m=None)

    def end_images(self) -> None:
        """End the worker of the images; the frames so far stay."""
        images, self.images = self.images, None
        if images is not None:
            images.close()

    def end_repeat(self) -> None:
        """End the repetition; the contact forces so far stay."""
        repeat, self.repeat = self.repeat, None
        if repeat is not None:
            repeat.close()

    def close(self) -> None:
        """End the workers."""
        self.end_images()
        self.end_repeat()
        worker, self.worker = self.worker, None
        if worker is not None:
            worker.close()
