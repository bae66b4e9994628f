"""Report page of a campaign: one self-contained HTML file."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from treadline.campaign.frontier import ARRIVED, frontier_of
from treadline.campaign.sampled_run import Row
from treadline.campaign.summary import has_rms
from treadline.core.models import write_whole
from treadline.report.labels import score_name, score_unit, suffix

TEMPLATES = (Path(__file__).parent / "templates", Path(__file__).parents[1] / "report" / "templates")
"""Template folders of the campaign and of the report base page."""
COLOURS = {
    "arrived": "#009e73",
    "held": "#e69f00",
    "refused": "#56b4e9",
    "end_of_flight": "#0072b2",
    "time_up": "#999999",
    "fell": "#e4002b",
}
OTHER = "#8a4fa0"
WIDTH, HEIGHT = 640.0, 320.0
LEFT, RIGHT, TOP, BOTTOM = 64.0, 16.0, 12.0, 32.0
"""Margins of the chart for ticks [px]; the axis titles are text of the page."""
DOT, FELL_DOT = 3.0, 6.0
"""Radii of the dots [px]; falls are larger and drawn last."""
TICKS_MOST = 7
FIRST_CHOICE = "stair.slope_deg"
"""Preferred key of the horizontal axis: the slope has the strongest effect on the verdict."""


def write_page(
    folder: Path,
    summary: Mapping[str, Any],
    times: Mapping[str, Any],
    rows: Sequence[Row],
    drawn: Sequence[str],
    views: Mapping[int, str] | None = None,
) -> Path:
    """Write ``report.html`` of a campaign.

    Args:
        drawn: Columns that are not scores.
        views: Side views of the worst runs as SVG, by run index.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined)
    page = environment.get_template("sweep.html.j2").render(
        summary=summary,
        times=times,
        chart=_chart(rows, drawn, summary["score"]),
        frontier=_frontier(rows, drawn),
        views={index: Markup(view) for index, view in (views or {}).items()},  # noqa: S704 - drawn by this package
        colours=COLOURS | {"other": OTHER},
        up=score_name(summary["score"]),
        up_with_unit=_with_unit(score_name(summary["score"]), _unit(summary["score"])),
        scores=[_score_row(name, score) for name, score in summary["scores"].items()],
    )
    write_whole(folder / "report.html", page)
    return folder / "report.html"


def _chart(rows: Sequence[Row], drawn: Sequence[str], score: str) -> dict[str, Any] | None:
    """Return the scatter chart of the score over a drawn key; None if no drawn number varies."""
    scored = [row for row in rows if _is_number(row.get(score))]
    key = next((key for key in (FIRST_CHOICE, *drawn) if len(set(_numbers(scored, key))) > 1), None)
    if key is None:
        return None
    found = [row for row in scored if _is_number(row.get(key))]
    x, y = _numbers(found, key), _numbers(found, score)
    across, up = _Axis.of(x), _Axis.of(y)
    inner = (WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM)
    dots: list[dict[str, Any]] = [
        {
            "x": LEFT + inner[0] * across.share(at),
            "y": TOP + inner[1] * (1.0 - up.share(reached)),
            "r": FELL_DOT if row["verdict"] == "fell" else DOT,
            "colour": COLOURS.get(row["verdict"], OTHER),
            "name": f"{row['index']:04d} {row['verdict']}: {reached:.3g}{suffix(_unit(score))} at {at:.3g}{suffix(_unit(key))}",
        }
        for row, at, reached in zip(found, x, y, strict=True)
    ]
    dots.sort(key=lambda dot: dot["r"])
    return {
        "dots": dots,
        "frame": {"x": LEFT, "y": TOP, "width": inner[0], "height": inner[1]},
        "size": (WIDTH, HEIGHT),
        "across": [(LEFT + inner[0] * across.share(tick), f"{tick:g}") for tick in across.ticks],
        "up": [(TOP + inner[1] * (1.0 - up.share(tick)), f"{tick:g}") for tick in up.ticks],
        "key": key,
        "titles": (_with_unit(key, _unit(key)), _with_unit(score_name(score), _unit(score))),
    }


def _frontier(rows: Sequence[Row], drawn: Sequence[str]) -> dict[str, Any] | None:
    """Return the chart of all runs over the two quantities that separate failures best, with the contours of their share."""
    found = frontier_of(rows, drawn)
    if found is None:
        return None
    across, up = (_Axis.of(found.points[:, k].tolist()) for k in (0, 1))
    inner = (WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM)

    def place(x: float, y: float) -> tuple[float, float]:
        return LEFT + inner[0] * across.share(x), TOP + inner[1] * (1.0 - up.share(y))

    units = [suffix(_unit(key)) for key in found.keys]
    dots: list[dict[str, Any]] = []
    for (x, y), index, verdict in zip(found.points.tolist(), found.index, found.verdicts, strict=True):
        at = place(x, y)
        name = f"{index:04d} {verdict}: {x:.3g}{units[0]}, {y:.3g}{units[1]}"
        colour, r = COLOURS.get(verdict, OTHER), DOT if verdict in ARRIVED else FELL_DOT - 1.0
        dots.append({"x": at[0], "y": at[1], "r": r, "colour": colour, "name": name})
    lines = {
        level: "".join("M{:.1f} {:.1f}L{:.1f} {:.1f}".format(*place(*segment[:2]), *place(*segment[2:])) for segment in segments)
        for level, segments in found.contours.items()
    }
    return {
        "dots": sorted(dots, key=lambda dot: dot["r"]),
        "lines": {level: line for level, line in lines.items() if line},
        "frame": {"x": LEFT, "y": TOP, "width": inner[0], "height": inner[1]},
        "size": (WIDTH, HEIGHT),
        "across": [(LEFT + inner[0] * across.share(tick), f"{tick:g}") for tick in across.ticks],
        "up": [(TOP + inner[1] * (1.0 - up.share(tick)), f"{tick:g}") for tick in up.ticks],
        "titles": [_with_unit(key, _unit(key)) for key in found.keys],
        "names": found.keys,
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class _Axis:
    """Axis range with a margin, and round tick values."""

    low: float
    high: float
    ticks: list[float]

    @classmethod
    def of(cls, values: Sequence[float]) -> "_Axis":
        least, most = min(values), max(values)
        room = 0.05 * (most - least) or max(0.05 * abs(most), 0.5)
        low, high = least - room, most + room
        rough = (high - low) / TICKS_MOST
        decade = 10.0 ** math.floor(math.log10(rough))
        step = next(decade * times for times in (1, 2, 5, 10) if decade * times >= rough)
        return cls(
            low=low, high=high, ticks=[round(k * step, 12) for k in range(math.ceil(low / step), math.floor(high / step) + 1)]
        )

    def share(self, value: float) -> float:
        return (value - self.low) / (self.high - self.low)


def _score_row(name: str, score: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of the score table, with display name and without RMS where it has no meaning."""
    words = ("rms", "p5", "median", "p95", "worst")
    figures = ["–" if word == "rms" and not has_rms(name) else f"{score[word]:.3g}" for word in words]
    return {"name": score_name(name), "key": name, "unit": _unit(name), "figures": figures} | {
        word: score[word] for word in ("count", "worst_run")
    }


def _numbers(rows: Sequence[Row], key: str) -> list[float]:
    return [float(row[key]) for row in rows if _is_number(row.get(key))]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _unit(key: str) -> str:
    """Return the unit from the suffix of a key; list items have the unit of the list."""
    return score_unit(key) or score_unit(key.rstrip(".0123456789"))


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name
