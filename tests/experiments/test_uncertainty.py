"""The uncertainty budget: variations of the stated size, moves by hand, and data of the shape that results need."""

import math
from dataclasses import fields
from typing import Any

import pytest
from uncertainty_figures import FIGURES, VariedFigure, budget
from uncertainty_runs import ALL_RUNS, NOMINAL_VARIATION, SOURCES, SUMMED, VARIATIONS, Variation

from treadline.core.files import read_json
from treadline.experiments._sensitivity import NEAREST, SENSITIVITY, shown, with_nearest, with_sensitivity
from treadline.report._results import Moves
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair, Scenario

MAIN_SOURCES = ("step", "stiffness", "friction")


def named(name: str) -> Variation:
    return next(item for item in VARIATIONS if item.name == name)


def test_each_variation_changes_one_thing() -> None:
    assert len({item.name for item in VARIATIONS}) == len(VARIATIONS)
    for item in VARIATIONS:
        changed = [part.name for part in fields(Variation) if getattr(item, part.name) != getattr(NOMINAL_VARIATION, part.name)]
        assert len(set(changed) - {"name", "group"}) == (0 if item is NOMINAL_VARIATION else 1)


def test_the_plant_varies_and_the_mission_configuration_does_not() -> None:
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


def figure(target: float | None = None, *, at_least: bool = False) -> VariedFigure:
    return VariedFigure("part/score", "score", "°", "score", target, at_least=at_least, runs=("run",))


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


def test_each_figure_rests_on_runs_that_exist() -> None:
    assert len({item.key for item in FIGURES}) == len(FIGURES)
    assert {name for item in FIGURES for name in item.runs} == set(ALL_RUNS)


def test_the_package_has_the_budget_of_each_figure() -> None:
    figures = read_json(SENSITIVITY)
    assert set(figures) == {item.key for item in FIGURES}
    for value in figures.values():
        Moves.model_validate(value)
        assert set(MAIN_SOURCES) <= set(value)
        known = [value[source] for source in MAIN_SOURCES if value[source] is not None]
        # A source without a number has lost its runs, and the file says which.
        assert known or value["lost"]
        assert all(move >= 0.0 for move in known)


def test_each_part_that_is_not_varied_has_the_moves_of_one_that_is() -> None:
    completed, measured = with_nearest(read_json(SENSITIVITY)), read_json(SENSITIVITY)
    for part, (nearest, label) in NEAREST.items():
        found = shown(completed, part)
        assert set(found) >= set(shown(completed, nearest)) != set()
        borrowed = [moves for name, moves in found.items() if f"{part}/{name}" not in measured]
        assert borrowed
        assert all(label in moves["conditions"] for moves in borrowed)
    own = with_nearest({"fig09/28/lateral_m": {"step": 1.0}, "fig09/25/lateral_m": {"step": 2.0}})
    assert own["fig09/25/lateral_m"] == {"step": 2.0}, "a measured figure keeps its own moves"
    assert own["fig09/30/lateral_m"]["step"] == 1.0


def bare_results() -> dict[str, Any]:
    """Return the labels of each row of a reproduction, without its figures."""
    slopes, frictions = (25, 28, 30), ([0.62, 0.5], [0.9, 0.5])
    models = [(20, [0.62, 0.5]), (28, [0.9, 0.5]), *((slope, [0.62, 0.5]) for slope in slopes)]
    learned = [{"slope_deg": slope, "friction": friction} for slope, friction in models]
    return {
        "table2": [{"slope_deg": slope, "friction": friction} for friction in frictions for slope in slopes],
        "table2_roll_back_allowed": [{"slope_deg": slope} for slope in slopes],
        "fig05": {},
        "fig08": learned[0] | {"slopes": learned},
        "fig09": [{"slope_deg": slope, "loop": loop} for slope in slopes for loop in ("closed", "open")],
        "fig10": [{"slope_deg": 28}],
        "fig11": {},
        "dead_zone": [{"slope_deg": 28, "heading_deg": 10, "difference_m_s": 0.4}],
        "literal": {},
        "lugs": [{"course": course, "lug": "15/80"} for course in ("turn-25", "turn-28", "turn-30", "up-28")],
    }


def test_every_row_of_the_results_has_its_sensitivity() -> None:
    found = with_sensitivity(bare_results(), with_nearest(read_json(SENSITIVITY)))
    for part, value in found.items():
        rows = value if isinstance(value, list) else [value, *value.get("slopes", [])]
        for row in rows if part != "sensitivity" else ():
            assert row["sensitivity"], (part, row)
            assert all(set(MAIN_SOURCES) <= set(moves) for moves in row["sensitivity"].values())


def test_a_row_has_the_moves_of_its_own_figures() -> None:
    moves = {"unit": "°", "step": 0.1, "stiffness": 0.2, "friction": None, "lost": ["friction -20 %"], "exceeded": []}
    keys = ("table2/0.62-0.5/28/roll_back_m", "table2/0.62-0.5/rms_heading_deg", "fig09/28/lateral_m", "fig08/20/yaw_rate_pole")
    found = with_sensitivity(bare_results(), dict.fromkeys(keys, moves))
    assert [list(row["sensitivity"]) for row in found["table2"][:3]] == [[], ["roll_back_m"], []]
    assert [list(row["sensitivity"]) for row in found["fig09"]] == [[], [], ["lateral_m"], [], [], []]
    assert found["fig08"]["sensitivity"]["yaw_rate_pole"]["step"] == 0.1
