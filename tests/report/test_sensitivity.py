"""The summary states the change of a figure with step size, stiffness and friction."""

from typing import Any

import pytest

from treadline.report.compare import comparisons
from treadline.report.results import Moves, Results
from treadline.report.sensitivity import moves_text

MOVES = {"unit": "m", "conditions": "from +30°, one seed", "step": 0.001, "stiffness": 0.0042, "friction": 0.013}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (
            {},
            "±0.001 m with step size, ±0.0042 m with stiffness, ±0.013 m with friction ±20 % (from +30°, one seed)",
        ),
        (
            {"friction": None, "lost": ["friction -20 %"], "exceeded": ["friction"], "missed": ["step 1 ms"], "conditions": ""},
            "±0.001 m with step size, ±0.0042 m with stiffness; no figure with friction -20 %; "
            "margin exceeded with friction; target missed with step 1 ms",
        ),
        ({"step": None, "stiffness": None, "friction": None, "lost": ["step 1 ms"]}, "no figure with step 1 ms"),
    ],
)
def test_moves_are_written_with_their_units(changes: dict[str, Any], says: str) -> None:
    assert moves_text(Moves.model_validate(MOVES | changes)) == says


def test_a_row_has_the_moves_of_its_figure_and_no_other(results: dict[str, Any]) -> None:
    results["sensitivity"] = {"table2/0.62-0.5/28/roll_back_m": MOVES}
    sensitivity = {row.what: row.sensitivity for row in comparisons(Results.model_validate(results))}
    assert [what for what, text in sensitivity.items() if text] == ["roll-back at 28°, friction 0.62/0.5"]
    # A quick run's figures rest on shortened runs, which no budget was made for.
    quick = comparisons(Results.model_validate(results | {"quick": True}))
    assert not any(row.sensitivity for row in quick)


def test_results_without_a_budget_are_read(results: dict[str, Any]) -> None:
    assert Results.model_validate(results).sensitivity == {}


def test_a_small_change_is_written_without_an_exponent() -> None:
    text = moves_text(Moves.model_validate({"unit": "m", "step": 4.7e-05, "stiffness": 148.2, "friction": 0.0}))
    assert text == "±0.000 m with step size, ±148 m with stiffness, ±0.000 m with friction ±20 %"
