"""A loop that stands still, by the monotonic clock (GUARD §1, hole 13)."""

import itertools
import time
from collections.abc import Callable, Sequence
from threading import Event as Flag

import pytest

from treadline.core.loop_watchdog import LoopWatchdog
from treadline.core.ports import Reading, Truth
from treadline.core.signals import FlipperCommand, SeatCommand, TrackCommand
from treadline.plant.mujoco import open_plant
from treadline.run.episode import Traverse, run_episode
from treadline.run.resolve import resolve
from treadline.scenario.scenario import Scenario

SCENARIO = Scenario.model_validate(
    {
        "stair": {"steps": 12},
        "start": {"place": "flight", "step": 4},
        "sensors": {"camera": "statistical"},
        "drive": {"duration_s": 1.0},
    }
)
STALL_TICK = 60


class Stalling:
    """Chair on the wall clock, one of whose calls does not return at one tick until somebody lets it."""

    def __init__(self, call: str, wait: Callable[[], object]) -> None:
        self._plant = open_plant(SCENARIO, 0)
        self._call, self._wait = call, wait
        self.written: list[TrackCommand] = []
        self._ticks = itertools.count()
        self._tick = 0
        self.start, self.truth, self.close = self._plant.start, self._plant.truth, self._plant.close

    def advance(self, until_s: float) -> None:
        self._tick = next(self._ticks)
        self._stall("advance")
        self._plant.advance(until_s)

    def read(self) -> Sequence[Reading]:
        self._stall("read")
        return self._plant.read()

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        self.written.append(tracks)
        self._plant.write(tracks, seat, flipper)
        self._stall("write")

    def truth(self) -> Sequence[Truth]: ...

    def _stall(self, call: str) -> None:
        if call == self._call and self._tick == STALL_TICK:
            self._wait()


class Virtual(Stalling):
    """The same chair in virtual time."""

    virtual_time = True


def run(plant: Stalling, pace: Callable[[float], None] | None = None) -> Traverse:
    return run_episode(resolve(SCENARIO), plant=plant, pace=pace, after_hold_s=0.05)


@pytest.mark.parametrize("call", ["advance", "read", "write"])
def test_a_call_of_the_plant_that_does_not_return_is_braked_out_of_band_and_held(call: str) -> None:
    """Test: at 0.6 s one call does not return until the plant's ``brake`` is called. Expected result: the watchdog calls it; the
    first command after the return is HOLD, and the cause names the call."""
    returned = Flag()
    plant = Stalling(call, lambda: returned.wait(60.0))
    plant.brake = returned.set  # type: ignore[attr-defined]
    ended = run(plant)
    assert returned.is_set()
    assert ended.verdict == "held"
    assert (ended.cause or "").startswith("the loop stood still for 0.")
    assert (ended.cause or "").endswith(f" s in plant.{call}")
    after = STALL_TICK + (call == "write")
    assert not any(command.brake for command in plant.written[1:after])
    assert plant.written[after].brake


def test_a_plant_in_virtual_time_is_exempt_and_its_commands_are_the_same() -> None:
    stalled, plain = Virtual("write", lambda: time.sleep(0.5)), Virtual("", lambda: None)
    assert run(stalled).verdict == run(plain).verdict == "time_up"
    assert stalled.written == plain.written


def test_a_pause_that_the_viewer_announces_is_no_standstill() -> None:
    ended = run(Stalling("", lambda: None), pace=lambda t_s: time.sleep(0.5 if t_s == 0.5 else 0.0))
    assert ended.verdict == "time_up"


def test_a_process_that_was_stopped_finds_the_gap_at_its_next_step() -> None:
    """Test: neither the loop nor the thread runs for 3 s, as after SIGSTOP. Expected result: the next step latches, with the step
    that was under way; steps 0.3 s apart do not."""
    clock = [100.0]
    causes: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("treadline.core.loop_watchdog.time.monotonic", lambda: clock[0])
        with LoopWatchdog(causes.append, limit_s=0.3) as watchdog:
            for step, later_s in (("plant.read", 0.29), ("plant.write", 3.0), ("plant.advance", 0.0)):
                watchdog.begin(step)
                clock[0] += later_s
    assert causes == ["the loop stood still for 3.0 s in plant.write"]
    watchdog.begin("after the run")
    assert len(causes) == 1


def test_a_brake_that_fails_is_logged_and_called_again_in_the_next_standstill(caplog: pytest.LogCaptureFixture) -> None:
    called = Flag()

    def brake() -> None:
        called.set()
        raise OSError("the serial port is gone")

    with LoopWatchdog(lambda _: None, brake, limit_s=0.3) as watchdog:
        for _ in range(2):
            called.clear()
            with pytest.raises(KeyError), watchdog.paused():
                raise KeyError  # a pause that fails ends as well
            assert called.wait(60.0)
    assert "the serial port is gone" in caplog.text
