"""A person stops the chair, and lets it go on: in each phase where something is waited for, led, or tested."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.core.ports import Reading, Truth, TruthPlant
from treadline.core.signals import Event, MotionPlan, OperatorInput
from treadline.mission.loop import Mission, Signal
from treadline.mission.mission_blocks import build_blocks
from treadline.plant.mujoco import open_plant
from treadline.run.resolve import mission_config
from treadline.scenario.scenario import Scenario
from treadline.scenario.shipped_files import shipped_controller
from treadline.vehicle.comfort import lasting

LIMIT_S = 150.0
SPEAKS_S = 0.1
"""The button's panel tells ten times a second how it is."""
PITCH_RATE = 15.0 * DEG
"""Row 18 of docs/decisions/0014, nominal; means over 50 ms."""


class Attended:
    """A plant beside which somebody stands."""

    def __init__(self, plant: TruthPlant) -> None:
        self._plant = plant
        self.stop = self.rearm = False
        self._t_s = self._spoke_s = 0.0
        self.start, self.write, self.truth, self.close = plant.start, plant.write, plant.truth, plant.close

    def advance(self, t_s: float) -> None:
        self._t_s = t_s
        self._plant.advance(t_s)

    def read(self) -> list[Reading]:
        said: list[Reading] = []
        if self._t_s - self._spoke_s >= SPEAKS_S:
            self._spoke_s = self._t_s
            said.append(OperatorInput(t_s=self._t_s, stop=self.stop, rearm=self.rearm))
        return [*self._plant.read(), *said]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ride:
    """What became of it."""

    phase: str
    cause: str
    holds: list[str]
    after: list[Truth]
    """From the button's press on."""


def ride(direction: str, place: str, when: Callable[[MotionPlan, float, Truth], bool], *, held_s: float) -> Ride:
    """Drive on a short flight of 28°; stop once ``when`` (plan, seconds in its phase, truth) holds, re-arm after ``held_s``."""
    scenario = Scenario.model_validate(
        {
            "stair": {"slope_deg": 28.0, "run_m": 0.30, "steps": 8 if place == "flight" else 5, "landing_m": 3.0},
            "start": {"place": place, "step": 3, "heading_deg": 0.0 if place == "flight" else 12.0},
            "drive": {"direction": direction, "duration_s": LIMIT_S},
            "sensors": {"camera": "statistical"},
        }
    )
    blocks = build_blocks(mission_config(scenario, shipped_controller("wheelchair")))
    plant = Attended(open_plant(scenario, 3))
    events: list[Event] = []

    def log(signal: Signal, _: float) -> None:
        if isinstance(signal, Event):
            events.append(signal)

    mission = Mission(plant, blocks, log)
    stopped_s, began_s, phase, after = None, 0.0, "", list[Truth]()
    try:
        while True:
            tick = mission.tick()
            (truth,) = plant.truth()
            if tick.plan.phase != phase:
                phase, began_s = tick.plan.phase, tick.t_s
            if stopped_s is None and when(tick.plan, tick.t_s - began_s, truth):
                stopped_s = tick.t_s
            if stopped_s is not None:
                plant.stop = tick.t_s < stopped_s + 0.5
                plant.rearm = stopped_s + held_s < tick.t_s < stopped_s + held_s + 0.5
                if tick.t_s > stopped_s + held_s:
                    after.append(truth)
            if phase in ("arrived", "refused") or tick.t_s > LIMIT_S or (plant.rearm and after[-1].t_s > after[0].t_s + LIMIT_S):
                holds = [event.cause or "" for event in events if event.name == "hold"]
                return Ride(phase=phase, cause=tick.plan.cause, holds=holds, after=after)
    finally:
        plant.close()


UP = {
    "turning square": ("floor", lambda plan, s, _: plan.phase == "align" and s > 0.3),
    "approaching": ("floor", lambda plan, s, _: plan.phase == "approach" and s > 0.1),
    "testing the traction": ("floor", lambda plan, s, _: plan.phase == "traction" and s > 0.7),
    "reaching for the landing": ("flight", lambda plan, s, _: plan.phase == "crest" and s > 0.5),
    "led down over the crest": ("flight", lambda plan, _, truth: plan.phase == "crest" and truth.pitch_rad < 15.0 * DEG),
}
DOWN = {
    "lifted at the edge": ("landing", lambda plan, _, truth: plan.phase == "edge" and truth.pitch_rad > 10.0 * DEG),
    "leaving": ("landing", lambda plan, s, _: plan.phase == "leave" and s > 0.5),
}


@pytest.mark.parametrize(("direction", "what"), [*(("up", what) for what in UP), *(("down", what) for what in DOWN)])
def test_a_chair_that_was_stopped_goes_on_as_if_nothing_had_been(direction: str, what: str) -> None:
    """Test: a stop of 10 s, longer than anything is waited for. Expected result: one hold, the person's; it arrives, and pitches
    no faster after it than without."""
    place, when = (UP if direction == "up" else DOWN)[what]
    run = ride(direction, place, when, held_s=10.0)
    assert run.holds == ["operator stop"]
    assert run.phase == "arrived", run.cause
    rates = np.array([truth.pitch_rate_rad_s for truth in run.after])
    assert float(np.abs(lasting(rates)).max()) <= PITCH_RATE
