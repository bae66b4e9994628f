"""The uncertainty budget: variations of the stated size, moves by hand, and data of the shape that results need."""

import math
from pathlib import Path
from typing import Any

import pytest

from treadline.experiments.budget_runs import RUNS, BudgetJob, Spans
from treadline.experiments.sensitivity import KEYS, SENSITIVITY, read_sensitivity, shown, with_sensitivity
from treadline.experiments.uncertainty import FIGURES, Figure, budget
from treadline.experiments.variations import NOMINAL_VARIATION, SOURCES, SUMMED, VARIATIONS, Variation
from treadline.mechanics.chair import read_chair
from treadline.report.results import Moves
from treadline.scenario import Chair, Scenario


def named(name: str) -> Variation:
    return next(item for item in VARIATIONS if item.name == name)


def test_each_variation_changes_one_thing() -> None:
    assert len({item.name for item in VARIATIONS}) == len(VARIATIONS)
    for item in VARIATIONS:
        parts = (item.physics, item.friction, item.chassis, item.payload, item.com_m, item.lag, item.seed)
        nominal = NOMINAL_VARIATION
        same = (nominal.physics, nominal.friction, nominal.chassis, nominal.payload, nominal.com_m, nominal.lag, nominal.seed)
        assert sum(a != b for a, b in zip(parts, same, strict=True)) == (0 if item is nominal else 1)


def test_the_plant_varies_and_the_operator_knows_nothing_of_it() -> None:
    nominal = Scenario(chair=Chair(payload_kg=50.0))
    heavy = named("passenger +10 %").scenario(nominal)
    assert (heavy.chair.payload_kg, heavy.chair.entered.payload_kg) == (pytest.approx(55.0), 50.0)
    assert named("friction -20 %").scenario(nominal).stair.friction == (pytest.approx(0.496), pytest.approx(0.4))
    assert named("friction along +20 %").scenario(nominal).stair.friction == (pytest.approx(0.744), 0.5)
    chair, file = named("centre of mass +2 cm up").chair("wheelchair"), read_chair("wheelchair")
    assert chair.masses.chassis_com_m[2] - file.masses.chassis_com_m[2] == pytest.approx(0.02)
    assert chair.seat.payload_com_m[2] - file.seat.payload_com_m[2] == pytest.approx(0.02)
    assert named("drive lag ×2").chair("wheelchair").drives.lag_s == 2.0 * file.drives.lag_s
    assert named("chassis -10 %").chair("wheelchair").masses.chassis_kg == pytest.approx(0.9 * file.masses.chassis_kg)
    assert NOMINAL_VARIATION.chair("wheelchair") == file


def outcomes(**values: float | None) -> dict[str, dict[str, dict[str, Any]]]:
    """Return outcomes of one run and one score, by variation."""
    return {name: {"run": {"figures": {"score": value}}} for name, value in values.items()}


def figure(target: float | None = None, *, at_least: bool = False) -> Figure:
    return Figure(key="part/score", what="score", unit="°", runs=("run",), score="score", target=target, at_least=at_least)


CASE: dict[str, float | None] = {
    "nominal": 2.0,
    "step 1 ms": 2.1,
    "step 2.5 ms": 1.7,
    "contact 0.005 s": 2.4,
    "seed 1": 7.0,
    "friction -20 %": None,
    "friction +20 %": 1.9,
    "friction along -20 %": 9.0,
}


def test_moves_are_the_largest_of_a_source_and_the_sum_has_independent_sources() -> None:
    (row,) = budget(outcomes(**CASE), (figure(),))
    assert row.moves == pytest.approx({"step": 0.3, "stiffness": 0.4, "friction": 0.1, "seed": 5.0, "friction along": 7.0})
    assert list(row.moves) == [name for name in SOURCES if name in row.moves]
    assert row.rss == pytest.approx(math.sqrt(0.3**2 + 0.4**2 + 0.1**2))
    assert row.lost == ("friction -20 %",)
    assert row.as_json()["lag"] is None  # not run, so neither a move nor lost
    assert not {"seed", "friction along", "coarse step"} & set(SUMMED)


@pytest.mark.parametrize(
    ("target", "at_least", "margin", "exceeded", "missed"),
    [
        (2.35, False, 0.35, {"stiffness", "seed", "friction along"}, {"contact 0.005 s", "seed 1", "friction along -20 %"}),
        (1.65, True, 0.35, {"stiffness", "seed", "friction along"}, set()),  # moved further, and for the better
        (20.0, False, 18.0, set(), set()),
        (1.0, False, -1.0, set(), set()),  # missed without any variation
        (None, False, None, set(), set()),
    ],
)
def test_a_figure_that_moves_by_more_than_its_margin_says_so(
    target: float | None, at_least: bool, margin: float | None, exceeded: set[str], missed: set[str]
) -> None:
    (row,) = budget(outcomes(**CASE), (figure(target, at_least=at_least),))
    assert row.margin == (None if margin is None else pytest.approx(margin))
    assert (set(row.exceeded), set(row.missed)) == (exceeded, missed)
    assert row.as_json()["exceeded"] == list(row.exceeded)


def test_a_figure_without_a_nominal_run_has_no_row() -> None:
    assert budget(outcomes(nominal=None), (figure(),)) == []


def test_an_outcome_is_kept(tmp_path: Path) -> None:
    job = BudgetJob(variation=NOMINAL_VARIATION, run_name="slide-32.4", spans=Spans(), folder=tmp_path)
    first = job.run()
    # 3 % of 0.36 m/s, the tolerance of the plant's own test of a slide.
    assert abs(first["figures"]["slide_gap_m_s"]) < 0.011
    job.path.write_text(job.path.read_text(encoding="utf-8").replace('"ok"', '"kept"'), encoding="utf-8")
    assert job.run()["verdict"] == "kept"


def test_each_figure_rests_on_runs_that_exist() -> None:
    assert len({item.key for item in FIGURES}) == len(FIGURES)
    assert {name for item in FIGURES for name in item.runs} == set(RUNS)


def test_the_package_has_the_budget_of_each_figure() -> None:
    figures = read_sensitivity()
    assert SENSITIVITY.exists()
    assert set(figures) == {item.key for item in FIGURES}
    for value in figures.values():
        Moves.model_validate(value)
        assert set(KEYS) <= set(value)
        assert value["step"] is not None
        assert value["step"] >= 0.0


def test_results_carry_the_moves_of_their_figures() -> None:
    moves = {"unit": "°", "step": 0.1, "stiffness": 0.2, "friction": None, "lost": ["friction -20 %"], "exceeded": []}
    keys = ("table2/0.62-0.5/28/roll_back_m", "table2/0.62-0.5/rms_heading_deg", "fig09/28/lateral_m", "fig08/20/yaw_rate_pole")
    figures = dict.fromkeys(keys, moves)
    bare = {
        "table2": [{"slope_deg": slope, "friction": [0.62, 0.5]} for slope in (25, 28)],
        "fig09": [{"slope_deg": 28, "loop": loop} for loop in ("closed", "open")],
        "fig08": {"slope_deg": 20},
    }
    found = with_sensitivity(bare, figures)
    assert [list(row["sensitivity"]) for row in found["table2"]] == [[], ["roll_back_m"]]
    assert [list(row["sensitivity"]) for row in found["fig09"]] == [["lateral_m"], []]
    assert found["fig08"]["sensitivity"]["yaw_rate_pole"]["step"] == 0.1
    assert set(KEYS) <= set(shown(figures, "fig08/20")["yaw_rate_pole"])
    assert found["sensitivity"] == figures
