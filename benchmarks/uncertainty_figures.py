"""Figures of the uncertainty budget: the runs behind each, its target, and its largest change by source of uncertainty."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from uncertainty_runs import NOMINAL_VARIATION, SOURCES, SUMMED, VARIATIONS

from treadline.experiments._dead_zone import DIFFERENCES_M_S, HEADINGS_DEG
from treadline.experiments.plan import SLOPES_DEG

RunOutcomes = Mapping[str, Mapping[str, Any]]
"""Outcomes of one variation by run name."""
TURNS = ("turn-25", "turn-28", "turn-30")
GOOD_GRIP_TURN = "turn-28-mu0.9-0.5"
FROM_START = "from +30°, one seed"


def mean(values: Sequence[float]) -> float:
    """Return the mean."""
    return sum(values) / len(values)


@dataclass(frozen=True, slots=True)
class VariedFigure:
    """One figure of ``results.json`` or of the evidence: the runs it is computed from, and its target."""

    key: str
    """Path in ``sensitivity.json``: part of ``results.json``, friction, slope, name."""
    what: str
    unit: str
    score: str
    """Score of the runs."""
    target: float | None = None
    at_least: bool = False
    is_headline: bool = True
    """Whether the evidence page lists the figure; ``sensitivity.json`` has all figures."""
    runs: tuple[str, ...] = ()
    over_runs: Callable[[Sequence[float]], float] = max
    conditions: str = "one seed"
    """Conditions of the varied runs, in short: a row of the report may rest on more starts and seeds."""

    def value(self, outcomes: RunOutcomes) -> float | None:
        """Return the figure, or None where one of its runs has none."""
        found = [outcomes[name]["figures"].get(self.score) if name in outcomes else None for name in self.runs]
        known = [value for value in found if value is not None]
        return self.over_runs(known) if len(known) == len(self.runs) else None


RMS = VariedFigure("rms_heading_deg", "RMS heading", "°", "rms_heading_deg")
STEADY = VariedFigure("steady_rms_heading_deg", "RMS heading after 20 s", "°", "steady_rms_heading_deg", is_headline=False)
FINAL = VariedFigure("final_heading_deg", "final heading", "°", "final_heading_deg")
ROLL_BACK = VariedFigure("roll_back_m", "roll-back", "m", "roll_back_m")
DRIFT = VariedFigure("lateral_m", "lateral drift", "m", "lateral_m")
PASSENGER = VariedFigure("passenger_m_s2", "passenger's acceleration", "m/s²", "passenger_max_m_s2", 1.5)
MARGIN = VariedFigure("margin_deg", "tip-over margin", "°", "min_stability_margin_deg", is_headline=False)
PITCH_RATE = VariedFigure("pitch_rate_deg_s", "largest pitch rate", "°/s", "max_pitch_rate_deg_s")
ABREAST = "passenger_lateral_m_s2"
TURN_FIGURES = (
    RMS,
    ROLL_BACK,
    PASSENGER,
    VariedFigure("settle_s", "settling to ±2°", "s", "settle_s"),
    STEADY,
    replace(DRIFT, is_headline=False),
    VariedFigure("lateral_m_s2", "passenger's lateral acceleration", "m/s²", ABREAST, is_headline=False),
    MARGIN,
    VariedFigure("belt_force_n", "largest belt force", "N", "max_belt_force_n", is_headline=False),
    VariedFigure("airborne_share", "share of time without contact", "", "airborne_share", is_headline=False),
)
TRAVERSAL_FIGURES = (
    replace(PITCH_RATE, key="max_pitch_rate_deg_s", target=15.0),
    replace(PASSENGER, key="passenger_max_m_s2"),
    replace(MARGIN, key="min_stability_margin_deg", target=7.0, at_least=True, is_headline=True),
    VariedFigure("seat_max_deg", "largest seat error", "°", "seat_max_deg", 3.0),
)
LUG_FIGURES = (ROLL_BACK, replace(PASSENGER, target=None), PITCH_RATE, MARGIN, replace(RMS, is_headline=False))
PRINTED_FIGURES = tuple(replace(item, is_headline=False) for item in (RMS, FINAL, ROLL_BACK))
SEAT_FIGURES = (
    VariedFigure("steady_error_deg", "steady seat error", "°", "steady_error_deg"),
    VariedFigure("settle_s", "settling of the seat to ±1°", "s", "settle_s", is_headline=False),
    VariedFigure("max_error_deg", "largest seat error after settling", "°", "max_error_deg", is_headline=False),
)


def of_run(
    run: str, part: str, where: str, figures: Sequence[VariedFigure], conditions: str = "one seed", **targets: float
) -> list[VariedFigure]:
    """Return the figures of one run under a part of ``results.json``; ``targets`` sets the target of a figure by name."""
    return [
        replace(
            item,
            key=f"{part}/{item.key}",
            what=f"{item.what}, {where}",
            runs=(run,),
            conditions=conditions,
            target=targets.get(item.key, item.target),
        )
        for item in figures
    ]


def of_slope(slope_deg: int, roll_back_m: float) -> list[VariedFigure]:
    """Return the figures of Table II on a slope with Table I's friction."""
    where = f"{slope_deg}°, friction 0.62-0.5"
    figures = [replace(item, is_headline=item.is_headline and item is not PASSENGER) for item in TURN_FIGURES]
    return of_run(f"turn-{slope_deg}", f"table2/0.62-0.5/{slope_deg}", where, figures, FROM_START, roll_back_m=roll_back_m)


