"""Session: the run that is shown, the cursor over it, and the fork next to it.

The plant is deterministic: a fork repeats the scenario with the same seed and commands up to the cursor, and then goes on with one
change.
"""

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from treadline.core.signals import TICK_S
from treadline.guard import SILENCE_S
from treadline.playback import Moment, Recording, findings_of
from treadline.report.answers import moments_of
from treadline.scenario.faults import Fault
from treadline.view._feed import CONTACTS_MAX, FASTEST, Feed
from treadline.view._messages import Command, Handset

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
"""Speeds of the display as multiples of real time."""
STEPS = {"−1 s": -100, "−0.01 s": -1, "+0.01 s": 1, "+1 s": 100}
"""Buttons that move the cursor, and their ticks."""
TRANSPORT = ("start", *STEPS, "play", "end")
"""Buttons of the timeline."""
PAUSE = -1.0
"""Speed of a worker that means pause."""
DRIVE_M_S, TURN_M_S = 0.10, 0.08
"""Belt speeds at full deflection of the handset [m/s]: the guard's limit at edges, and a turn of 14 °/s."""
LEAST_PAUSE_S = 2.0
"""Least time between two computations of the moments of a live run [s]."""
LARGEST_SHARE = 0.05
"""Largest share of the time of the updates that the computation takes for a live run."""


@dataclass(slots=True, kw_only=True)
class RunMoments:
    """Moments and answers of a run, computed again while it grows."""

    listed: tuple[Moment, ...] = ()
    """Events and all other moments, in order of time."""
    answers: tuple[dict[str, Any], ...] = ()
    """Answers to the usual questions: text, time, kind and note, as in the player page."""
    margin: str = ""
    """Least tip-over margin with its direction and time; empty without margins."""
    _known: tuple[Recording | None, bool] = (None, False)
    _due_s: float = 0.0

    def update(self, feed: Feed) -> bool:
        """Compute the moments if the run has grown; return whether they are new."""
        recording = feed.recording
        known, began_s = (recording, feed.is_live), time.perf_counter()
        if feed.is_empty or known == self._known or (known[1] and began_s < self._due_s):
            return False
        self._known = known
        if feed.builder is not None:
            exposures_s = np.unique([*(frame.t_s for frame in feed.frames), *(seen.t_s for seen in recording.maps)])
            scenario = feed.order.scenario.model_copy(update={"fault": feed.faults})
            recording = replace(recording, scenario=scenario, exposures_s=exposures_s)
        findings = findings_of(recording)
        self.listed, self.answers = findings.moments, tuple(moments_of(recording, findings))
        self.margin = findings.margin_text
        cost_s = time.perf_counter() - began_s
        self._due_s = began_s + max(LEAST_PAUSE_S, cost_s / LARGEST_SHARE)
        return True


@dataclass(slots=True, kw_only=True)
class Fork:
    """Repeated run with one change."""

    feed: Feed
    from_s: float
    """Time of the change [s]."""
    name: str
    """Change, for people."""
    began_at: float
    """Clock at the start of the simulation [s]."""
    moments: RunMoments = field(default_factory=RunMoments)

    @property
    def waited_s(self) -> float:
        """Time since the start of the simulation [s]."""
        return time.perf_counter() - self.began_at


