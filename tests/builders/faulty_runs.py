"""Runs on a stair with faults, for tests of the rows of docs/explanation/safety.md; the camera is the one without images."""

from functools import cache
from typing import Any

import numpy as np

from treadline.core.angles import DEG
from treadline.run.episode import Traverse, traverse
from treadline.scenario.faults import Fault
from treadline.scenario.scenario import Scenario
from treadline.scenario.shipped_files import shipped_controller

TICK_S = 0.01


def fault(kind: str, value: float = 0.0, *, at_s: float, for_s: float) -> Fault:
    return Fault.model_validate({"kind": kind, "value": value, "at_s": at_s, "for_s": for_s})


@cache
def ride(
    *faults: Fault,
    place: str,
    direction: str,
    step: int,
    until_s: float,
    after_s: float,
    steps: int | None = None,
    heavy: bool = False,
    seed: int = 0,
) -> Traverse:
    """Drive on 28° until the end, or for a while after a hold; heavy: 80 kg on 30° with little friction."""
    stair: dict[str, Any] = {} if steps is None else {"steps": steps, "landing_m": 3.0}
    scenario = Scenario.model_validate(
        {
            "stair": stair | ({"slope_deg": 30.0, "friction": (0.673, 0.543)} if heavy else {}),
            "chair": {"payload_kg": 80.0 if heavy else 50.0},
            "start": {"place": place, "step": step},
            "drive": {"direction": direction, "duration_s": until_s},
            "sensors": {"camera": "statistical"},
            "fault": faults,
        }
    )
    return traverse(scenario, controller=shipped_controller("wheelchair"), seed=seed, after_hold_s=after_s)


def hold_s(run: Traverse, since_s: float = 0.0) -> float:
    """Return when the chair was held."""
    return next(event.t_s for event in run.events if event.name == "hold" and event.t_s >= since_s - 1e-6)


def stands_still(run: Traverse, *, margin_deg: float = 0.0, since_s: float = 0.0) -> None:
    """Check rule H half a second after the hold: no sliding, turning or tipping."""
    assert run.verdict in ("held", "held_rough"), f"{run.verdict}: {run.cause}"  # a brake at 0.2 m/s may be rough
    rest = slice(round((hold_s(run, since_s) + 0.5) / TICK_S), None)
    assert len(run.trace["t_s"][rest]) > 100
    assert float(np.ptp(run.trace["x_m"][rest])) <= 0.020
    assert float(np.ptp(run.trace["heading_rad"][rest])) <= 2.0 * DEG
    assert float(run.trace["stability_margin_rad"][rest].min()) > margin_deg * DEG