def of_dead_zone(heading_deg: int, difference_m_s: float) -> VariedFigure:
    """Return the yaw rate at one heading and belt difference."""
    return VariedFigure(
        f"dead_zone/28/{heading_deg}/{difference_m_s:g}/yaw_rate_deg_s",
        f"yaw rate at {heading_deg}° of heading, belts {difference_m_s:g} m/s apart, 28°",
        "°/s",
        f"yaw_rate_{heading_deg}_{difference_m_s:g}",
        is_headline=False,
        runs=("dead-zone-28",),
    )


PAPER_TURNS = {"runs": TURNS, "conditions": FROM_START}
SLIDE = {"runs": ("slide-32.4",)}
MODEL = {"runs": ("excite-20",)}
VAF, POLE = "fig08/20/yaw_rate_vaf_percent", "fig08/20/yaw_rate_pole"
FIGURES = (
    replace(
        RMS,
        key="table2/0.62-0.5/rms_heading_deg",
        what="RMS heading over 80 s, mean of 25°, 28°, 30°, friction 0.62-0.5",
        target=2.3,
        over_runs=mean,
        **PAPER_TURNS,
    ),
    replace(
        RMS,
        key="table2/0.9-0.5/rms_heading_deg",
        what="RMS heading over 80 s at 28°, friction 0.9-0.5",
        runs=(GOOD_GRIP_TURN,),
        target=2.0,
        conditions=f"28°, {FROM_START}",
    ),
    *of_slope(25, 0.02),
    *of_slope(28, 0.05),
    *of_slope(30, 0.15),
    *of_run(GOOD_GRIP_TURN, "table2/0.9-0.5/28", "28°, friction 0.9-0.5", TURN_FIGURES, FROM_START),
    replace(
        PASSENGER,
        key="table2/0.62-0.5/passenger_m_s2",
        what="passenger's acceleration, largest of 25°, 28°, 30°, friction 0.62-0.5",
        **PAPER_TURNS,
    ),
    replace(
        STEADY,
        key="table2/0.62-0.5/steady_rms_heading_deg",
        what="RMS heading after 20 s, mean of 25°, 28°, 30°, friction 0.62-0.5",
        over_runs=mean,
        **PAPER_TURNS,
    ),
    *of_run("turn-28-rollback", "table2_roll_back_allowed/28", "28°, roll-back allowed", TURN_FIGURES, FROM_START),
    *of_run(
        "straight-28",
        "fig09/28",
        "closed loop straight up 28°",
        (RMS, DRIFT),
        "60 s, one seed",
        rms_heading_deg=0.15,
        lateral_m=0.15,
    ),
    *of_run("straight-28-open", "fig09_open/28", "open loop straight up 28°", (RMS, FINAL, DRIFT), "60 s, one seed"),
    VariedFigure(
        VAF, "model at 20°: VAF of the yaw rate, one step ahead", "%", "yaw_rate_vaf_percent", 85.0, at_least=True, **MODEL
    ),
    VariedFigure(POLE, "model at 20°: dominant pole of the yaw rate, discrete at 4 Hz", "", "yaw_rate_pole", **MODEL),
    *(of_dead_zone(heading, difference) for heading in HEADINGS_DEG for difference in DIFFERENCES_M_S),
    *of_run("as-printed-28", "literal/28", "28°, controller as printed", PRINTED_FIGURES, FROM_START),
    *of_run("seat-28", "fig11/28", "28°", SEAT_FIGURES),
    VariedFigure(
        "fig05/28/robust_heading_deg",
        "error of the robust heading on the frame of Fig. 5",
        "°",
        "robust_error_deg",
        is_headline=False,
        runs=("frame-28",),
        conditions="one frame",
    ),
    *of_run("up-28", "up-28", "up-28", TRAVERSAL_FIGURES),
    *of_run("down-28", "down-28", "down-28", TRAVERSAL_FIGURES),
    *(
        figure
        for slope in SLOPES_DEG
        for figure in of_run(
            f"turn-{slope}-lugs", f"lugs/turn-{slope}", f"turn at {slope}° with lugs 15/80", LUG_FIGURES, "4 s, one seed"
        )
    ),
    *of_run("up-28-lugs", "lugs/up-28", "up-28 with lugs 15/80", LUG_FIGURES),
    VariedFigure("creep/28/mm_min", "creep of a braked chair at 28°", "mm/min", "creep_mm_min", 0.01, runs=("creep-28",)),
    VariedFigure(
        "slide/32.4/speed_m_s", "speed of a braked chair that slides on 32.4°, after 3 s", "m/s", "slide_speed_m_s", **SLIDE
    ),
    VariedFigure(
        "slide/32.4/gap_m_s",
        "speed after 3 s on 32.4°, less Coulomb's g t (sin β - μ cos β)",
        "m/s",
        "slide_gap_m_s",
        0.011,  # 3 % of the nominal speed
        **SLIDE,
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