@dataclass(slots=True, kw_only=True)
class Session:
    """State of the viewer that all its clients share."""

    feed: Feed
    title: str = ""
    attended: bool = False
    """Whether clients may command the chair."""
    can_repeat: bool = True
    """Whether the run can be repeated and forked: its scenario and seed are known."""
    moments: RunMoments = field(default_factory=RunMoments)
    cursor_s: float = 0.0
    playing: bool = True
    speed: float = 1.0
    repeats: bool = False
    """Whether a recording begins anew at its end."""
    following: bool = True
    """Whether the cursor stays at the newest instant of a live run."""
    ghost: Fork | None = None
    shows: dict[str, bool] = field(default_factory=dict)
    """What of the scene is shown, by name."""
    manual: bool = False
    handset: Handset = field(default_factory=Handset)
    dropped: int = 0
    """Messages of pages that could not be read."""
    _reported_at: float = 0.0
    _released: tuple[str, float] | None = None

    @property
    def run(self) -> Recording:
        """Recording that is shown."""
        return self.feed.recording

    def advance(self, passed_s: float) -> None:
        """Drain the workers and move the cursor.

        Args:
            passed_s: Time since the last call [s].
        """
        self.feed.drain()
        if self.ghost is not None:
            self.ghost.feed.drain()
        self._watch_dead_man()
        end_s = self.run.duration_s
        if self.feed.is_live and self.following:
            self.cursor_s = end_s
        elif self.playing:
            self.cursor_s = min(self.cursor_s + self.speed * passed_s, end_s)
            if self.cursor_s >= end_s:
                if self.feed.is_live:
                    self.following = True
                elif self.repeats:
                    self.cursor_s = 0.0
                else:
                    self.playing = False

    def play(self, playing: bool | None = None) -> None:
        """Play or pause; None toggles. A run that is attended pauses its simulation."""
        self.playing = (not self.playing) if playing is None else playing
        if self.playing and not self.feed.is_live and self.cursor_s >= self.run.duration_s - 0.5 * TICK_S:
            self.cursor_s = 0.0
        if not self.playing and self.feed.is_live and not self.attended:
            self.following = False
        self._command("speed", self.speed if self.playing else PAUSE)

    def set_speed(self, speed: float) -> None:
        """Set the speed of display and attended simulation."""
        self.speed = speed
        self._command("speed", self.speed if self.playing else PAUSE)

    def step(self, ticks: int) -> None:
        """Pause and move by ticks; an attended run at its newest instant simulates them."""
        if self.playing:
            self.play(playing=False)
        if self.feed.is_live and self.attended and self.following and ticks > 0:
            self._command("step", ticks)
            return
        self.seek(self.cursor_s + ticks * TICK_S)

    def seek(self, t_s: float) -> None:
        """Move the cursor."""
        self.cursor_s = min(max(t_s, 0.0), self.run.duration_s)
        self.following = self.feed.is_live and self.cursor_s >= self.run.duration_s - TICK_S

    def press_transport(self, button: str) -> None:
        """Press a button of the timeline: one of ``TRANSPORT``; every other name plays or pauses."""
        match button:
            case "start":
                self.seek(0.0)
            case _ if button in STEPS:
                self.step(STEPS[button])
            case "end":
                self.seek(self.run.duration_s)
                self.following = self.feed.is_live
            case _:
                self.play()

    def _command(self, kind: str, value: Any) -> None:
        """Send a command to the simulation of an attended run; without one it is ignored."""
        if self.attended and self.feed.is_live:
            self.feed.workers["run"].send(kind, value)

    def ask_contacts(self, *, asked: bool) -> None:
        """Ask a running simulation for its contact forces from now on, or no longer; this does not affect the run.

        A run that has ended is repeated from its seed, once.
        """
        if self.feed.is_live:
            self.feed.workers["run"].send("contacts", asked)
        elif not asked:
            self.feed.close("repeat")
        elif self.can_repeat and "repeat" not in self.feed.workers:
            known = self.feed.contacts
            reaches_end = len(known) > 0 and known[-1].t_s - known[0].t_s >= self.run.duration_s - 2.0 * TICK_S
            if len(known) != CONTACTS_MAX and not reaches_end:
                self.feed.start_repeat()

    # Commands to the chair

    def act(self, command: Command) -> None:
        """Pass a command to the running simulation; without one, or in a session that only views, it is ignored."""
        self._command("act", command)

    def press(self, button: str) -> None:
        """Press a button of the handset, named as in ``OperatorInput``."""
        self._set_handset(replace(self.handset, **{button: True}))
        self._released = (button, time.monotonic() + 2.0 * SILENCE_S)

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
                self.handset,
                dead_man=dead_man,
                speed_m_s=DRIVE_M_S * ahead if dead_man else 0.0,
                turn_m_s=TURN_M_S * turn if dead_man else 0.0,
            )
        )

    def _watch_dead_man(self) -> None:
        now = time.monotonic()
        if self._released is not None and now >= self._released[1]:
            button, self._released = self._released[0], None
            self._set_handset(replace(self.handset, **{button: False}))
        if self.manual and self.handset.dead_man and now - self._reported_at > SILENCE_S:
            self._set_handset(replace(self.handset, dead_man=False, speed_m_s=0.0, turn_m_s=0.0))

    def _set_handset(self, state: Handset) -> None:
        if state != self.handset:
            self.handset = state
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
        self.ghost = Fork(feed=Feed.live(order, self.run.chair), from_s=self.cursor_s, name=name, began_at=time.perf_counter())
        self.ghost.feed.start()

    def drop_ghost(self) -> None:
        """Remove the fork."""
        if self.ghost is not None:
            self.ghost.feed.close()
        self.ghost = None

    def close(self) -> None:
        """End all workers."""
        self.drop_ghost()
        self.feed.close()
