"""The report: one HTML file that needs nothing else, drawn from the files of a folder.

Text is escaped by the template engine; figures are inline SVG of our own making; a content security policy allows no
script and no request.
"""

import base64
import json
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from treadline.errors import SettingsError
from treadline.io.runs import read_series
from treadline.models import read_json, write_whole
from treadline.report import figures
from treadline.report.compare import comparisons

TEMPLATES = Path(__file__).parent / "templates"
STAGES = (
    "(a) depth image",
    "(b) Canny edges",
    "(c) edges without abrupt depth, lines",
    "(d) lines of near-zero slope",
    "(e) merged lines, most frequent slope",
    "(f) localisation",
)


def write_report(folder: Path) -> Path:
    """Write ``report.html`` of a reproduce folder, or of one run's folder.

    Raises:
        SettingsError: If the folder holds neither.
    """
    if (folder / "results.json").exists():
        return _whole(folder)
    if (folder / "result.json").exists():
        return _single(folder)
    raise SettingsError(f"{folder}: no results.json (reproduce) and no result.json (climb, excite); nothing to report")


def _whole(folder: Path) -> Path:
    results = read_json(folder / "results.json")
    runs = folder / "runs"

    def with_series(rows: list[dict[str, Any]]) -> list[tuple[dict[str, Any], figures.Series]]:
        return [(row, read_series(runs / row["run"])) for row in rows]

    straight, turned = with_series(results["fig09"]), with_series(results["fig10"])
    drawn = {
        "fig08": figures.impulse(results["fig08"]["impulse"]),
        "singular-values": figures.singular_values(results["fig08"]["slopes"]),
        "fig09": figures.straight(straight),
        "fig10": figures.turns(turned),
        "table2": figures.table_two(results["table2"], results["table2_roll_back_allowed"]),
        "margins": figures.margins(turned),
        "fig11": figures.seat(read_series(runs / results["fig11"]["run"])),
    }
    return _render(
        folder,
        "reproduce.html.j2",
        drawn,
        r=results,
        rows=comparisons(results),
        stages=_stages(folder / "figures"),
        versions=json.dumps(results["versions"]),
    )


def _single(folder: Path) -> Path:
    result = read_json(folder / "result.json")
    manifest = read_json(folder / "manifest.json")
    return _render(
        folder,
        "run.html.j2",
        {"run": figures.single_run(read_series(folder))},
        result=result,
        manifest=manifest,
        settings=json.dumps(manifest["settings"], indent=1),
    )


def _render(folder: Path, template: str, drawn: dict[str, Figure], **values: Any) -> Path:
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["number"] = _number
    inline = {}
    for name, figure in drawn.items():
        text = figures.svg_of(figure)
        write_whole(folder / "figures" / f"{name}.svg", '<?xml version="1.0" encoding="utf-8"?>\n' + text)
        # Our own drawing, no user's text in it but numbers: the only markup that is not escaped.
        inline[name] = Markup(_own_ids(text, name))  # noqa: S704
    path = folder / "report.html"
    write_whole(path, environment.get_template(template).render(svg=inline, **values))
    return path


def _own_ids(svg: str, name: str) -> str:
    """Prefix ids, so that two drawings in one page do not share definitions."""
    return svg.replace('id="', f'id="{name}-').replace("url(#", f"url(#{name}-").replace('href="#', f'href="#{name}-')


def _stages(folder: Path) -> list[tuple[str, str]]:
    found = []
    for number, caption in enumerate(STAGES, start=1):
        path = folder / f"fig05-{number}.png"
        if path.exists():
            found.append((caption, "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode()))
    return found


def _number(value: Any, digits: int = 2) -> str:
    return "–" if value is None else f"{value:.{digits}f}"
