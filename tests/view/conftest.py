"""A synthetic run for panels and sessions, and live runs in this process."""

from typing import Any

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.core.signals import Event
from treadline.playback import Limits, Recording
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario
from treadline.view._feed import Feed
from treadline.view._messages import Order
from treadline.view._process import Worker
from treadline.view._session import Session

END_S = 30.0
LIMITS = Limits(pitch_rate_rad_s=25.0 * DEG, square_rad=5.0 * DEG, belt_limit_m_s=1.0, deviation=0.3, seat_rad=5.0 * DEG)


class FakeWorker(Worker):
    """Worker without a process that keeps its commands."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, Any]] = []

    @property
    def is_alive(self) -> bool:
        return True

    def receive(self) -> list[Any]:
        return []

    def send(self, kind: str, value: Any = None) -> None:
        self.sent.append((kind, value))

    def close(self) -> None:
        pass


def a_run(*, more: tuple[Event, ...] = (), **columns: Any) -> Recording:
    """Return thirty seconds of a chair that drives forwards at 0.1 m/s, with the given quantities."""
    from treadline.playback._recording import phases_of

    t_s = 0.01 * np.arange(round(END_S / 0.01) + 1)
    events = (
        Event(t_s=0.0, name="climb", cause="start"),
        Event(t_s=12.0, name="hold", cause="operator <stop>"),
        Event(t_s=15.0, name="rearmed", cause="by a person"),
        Event(t_s=20.0, name="crest", cause="end of the flight"),
        *more,
    )
    zeros = np.zeros(len(t_s))
    level = dict.fromkeys(("seat_rad", "heading_rad", "estimate_rad", "pitch_rate_rad_s", "seat_pitch_rad", "slip"), zeros)
    pairs = {name: np.zeros((len(t_s), 2)) for name in ("belt_m_s", "belt_travel_m", "command_m_s")}
    known = {
        **level,
        **pairs,
        "p_WB": np.column_stack([0.1 * t_s, zeros, zeros]),
        "quat_WB": np.tile([1.0, 0.0, 0.0, 0.0], (len(t_s), 1)),
        "margin_rad": np.full(len(t_s), 20.0 * DEG),
        **{name: np.broadcast_to(values, (len(t_s), *np.shape(values)[1:])) for name, values in columns.items()},
    }
    found = {"events": events, "phases": phases_of(events, END_S), "limits": LIMITS}
    return Recording.of_curves(t_s, read_chair("wheelchair"), **known, **found)


def session_of(run: Recording, t_s: float = 0.0, *, live: bool = False, attended: bool = False) -> Session:
    """Return a session of a run with its cursor at a time."""
    feed = Feed(order=Order(scenario=Scenario(), seed=0), recording=run, workers={"run": FakeWorker()} if live else {})
    return Session(feed=feed, title="run", cursor_s=t_s, playing=live, following=live, attended=attended)


@pytest.fixture
def attended() -> Session:
    """Session of a live run that may be commanded."""
    return session_of(a_run(), live=True, attended=True)
