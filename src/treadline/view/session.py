"""Session: a tape, the cursor over it, the worker that extends it, and the fork next to it.

A live run and a recorded one are the same to scene and panels: a tape that may grow, and a cursor. The plant is deterministic, so a
fork repeats the scenario with the same seed and commands up to the cursor and then goes on with one change.
"""

import time
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from treadline.core.signals import TICK_S
from treadline.scenario.faults import Fault
from treadline.view.orders import Command, Handset, Order, Script, Worker
from treadline.view.tape import Look, Tape

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
"""Speeds of the display as multiples of real time."""
STEPS = {"−1 s": -100, "−0.01 s": -1, "+0.01 s": 1, "+1 s": 100}
"""Buttons that move the cursor, and their ticks."""
TRANSPORT = ("start", "play", "end")
"""Further buttons below the timeline; every other name than the outer two plays or pauses."""
PAUSE, FASTEST = -1.0, 0.0
"""Speeds of a worker that mean pause and as fast as possible."""
PICTURES_MAX = 1500
"""Camera images kept: two and a half minutes at 10 Hz, 40 MB; older frames keep their text."""
CONTACTS_MAX = 30_000
"""Ticks whose contact forces are kept: five minutes, 30 MB with 40 contacts; older ones are forgotten."""
SILENT_S = 0.3
"""Time without a report of the handset after which its dead-man switch counts as released [s]: that of the guard's link."""
DRIVE_M_S, TURN_M_S = 0.10, 0.08
"""Belt speeds at full deflection of the handset [m/s]: the guard's limit at edges, and a turn of 14 °/s."""


@dataclass(slots=True, kw_only=True)
class Feed:
    """Tape of a worker that may still run."""

    order: Order
    tape: Tape = field(default_factory=Tape)
    worker: Worker | None = None
    script: Script = field(default_factory=list)
    error: str | None = None
    images: Worker | None = None
    """Worker that runs the detector on the images of a log."""
    repeat: Worker | None = None
    """Worker that repeats the run from its seed and sends the contact forces, which no log holds."""
    _illustrated: int = 0

    def start(self, make: Callable[[Order], Worker] = Worker) -> None:
        """Start the worker."""
        self.script = list(self.order.script)
        self.worker = make(self.order)

    def drain(self) -> bool:
        """Take what the workers have sent; return whether the simulation sent anything."""
        if self.images is not None:
            for kind, value in self.images.receive():
                self._illustrate(kind, value)
        if self.repeat is not None:
            for kind, value in self.repeat.receive():
                self._take_repeated(kind, value)
        if self.worker is None:
            return False
        messages = self.worker.receive()
        for kind, value in messages:
            self._take(kind, value)
        if self.worker is not None and not messages and not self.worker.is_alive:
            self.error = self.error or "the simulation ended unexpectedly; treadline view --debug shows more"
            self.close()
        return bool(messages)

    def _take(self, kind: str, value: Any) -> None:
        match kind:
            case "ticks":
                rows, events, looks = value
                self.tape.append(rows)
                self.tape.events += events
                self.tape.looks += looks
                self._forget_pictures(len(looks))
            case "limits":
                self.tape.limits = value
            case "obstacle":
                self.tape.obstacles.append(value)
            case "contacts":
                self.tape.contacts += value
                del self.tape.contacts[:-CONTACTS_MAX]
            case "script":
                self.script.append(value)
            case "end":
                self.tape.verdict = value
                self.close()
            case "error":
                self.error = value
                self.close()
            case _:
                pass

    def start_repeat(self, make: Callable[[Order], Worker] = Worker) -> None:
        """Repeat the run, which has ended, for its contact forces."""
        self.tape.contacts.clear()
        script = tuple(self.script or self.order.script)
        self.repeat = make(replace(self.order, script=script, speed=FASTEST, pictures=False, contacts=True))

    def _take_repeated(self, kind: str, value: Any) -> None:
        if kind == "contacts":
            self._take(kind, value)
        elif kind in ("end", "error"):
            self.error = value if kind == "error" else self.error
            self.end_repeat()

    def end_repeat(self) -> None:
        """End the repetition; the contact forces so far stay."""
        repeat, self.repeat = self.repeat, None
        if repeat is not None:
            repeat.close()

    def _illustrate(self, kind: str, value: Any) -> None:
        """Replace the stair maps of a log by the frames that they came from."""
        if kind != "look":
            self.error = value if kind == "error" else self.error
            self._end_images()
            return
        looks = self.tape.looks
        if not value.is_judged:
            self._add_picture(value)
            self._forget_pictures(1)
            return
        maps = [look for look in looks[self._illustrated :] if look.t_s > value.t_s + 0.5 * TICK_S]
        looks[self._illustrated :] = [value, *maps]
        self._illustrated += 1
        self._forget_pictures(1)

    def _add_picture(self, shown: Look) -> None:
        """Add an image to the stair map of its time; without one, it is shown alone."""
        looks = self.tape.looks
        place = bisect_left([look.t_s for look in looks], shown.t_s - 0.5 * TICK_S)
        if place < len(looks) and looks[place].t_s <= shown.t_s + 0.5 * TICK_S:
            looks[place] = replace(looks[place], picture=shown.picture)
        else:
            looks.insert(place, shown)

    def _end_images(self) -> None:
        images, self.images = self.images, None
        if images is not None:
            images.close()

    def _forget_pictures(self, count: int) -> None:
        looks = self.tape.looks
        old = max(len(looks) - PICTURES_MAX, 0)
        for number in range(max(old - count, 0), old):
            looks[number] = replace(looks[number], picture=None, depth_m=None)

    def close(self) -> None:
        """End the workers."""
        self._end_images()
        self.end_repeat()
        worker, self.worker = self.worker, None
        if worker is not None:
            worker.close()


