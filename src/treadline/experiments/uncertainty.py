"""Uncertainty budget: how far each source moves each headline figure, beside the margin of the figure to its target."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from treadline.experiments.variations import NOMINAL_VARIATION, SOURCES, SUMMED, VARIATIONS

Results = Mapping[str, Mapping[str, Any]]
"""Outcomes of one variation by run name."""
GROUP_OF = {item.name: item.group for item in VARIATIONS}
TURNS = ("turn-25", "turn-28", "turn-30")
GOOD_GRIP_TURN = "turn-28-mu0.9-0.5"
FROM_START = "from +30°, one seed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One headline figure: the runs it is read from, and its target."""

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
    """Where the moves are measured, in short: a report's row may rest on more starts and seeds."""

    def value(self, outcomes: Results) -> float | None:
        """Return the figure, or None where one of its runs has none."""
        found = [outcomes[name]["figures"].get(self.score) if name in outcomes else None for name in self.runs]
        known = [value for value in found if value is not None]
        return self.over_runs(known) if len(known) == len(self.runs) else None


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _of_turn(run: str, slope: int, friction: str, roll_back_m: float | None) -> tuple[Figure, ...]:
    rows = (
        ("rms_heading_deg", "rms_heading_deg", "RMS heading", "°", None),
        ("roll_back_m", "roll_back_m", "roll-back", "m", roll_back_m),
        ("passenger_m_s2", "passenger_max_m_s2", "passenger's acceleration", "m/s²", 1.5),
        ("settle_s", "settle_s", "settling to ±2°", "s", None),
    )
    return tuple(
        Figure(
            key=f"table2/{friction}/{slope}/{name}",
            what=f"{what}, {slope}°, friction {friction}",
            unit=unit,
            runs=(run,),
            score=score,
            target=target,
            conditions=FROM_START,
        )
        for name, score, what, unit, target in rows
    )


def _of_traversal(run: str) -> tuple[Figure, ...]:
    rows = (
        ("max_pitch_rate_deg_s", "largest pitch rate", "°/s", 15.0, False),
        ("passenger_max_m_s2", "passenger's acceleration", "m/s²", 1.5, False),
        ("min_stability_margin_deg", "tip-over margin", "°", 7.0, True),
        ("seat_max_deg", "largest seat error", "°", 3.0, False),
    )
    return tuple(
        Figure(key=f"{run}/{score}", what=f"{what}, {run}", unit=unit, runs=(run,), score=score, target=target, at_least=least)
        for score, what, unit, target, least in rows
    )


FIGURES = (
    Figure(
        key="table2/0.62-0.5/rms_heading_deg",
        what="RMS heading over 80 s, mean of 25°, 28°, 30°, friction 0.62-0.5",
        unit="°",
        runs=TURNS,
        score="rms_heading_deg",
        target=2.3,
        over_runs=_mean,
        conditions=FROM_START,
    ),
    Figure(
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
        for slope, back in ((25, 0.02), (28, 0.05), (30, 0.15))
        for figure in _of_turn(f"turn-{slope}", slope, "0.62-0.5", back)
    ),
    *_of_turn(GOOD_GRIP_TURN, 28, "0.9-0.5", None),
    Figure(
        key="table2/0.62-0.5/passenger_m_s2",
        what="passenger's acceleration, largest of 25°, 28°, 30°, friction 0.62-0.5",
        unit="m/s²",
        runs=TURNS,
        score="passenger_max_m_s2",
        target=1.5,
        conditions=FROM_START,
    ),
    Figure(
        key="fig09/28/rms_heading_deg",
        what="closed loop straight up 28°, RMS heading",
        unit="°",
        runs=("straight-28",),
        score="rms_heading_deg",
        target=0.15,
    ),
    Figure(
        key="fig09/28/lateral_m",
        what="closed loop straight up 28°, lateral drift",
        unit="m",
        runs=("straight-28",),
        score="lateral_m",
        target=0.15,
    ),
    Figure(
        key="fig08/20/yaw_rate_vaf_percent",
        what="model at 20°: VAF of the yaw rate, one step ahead",
        unit="%",
        runs=("excite-20",),
        score="yaw_rate_vaf_percent",
        target=85.0,
        at_least=True,
    ),
    Figure(
        key="fig08/20/yaw_rate_pole",
        what="model at 20°: dominant pole of the yaw rate, discrete at 4 Hz",
        unit="",
        runs=("excite-20",),
        score="yaw_rate_pole",
    ),
    *_of_traversal("up-28"),
    *_of_traversal("down-28"),
    Figure(
        key="creep/28/mm_min",
        what="creep of a braked chair at 28°",
        unit="mm/min",
        runs=("creep-28",),
        score="creep_mm_min",
        target=0.01,
    ),
    Figure(
        key="slide/32.4/speed_m_s",
        what="speed of a braked chair that slides on 32.4°, after 3 s",
        unit="m/s",
        runs=("slide-32.4",),
        score="slide_speed_m_s",
    ),
    Figure(
        key="slide/32.4/gap_m_s",
        what="the same less Coulomb's g t (sin β - μ cos β)",
        unit="m/s",
        runs=("slide-32.4",),
        score="slide_gap_m_s",
        target=0.011,  # 3 % of the nominal speed
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """The budget of one figure."""

    figure: Figure
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


def budget(outcomes: Mapping[str, Results], figures: Sequence[Figure] = FIGURES) -> list[Row]:
    """Return one row per figure that the nominal runs have, from outcomes by variation and run."""
    rows = [_row(figure, outcomes) for figure in figures]
    return [row for row in rows if row.nominal is not None]


def _row(figure: Figure, outcomes: Mapping[str, Results]) -> Row:
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
    return Row(figure=figure, nominal=nominal, moves=ordered, values=values)
