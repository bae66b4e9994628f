"""The demonstration: the shipped recording, and the offer to run it live."""

import time
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from treadline.playback import read_recording
from treadline.scenario.scenario import read_scenario
from treadline.view.opening import RECORDING, SCENARIO, LiveOffer, open_demonstration


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
    assert run.limits.deviation is not None
    assert len(run.maps) > 100


def test_the_demonstration_begins_where_the_chair_begins_to_climb_and_starts_again_at_its_end() -> None:
    session = open_demonstration()
    session.play(playing=True)
    assert session.run.phase_at(session.cursor_s).name == "mount"
    session.seek(session.run.duration_s - 0.1)
    session.advance(1.0)
    assert (session.playing, session.cursor_s) == (True, 0.0)


def test_the_live_run_is_offered_once_the_kernels_are_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Test: a compilation that waits, then ends. Expected: the state in words, then the offer; closing ends the process."""
    begun, may_end, commands = Event(), Event(), []

    class Compiling:
        def __init__(self, command: list[str], **_: Any) -> None:
            commands.append(command)
            begun.set()

        def wait(self) -> None:
            may_end.wait(10.0)

        def terminate(self) -> None:
            commands.append(["terminated"])

    monkeypatch.setattr("treadline.view.opening.subprocess.Popen", Compiling)
    monkeypatch.setattr("treadline.view.opening.FIRST_PICTURE_S", 0.0)
    offer = LiveOffer()
    assert not offer.is_ready
    assert "The recording plays" in offer.status
    offer.begin()
    assert begun.wait(10.0)
    assert not offer.is_ready
    may_end.set()
    while not offer.is_ready:
        time.sleep(0.01)
    assert "The simulator is ready" in offer.status
    offer.close()
    assert [command[-1] for command in commands] == ["compile", "terminated"]
