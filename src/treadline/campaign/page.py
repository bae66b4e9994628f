"""The campaign's page: one HTML file that needs nothing else."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from treadline.campaign.run import Row
from treadline.models import write_whole
from treadline.report.channels import channel, suffix

TEMPLATES = (Path(__file__).parent / "templates", Path(__file__).parents[1] / "report" / "templates")
"""Ours, and the base page of all reports."""
COLOURS = {"arrived": "#009e73", "held": "#e69f00", "refused": "#56b4e9", "time_up": "#777777"}
OTHER = "#d55e00"
WIDTH, HEIGHT, EDGE = 640.0, 300.0, 46.0
FIRST_CHOICE = "stair.slope_deg"
"""Goes across wherever it varies: what most decides whether a chair arrives."""


def write_page(
    folder: Path, summary: Mapping[str, Any], times: Mapping[str, Any], rows: Sequence[Row], drawn: Sequence[str]
) -> Path:
    """Write ``report.html`` of a campaign; ``drawn`` names the columns that are no scores."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined)
    page = environment.get_template("sweep.html.j2").render(
        summary=summary, times=times, chart=_chart(rows, drawn, summary["score"]), colours=COLOURS | {"other": OTHER}
    )
    write_whole(folder / "report.html", page)
    return folder / "report.html"


def _chart(rows: Sequence[Row], drawn: Sequence[str], score: str) -> dict[str, Any] | None:
    """Return where each run's dot stands, something drawn across and score up; None where nothing drawn varies."""
    scored = [row for row in rows if _is_number(row.get(score))]
    key = next((key for key in (FIRST_CHOICE, *drawn) if len(set(_numbers(scored, key))) > 1), None)
    if key is None:
        return None
    found = [row for row in scored if _is_number(row.get(key))]
    x, y, unit = _numbers(found, key), _numbers(found, score), _unit(key)
    dots = [
        {
            "x": EDGE + (WIDTH - 2 * EDGE) * _share(across, x),
            "y": HEIGHT - EDGE - (HEIGHT - 2 * EDGE) * _share(up, y),
            "colour": COLOURS.get(row["verdict"], OTHER),
            "name": f"{row['index']:04d} {row['verdict']}: {up:.3g} at {across:.3g}{unit}",
        }
        for row, across, up in zip(found, x, y, strict=True)
    ]
    ends = {"x": (min(x), max(x)), "y": (min(y), max(y))}
    axes = {"across": key, "up": score, "unit": unit}
    return {"dots": dots, "ends": ends, "width": WIDTH, "height": HEIGHT, "edge": EDGE} | axes


def _numbers(rows: Sequence[Row], key: str) -> list[float]:
    return [float(row[key]) for row in rows if _is_number(row.get(key))]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _unit(key: str) -> str:
    """Return the unit that a key's name ends in, as it follows a number; a list's items have the list's."""
    return suffix(channel(key.rstrip(".0123456789")).unit or "")


def _share(value: float, values: Sequence[float]) -> float:
    low, high = min(values), max(values)
    return (value - low) / (high - low) if high > low else 0.5
