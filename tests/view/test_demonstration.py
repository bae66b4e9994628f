"""The demonstration: the shipped recording, and the offer to run it live."""

from pathlib import Path
from typing import Any

import pytest

from treadline.playback import read_recording
from treadline.scenario.scenario import read_scenario
from treadline.view.demonstration import RECORDING, SCENARIO, LiveOffer, open_demonstration

from .conftest import FakeWorker, a_run, session_of


def test_the_shipped_recording_is_small_and_of_the_present_format() -> None:
    """Test: the recording that comes with the package. Expected: a whole climb of the present scenario, in 300 kB."""
    assert sum(path.stat().st_size for path in Path(RECORDING).iterdir()) < 300_000
    run = read_recording(RECORDING)
    assert run.missing == ()
    assert run.outcome == "arrived"
    assert run.scenario == read_scenario(SCENARIO)
    assert [span.name for span in run.phases] == [
        "search", "align", "approach", "mount", "traction", "climb", "crest", "land", "arrived",
    ]  # fmt: skip
    assert run.limits.slip is not None
    assert len(run.maps) > 100


def test_the_demonstration_begins_where_the_chair_begins_to_climb_and_starts_again_at_its_end() -> None:
    session = open_demonstration()
    session.play(playing=True)
    assert session.run.phase_at(session.cursor_s).name == "mount"
    session.seek(session.feed.end_s - 0.1)
    session.advance(1.0)
    assert (session.playing, session.cursor_s) == (True, 0.0)


def test_a_recording_that_does_not_repeat_stops_at_its_end() -> None:
    session = session_of(a_run())
    session.play(playing=True)
    session.advance(99.0)
    assert not session.playing


def test_the_live_run_is_offered_once_the_short_run_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """Test: a worker that says nothing, and then that it has ended. Expected: the state in words, and then the offer."""
    orders: list[Any] = []

    class Compiling(FakeWorker):
        def __init__(self, order: Any) -> None:
            super().__init__()
            orders.append(order)
            self.said: list[Any] = []

        def receive(self) -> list[Any]:
            return self.said

    worker = Compiling(None)
    monkeypatch.setattr("treadline.view.demonstration.Worker", lambda order: orders.append(order) or worker)
    monkeypatch.setattr("treadline.view.demonstration.FIRST_PICTURE_S", 0.0)
    offer = LiveOffer()
    assert not offer.is_ready
    assert "The recording plays" in offer.status
    offer.begin()
    while len(orders) < 2:
        pass
    assert not offer.is_ready
    assert "s so far" in offer.status
    worker.said = [("ticks", None), ("end", ("time_up", None))]
    assert offer.is_ready
    assert "The simulator is ready" in offer.status
    offer.close()
