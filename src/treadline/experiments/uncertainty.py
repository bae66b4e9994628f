"""Uncertainty budget: the largest change of each figure by source of uncertainty, next to its margin to the target."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from treadline.experiments.dead_zone import DIFFERENCES_M_S, HEADINGS_DEG
from treadline.experiments.plan import SLOPES_DEG
from treadline.experiments.variations import NOMINAL_VARIATION, SOURCES, SUMMED, VARIATIONS

RunOutcomes = Mapping[str, Mapping[str, Any]]
"""Outcomes of one variation by run name."""
GROUP_OF = {item.name: item.group for item in VARIATIONS}
TURNS = ("turn-25", "turn-28", "turn-30")
GOOD_GRIP_TURN = "turn-28-mu0.9-0.5"
FROM_START = "from +30°, one seed"


@dataclass(frozen=True, slots=True, kw_only=True)
class VariedFigure:
    """One figure of ``results.json`` or of the evidence: the runs it is computed from, and its target."""

    key: str
    """Path in ``sensitivity.json``: part of ``results.json``, friction, slope, name."""
    what: str
    unit: str
    runs: tuple[str, ...]
    score: str
    target: float | None = None
    at_least: bool = False
    over_runs: Callable[[Sequence[float]], float] = max
    conditions: str = "one seed"
    """Conditions of the varied runs, in short: a row of the report may rest on more starts and seeds."""
    is_headline: bool = True
    """Whether the evidence page lists the figure; ``sensitivity.json`` has all figures."""

    def value(self, outcomes: RunOutcomes) -> float | None:
        """Return the figure, or None where one of its runs has none."""
        found = [outcomes[name]["figures"].get(self.score) if name in outcomes else None for name in self.runs]
        known = [value for value in found if value is not None]
        return self.over_runs(known) if len(known) == len(self.runs) else None


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFigure:
    """One figure that a run gives: name in ``results.json``, score of the run, words and unit."""

    name: str
    what: str
    unit: str
    score: str = ""
    """Score of the run; the same as the name where empty."""
    target: float | None = None
    at_least: bool = False
    is_headline: bool = False


RMS = RunFigure(name="rms_heading_deg", what="RMS heading", unit="°")
FINAL = RunFigure(name="final_heading_deg", what="final heading", unit="°")
ROLL_BACK = RunFigure(name="roll_back_m", what="roll-back", unit="m")
DRIFT = RunFigure(name="lateral_m", what="lateral drift", unit="m")
PASSENGER = RunFigure(name="passenger_m_s2", score="passenger_max_m_s2", what="passenger's acceleration", unit="m/s²", target=1.5)
TURN_FIGURES = (
    replace(RMS, is_headline=True),
    replace(ROLL_BACK, is_headline=True),
    replace(PASSENGER, is_headline=True),
    RunFigure(name="settle_s", what="settling to ±2°", unit="s", is_headline=True),
    RunFigure(name="steady_rms_heading_deg", what="RMS heading after 20 s", unit="°"),
    DRIFT,
    RunFigure(name="lateral_m_s2", score="passenger_lateral_m_s2", what="passenger's lateral acceleration", unit="m/s²"),
    RunFigure(name="margin_deg", score="min_stability_margin_deg", what="tip-over margin", unit="°"),
    RunFigure(name="belt_force_n", score="max_belt_force_n", what="largest belt force", unit="N"),
    RunFigure(name="airborne_share", what="share of time without contact", unit=""),
)
TRAVERSAL_FIGURES = (
    RunFigure(name="max_pitch_rate_deg_s", what="largest pitch rate", unit="°/s", target=15.0, is_headline=True),
    replace(PASSENGER, name="passenger_max_m_s2", is_headline=True),
    RunFigure(name="min_stability_margin_deg", what="tip-over margin", unit="°", target=7.0, at_least=True, is_headline=True),
    RunFigure(name="seat_max_deg", what="largest seat error", unit="°", target=3.0, is_headline=True),
)
LUG_FIGURES = (
    replace(ROLL_BACK, is_headline=True),
    replace(PASSENGER, target=None, is_headline=True),
    RunFigure(name="pitch_rate_deg_s", score="max_pitch_rate_deg_s", what="largest pitch rate", unit="°/s", is_headline=True),
    RunFigure(name="margin_deg", score="min_stability_margin_deg", what="tip-over margin", unit="°"),
    RMS,
)
SEAT_FIGURES = (
    RunFigure(name="steady_error_deg", what="steady seat error", unit="°", is_headline=True),
    RunFigure(name="settle_s", what="settling of the seat to ±1°", unit="s"),
    RunFigure(name="max_error_deg", what="largest seat error after settling", unit="°"),
)


def _of_run(
    run: str, key: str, where: str, figures: Sequence[RunFigure], conditions: str = "one seed", **targets: float
) -> tuple[VariedFigure, ...]:
    """Return the figures of one run, under a key; ``targets`` sets the target of a figure by name."""
    return tuple(
        VariedFigure(
            key=f"{key}/{item.name}",
            what=f"{item.what}, {where}",
            unit=item.unit,
            runs=(run,),
            score=item.score or item.name,
            target=targets.get(item.name, item.target),
            at_least=item.at_least,
            conditions=conditions,
            is_headline=item.is_headline,
        )
        for item in figures
    )


def _of_dead_zone() -> tuple[VariedFigure, ...]:
    return tuple(
        VariedFigure(
            key=f"dead_zone/28/{heading}/{difference:g}/yaw_rate_deg_s",
            what=f"yaw rate at {heading}° of heading, belts {difference:g} m/s apart, 28°",
            unit="°/s",
            runs=("dead-zone-28",),
            score=f"yaw_rate_{heading}_{difference:g}",
            is_headline=False,
        )
        for heading in HEADINGS_DEG
        for difference in DIFFERENCES_M_S
    )


FIGURES = (
    VariedFigure(
        key="table2/0.62-0.5/rms_heading_deg",
        what="RMS heading over 80 s, mean of 25°, 28°, 30°, friction 0.62-0.5",
        unit="°",
        runs=TURNS,
        score="rms_heading_deg",
        target=2.3,
        over_runs=_mean,
        conditions=FROM_START,
    ),
    VariedFigure(
        key="table2/0.9-0.5/rms_heading_deg",
        what="RMS heading over 80 s at 28°, friction 0.9-0.5",
        unit="°",
        runs=(GOOD_GRIP_TURN,),
        score="rms_heading_deg",
        target=2.0,
        conditions=f"28°, {FROM_START}",
    ),
    *(
        figure
        for slope, roll_back_m in ((25, 0.02), (28, 0.05), (30, 0.15))
        for figure in _of_run(
            f"turn-{slope}",
            f"table2/0.62-0.5/{slope}",
            f"{slope}°, friction 0.62-0.5",
            TURN_FIGURES,
            FROM_START,
            roll_back_m=roll_back_m,
        )
    ),
    *_of_run(GOOD_GRIP_TURN, "table2/0.9-0.5/28", "28°, friction 0.9-0.5", TURN_FIGURES, FROM_START),
    VariedFigure(
        key="table2/0.62-0.5/passenger_m_s2",
        what="passenger's acceleration, largest of 25°, 28°, 30°, friction 0.62-0.5",
        unit="m/s²",
        runs=TURNS,
        score="passenger_max_m_s2",
        target=1.5,
        conditions=FROM_START,
    ),
    VariedFigure(
        key="table2/0.62-0.5/steady_rms_heading_deg",
        what="RMS heading after 20 s, mean of 25°, 28°, 30°, friction 0.62-0.5",
        unit="°",
        runs=TURNS,
        score="steady_rms_heading_deg",
        over_runs=_mean,
        conditions=FROM_START,
        is_headline=False,
    ),
    *_of_run("turn-28-rollback", "table2_roll_back_allowed/28", "28°, roll-back allowed", TURN_FIGURES, FROM_START),
    *_of_run(
        "straight-28",
        "fig09/28",
        "closed loop straight up 28°",
        [replace(item, is_headline=True) for item in (RMS, DRIFT)],
        "60 s, one seed",
        rms_heading_deg=0.15,
        lateral_m=0.15,
    ),
    *_of_run(
        "straight-28-open",
        "fig09_open/28",
        "open loop straight up 28°",
        [replace(item, is_headline=True) for item in (RMS, FINAL, DRIFT)],
        "60 s, one seed",
    ),
    VariedFigure(
        key="fig08/20/yaw_rate_vaf_percent",
        what="model at 20°: VAF of the yaw rate, one step ahead",
        unit="%",
        runs=("excite-20",),
        score="yaw_rate_vaf_percent",
        target=85.0,
        at_least=True,
    ),
    VariedFigure(
        key="fig08/20/yaw_rate_pole",
        what="model at 20°: dominant pole of the yaw rate, discrete at 4 Hz",
        unit="",
        runs=("excite-20",),
        score="yaw_rate_pole",
    ),
    *_of_dead_zone(),
    *_of_run("as-printed-28", "literal/28", "28°, controller as printed", (RMS, FINAL, ROLL_BACK), FROM_START),
    *_of_run("seat-28", "fig11/28", "28°", SEAT_FIGURES),
    VariedFigure(
        key="fig05/28/robust_heading_deg",
        what="error of the robust heading on the frame of Fig. 5",
        unit="°",
        runs=("frame-28",),
        score="robust_error_deg",
        conditions="one frame",
        is_headline=False,
    ),
    *_of_run("up-28", "up-28", "up-28", TRAVERSAL_FIGURES),
    *_of_run("down-28", "down-28", "down-28", TRAVERSAL_FIGURES),
    *(
        figure
        for slope in SLOPES_DEG
        for figure in _of_run(
            f"turn-{slope}-lugs", f"lugs/turn-{slope}", f"turn at {slope}° with lugs 15/80", LUG_FIGURES, "4 s, one seed"
        )
    ),
    *_of_run("up-28-lugs", "lugs/up-28", "up-28 with lugs 15/80", LUG_FIGURES),
    VariedFigure(
        key="creep/28/mm_min",
        what="creep of a braked chair at 28°",
        unit="mm/min",
        runs=("creep-28",),
        score="creep_mm_min",
        target=0.01,
    ),
    VariedFigure(
        key="slide/32.4/speed_m_s",
        what="speed of a braked chair that slides on 32.4°, after 3 s",
        unit="m/s",
        runs=("slide-32.4",),
        score="slide_speed_m_s",
    ),
    VariedFigure(
        key="slide/32.4/gap_m_s",
        what="the same less Coulomb's g t (sin β - μ cos β)",
        unit="m/s",
        runs=("slide-32.4",),
        score="slide_gap_m_s",
        target=0.011,  # 3 % of the nominal speed
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetRow:
    """The budget of one figure."""

    figure: VariedFigure
    nominal: float | None
    moves: dict[str, float | None]
    """Largest absolute move by source; None where no variation of it has the figure; a source that was not run is absent."""
    values: dict[str, float | None]
    """The figure by variation; None where its runs end without it."""

    @property
    def lost(self) -> tuple[str, ...]:
        """Variations in which the figure's runs end without it."""
        return tuple(name for name, value in self.values.items() if value is None)

    @property
    def missed(self) -> tuple[str, ...]:
        """Variations in which a target is missed that the nominal figure reaches."""
        if self.margin is None or self.margin < 0.0:
            return ()
        return tuple(name for name, value in self.values.items() if value is not None and self._margin_of(value) < 0.0)

    @property
    def rss(self) -> float:
        """Root sum of squares over the independent sources, of those that have a number."""
        return math.sqrt(sum(move**2 for name in SUMMED if (move := self.moves.get(name)) is not None))

    @property
    def margin(self) -> float | None:
        """Distance from the nominal figure to its target, negative where it is missed; None without either."""
        return None if self.nominal is None or self.figure.target is None else self._margin_of(self.nominal)

    def _margin_of(self, value: float) -> float:
        target = self.figure.target or 0.0
        return value - target if self.figure.at_least else target - abs(value)

    @property
    def exceeded(self) -> tuple[str, ...]:
        """Sources that move the figure by more than its margin, either way; empty where the target is missed anyway."""
        if self.margin is None or self.margin < 0.0:
            return ()
        return tuple(name for name, move in self.moves.items() if (move or 0.0) > self.margin)

    def as_json(self) -> dict[str, Any]:
        """Return the row for ``sensitivity.json``."""
        return {
            "nominal": self.nominal,
            "target": self.figure.target,
            "unit": self.figure.unit,
            "conditions": self.figure.conditions,
            **{name.replace(" ", "_"): self.moves.get(name) for name in SOURCES},
            "rss": self.rss,
            "lost": list(self.lost),
            "exceeded": list(self.exceeded),
            "missed": list(self.missed),
        }


def budget(outcomes: Mapping[str, RunOutcomes], figures: Sequence[VariedFigure] = FIGURES) -> list[BudgetRow]:
    """Return one row per figure that the nominal runs have, from outcomes by variation and run."""
    rows = [_row(figure, outcomes) for figure in figures]
    return [row for row in rows if row.nominal is not None]


def _row(figure: VariedFigure, outcomes: Mapping[str, RunOutcomes]) -> BudgetRow:
    nominal = figure.value(outcomes.get(NOMINAL_VARIATION.name, {}))
    moves: dict[str, float | None] = {}
    values: dict[str, float | None] = {}
    for variation in VARIATIONS:
        found = outcomes.get(variation.name, {})
        if variation is NOMINAL_VARIATION or nominal is None or not set(figure.runs) <= set(found):
            continue
        value = values[variation.name] = figure.value(found)
        before = moves.setdefault(variation.group, None)
        if value is not None:
            moves[variation.group] = max(abs(value - nominal), before or 0.0)
    ordered = {name: moves[name] for name in SOURCES if name in moves}
    return BudgetRow(figure=figure, nominal=nominal, moves=ordered, values=values)
