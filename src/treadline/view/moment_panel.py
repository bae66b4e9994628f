"""Moments of a run for the panel: of the whole run if it is recorded, of a live run up to now."""

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from treadline.playback import Recording
from treadline.playback.findings import LogNotes, Moment, findings_of
from treadline.report.answers import moments_of
from treadline.scenario.chair import ChairDescription
from treadline.scenario.faults import Fault
from treadline.view.recorded import recording_of
from treadline.view.session import Feed

LEAST_PAUSE_S = 2.0
"""Least time between two computations for a live run [s]."""
LARGEST_SHARE = 0.05
"""Largest share of the time of the updates that the computation takes for a live run."""


@dataclass(slots=True, kw_only=True)
class RunMoments:
    """Moments and answers of a run, computed again while it grows."""

    chair: ChairDescription
    recording: Recording | None = None
    """Recording of a run that does not grow."""
    listed: tuple[Moment, ...] = ()
    """Events and all other moments, in order of time."""
    answers: tuple[dict[str, Any], ...] = ()
    """Answers to the usual questions: text, time, kind and note, as in the player page."""
    margin: str = ""
    """Least tip-over margin with its direction and time; empty without margins."""
    _known: tuple[int, bool] = (0, False)
    _due_s: float = field(default=0.0)

    def update(self, feed: Feed) -> bool:
        """Compute the moments if the run has grown; return whether they are new."""
        known = len(feed.tape), feed.worker is not None
        began_s = time.perf_counter()
        if known == self._known or not known[0] or (known[1] and began_s < self._due_s):
            return False
        self._known = known
        if self.recording is not None:
            recording, notes = self.recording, None
        else:
            recording, notes = self._live(feed)
        findings = findings_of(recording, notes)
        self.listed, self.answers = findings.moments, tuple(moments_of(recording, findings))
        self.margin = findings.margin_text
        cost_s = time.perf_counter() - began_s
        self._due_s = began_s + max(LEAST_PAUSE_S, cost_s / LARGEST_SHARE)
        return True

    def _live(self, feed: Feed) -> tuple[Recording, LogNotes]:
        """Return what a worker has sent so far, with the faults of scenario and script."""
        order = feed.order
        injected = [command for _, command in feed.script if isinstance(command, Fault)]
        scenario = order.scenario.model_copy(update={"fault": (*order.scenario.fault, *injected)})
        recording = recording_of(feed.tape, self.chair, scenario, order.seed)
        exposures_s = np.array([look.t_s for look in feed.tape.looks])
        return replace(recording, verdict=feed.tape.verdict), LogNotes(exposures_s=exposures_s, faults=scenario.fault)