@dataclass(slots=True, kw_only=True)
class Session:
    """State of the viewer that all its clients share."""

    feed: Feed
    attended: bool = False
    """Whether clients may command the chair."""
    can_repeat: bool = True
    """Whether scenario and seed of the run are known."""
    cursor_s: float = 0.0
    playing: bool = True
    speed: float = 1.0
    following: bool = True
    """Whether the cursor stays at the newest instant of a live run."""
    ghost: Feed | None = None
    ghost_from_s: float = 0.0
    ghost_name: str = ""
    """Change of the fork, for people."""
    manual: bool = False
    _handset: Handset = field(default_factory=Handset)
    _reported_at: float = 0.0
    _released: tuple[str, float] | None = None

    @property
    def tape(self) -> Tape:
        """Tape that is shown."""
        return self.feed.tape

    @property
    def is_live(self) -> bool:
        """Whether the simulation still runs."""
        return self.feed.worker is not None

    def advance(self, passed_s: float) -> None:
        """Drain the workers and move the cursor.

        Args:
            passed_s: Time since the last call [s].
        """
        self.feed.drain()
        if self.ghost is not None:
            self.ghost.drain()
        self._watch_dead_man()
        end_s = self.tape.end_s
        if self.is_live and self.following:
            self.cursor_s = end_s
        elif self.playing:
            self.cursor_s = min(self.cursor_s + self.speed * passed_s, end_s)
            if self.cursor_s >= end_s:
                if self.is_live:
                    self.following = True
                else:
                    self.playing = False

    def play(self, playing: bool | None = None) -> None:
        """Play or pause; None toggles. A run that is attended pauses its simulation."""
        self.playing = (not self.playing) if playing is None else playing
        if self.playing and not self.is_live and self.cursor_s >= self.tape.end_s - 0.5 * TICK_S:
            self.cursor_s = 0.0
        if not self.playing and self.is_live and not self.attended:
            self.following = False
        self._pace()

    def set_speed(self, speed: float) -> None:
        """Set the speed of display and attended simulation."""
        self.speed = speed
        self._pace()

    def step(self, ticks: int) -> None:
        """Pause and move by ticks; an attended run at its newest instant simulates them."""
        if self.playing:
            self.play(playing=False)
        if self.is_live and self.attended and self.following and ticks > 0:
            self._command("step", ticks)
            return
        self.seek(self.cursor_s + ticks * TICK_S)

    def seek(self, t_s: float) -> None:
        """Move the cursor."""
        self.cursor_s = min(max(t_s, 0.0), self.tape.end_s)
        self.following = self.is_live and self.cursor_s >= self.tape.end_s - TICK_S

    def press_transport(self, button: str) -> None:
        """Press a button below the timeline: one of ``TRANSPORT`` or ``STEPS``."""
        match button:
            case "start":
                self.seek(0.0)
            case _ if button in STEPS:
                self.step(STEPS[button])
            case "end":
                self.seek(self.tape.end_s)
                self.following = self.is_live
            case _:
                self.play()

    def _pace(self) -> None:
        self._command("speed", self.speed if self.playing else PAUSE)

    def _command(self, kind: str, value: Any) -> None:
        """Send a command to the simulation of an attended run; without one it is ignored."""
        if self.attended and self.feed.worker is not None:
            self.feed.worker.send(kind, value)

    def ask_contacts(self, *, asked: bool) -> None:
        """Ask a running simulation for its contact forces from now on, or no longer; this does not affect the run.

        A run that has ended is repeated from its seed, once.
        """
        if self.feed.worker is not None:
            self.feed.worker.send("contacts", asked)
        elif not asked:
            self.feed.end_repeat()
        elif self.can_repeat and self.feed.repeat is None and not self._has_all_contacts:
            self.feed.start_repeat()

    @property
    def _has_all_contacts(self) -> bool:
        known = self.tape.contacts
        return len(known) == CONTACTS_MAX or (len(known) > 0 and known[-1].t_s - known[0].t_s >= self.tape.end_s - 2.0 * TICK_S)

    @property
    def contacts_note(self) -> str:
        """Sentence about where the contact forces come from; empty if nothing needs to be said."""
        if self.is_live or (self.feed.tape.contacts and self.feed.repeat is None):
            return ""
        if self.feed.repeat is not None:
            known = self.tape.contacts
            return f"repeating the run: contact forces up to {known[-1].t_s if known else 0.0:.0f} s of {self.tape.end_s:.0f} s"
        return (
            "contact forces are computed by repeating the run"
            if self.can_repeat
            else "this run cannot be repeated: no contact forces"
        )

    # Commands to the chair

    def act(self, command: Command) -> None:
        """Pass a command to the running simulation; without one, or in a session that only views, it is ignored."""
        self._command("act", command)

    @property
    def handset(self) -> Handset:
        """State of the handset."""
        return self._handset

    def press(self, button: str) -> None:
        """Press the stop or the re-arm button of the handset."""
        self._set_handset(replace(self._handset, **{button: True}))
        self._released = (button, time.monotonic() + 2.0 * SILENT_S)

    def set_manual(self, *, manual: bool) -> None:
        """Hand the belts to a person, or back to the planner."""
        self.manual = manual
        self._reported_at = time.monotonic()
        self._set_handset(Handset(manual=manual, dead_man=True))

    def report(self, *, dead_man: bool, ahead: float, turn: float) -> None:
        """Take a report of keyboard or gamepad; deflections are -1 to 1."""
        if not self.manual:
            return
        if dead_man:
            self._reported_at = time.monotonic()
        ahead, turn = (min(max(value, -1.0), 1.0) for value in (ahead, turn))
        self._set_handset(
            replace(
                self._handset,
                dead_man=dead_man,
                speed_m_s=DRIVE_M_S * ahead if dead_man else 0.0,
                turn_m_s=TURN_M_S * turn if dead_man else 0.0,
            )
        )

    def _watch_dead_man(self) -> None:
        now = time.monotonic()
        if self._released is not None and now >= self._released[1]:
            button, self._released = self._released[0], None
            self._set_handset(replace(self._handset, **{button: False}))
        if self.manual and self._handset.dead_man and now - self._reported_at > SILENT_S:
            self._set_handset(replace(self._handset, dead_man=False, speed_m_s=0.0, turn_m_s=0.0))

    def _set_handset(self, state: Handset) -> None:
        if state != self._handset:
            self._handset = state
            self.act(state)

    # What if

    def fork(self, change: Fault | None, name: str = "") -> None:
        """Repeat the run to the cursor and go on with one change, or with none.

        Args:
            name: The change, for people.
        """
        self.drop_ghost()
        tick = round(self.cursor_s / TICK_S) + 1
        before = [entry for entry in self.feed.script if entry[0] <= tick]
        if change is not None:
            before.append((tick, change.model_copy(update={"at_s": tick * TICK_S})))
        order = replace(self.feed.order, script=tuple(before), speed=FASTEST, attended=False, pictures=False, contacts=True)
        self.ghost, self.ghost_from_s, self.ghost_name = Feed(order=order), self.cursor_s, name
        self.ghost.start()

    def drop_ghost(self) -> None:
        """Remove the fork."""
        if self.ghost is not None:
            self.ghost.close()
        self.ghost = None

    def close(self) -> None:
        """End all workers."""
        self.drop_ghost()
        self.feed.close()
