"""The conditions column says how far a figure moves with step size, stiffness and friction."""

from typing import Any

import pytest

from treadline.report.compare import comparisons
from treadline.report.results import Moves, Results
from treadline.report.sensitivity import told

MOVES = {"unit": "m", "conditions": "from +30°, one seed", "step": 0.001, "stiffness": 0.0042, "friction": 0.013}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (
            {},
            "moves by ±0.001 m with step size, ±0.004 m with stiffness, ±0.013 m with friction ±20 % (from +30°, one seed)",
        ),
        (
            {"friction": None, "lost": ["friction -20 %"], "exceeded": ["friction"], "missed": ["step 1 ms"], "conditions": ""},
            "moves by ±0.001 m with step size, ±0.004 m with stiffness; no figure with friction -20 %; "
            "more than its margin with friction; target missed with step 1 ms",
        ),
        ({"step": None, "stiffness": None, "friction": None, "lost": ["step 1 ms"]}, "no figure with step 1 ms"),
    ],
)
def test_moves_are_told_with_their_units(changes: dict[str, Any], says: str) -> None:
    assert told(Moves.model_validate(MOVES | changes)) == says


def test_a_row_has_the_moves_of_its_figure_and_no_other(results: dict[str, Any]) -> None:
    results["sensitivity"] = {"table2/0.62-0.5/28/roll_back_m": MOVES}
    conditions = {row.what: row.conditions for row in comparisons(Results.model_validate(results))}
    told_of = [what for what, text in conditions.items() if "moves by" in text]
    assert told_of == ["roll-back at 28°, friction 0.62/0.5"]
    # A quick run's figures rest on shortened runs, which no budget was made for.
    quick = comparisons(Results.model_validate(results | {"quick": True}))
    assert not any("moves by" in row.conditions for row in quick)


def test_results_without_a_budget_are_read(results: dict[str, Any]) -> None:
    assert Results.model_validate(results).sensitivity == {}
