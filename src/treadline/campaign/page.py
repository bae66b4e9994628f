"""The campaign's page: one HTML file that needs nothing else."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from treadline.campaign.run import Row
from treadline.models import write_whole

TEMPLATES = (Path(__file__).parent / "templates", Path(__file__).parents[1] / "report" / "templates")
"""Ours, and the base page of all reports."""
COLOURS = {"arrived": "#009e73", "held": "#e69f00", "refused": "#56b4e9", "time_up": "#777777"}
OTHER = "#d55e00"
WIDTH, HEIGHT, EDGE = 640.0, 300.0, 46.0
ACROSS = "stair.slope_deg"


def write_page(folder: Path, summary: Mapping[str, Any], times: Mapping[str, Any], rows: Sequence[Row]) -> Path:
    """Write ``report.html`` of a campaign."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined)
    page = environment.get_template("sweep.html.j2").render(
        summary=summary, times=times, chart=_chart(rows, summary["score"]), colours=COLOURS | {"other": OTHER}
    )
    write_whole(folder / "report.html", page)
    return folder / "report.html"


def _chart(rows: Sequence[Row], score: str) -> dict[str, Any] | None:
    """Return where each run's dot stands, slope across and score up; None where there is nothing to show."""
    found = [row for row in rows if all(isinstance(row.get(name), int | float) for name in (ACROSS, score))]
    if not found:
        return None
    x, y = ([float(row[name]) for row in found] for name in (ACROSS, score))
    dots = [
        {
            "x": EDGE + (WIDTH - 2 * EDGE) * _share(across, x),
            "y": HEIGHT - EDGE - (HEIGHT - 2 * EDGE) * _share(up, y),
            "colour": COLOURS.get(row["verdict"], OTHER),
            "name": f"{row['index']:04d} {row['verdict']}: {up:.3g} at {across:.3g}°",
        }
        for row, across, up in zip(found, x, y, strict=True)
    ]
    ends = {"x": (min(x), max(x)), "y": (min(y), max(y))}
    return {"dots": dots, "ends": ends, "width": WIDTH, "height": HEIGHT, "edge": EDGE, "across": ACROSS, "up": score}


def _share(value: float, values: Sequence[float]) -> float:
    low, high = min(values), max(values)
    return (value - low) / (high - low) if high > low else 0.5
