"""The person in charge, written in a scenario file: stop, let go, re-arm; a hold ends the run only when no re-arm is to come."""

from typing import Any

import pytest

from treadline.run.episode import Traverse, traverse
from treadline.scenario.operator_actions import OperatorAct, does
from treadline.scenario.scenario import Scenario
from treadline.scenario.shipped_files import shipped_controller

FLIGHT: dict[str, Any] = {
    "stair": {"slope_deg": 25.0, "steps": 8, "landing_m": 3.0},
    "start": {"place": "flight", "step": 3},
    "sensors": {"camera": "statistical"},
    "drive": {"duration_s": 30.0},
}


def run(*acts: dict[str, Any], duration_s: float = 30.0) -> Traverse:
    scenario = Scenario.model_validate(FLIGHT | {"operator": list(acts), "drive": {"duration_s": duration_s}})
    return traverse(scenario, controller=shipped_controller("wheelchair"), seed=1)


@pytest.mark.parametrize(("kind", "cause"), [("stop", "operator stop"), ("release", "the dead-man switch is released")])
def test_a_stop_without_a_rearm_ends_the_run_held(kind: str, cause: str) -> None:
    result = run({"kind": kind, "at_s": 2.0})
    assert (result.verdict, result.cause) == ("held", cause)
    assert result.scores.duration_s == pytest.approx(2.0, abs=0.1)


def test_a_hold_that_no_rearm_ends_is_the_end_once_the_last_has_passed() -> None:
    """Test: stopped again after the last re-arm. Expected result: held, at the second stop."""
    result = run({"kind": "stop", "at_s": 1.0}, {"kind": "rearm", "at_s": 2.0}, {"kind": "stop", "at_s": 5.0})
    assert result.verdict == "held"
    assert result.scores.duration_s == pytest.approx(5.0, abs=0.1)


def test_an_act_lasts_from_its_tick_up_to_its_end() -> None:
    act = OperatorAct(kind="stop", at_s=1.0, for_s=0.5)
    assert [does([act], "stop", 0.1 * k) for k in range(8, 17)] == [False, False, True, True, True, True, True, False, False]
