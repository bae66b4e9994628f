"""How far the headline figures move, as measured by ``benchmarks/uncertainty.py``: attached to ``results.json``.

The moves are data of the package, made by a benchmark of 25 minutes: ``reproduce`` does not make them anew.
"""

from pathlib import Path
from typing import Any

from treadline.models import read_json

SENSITIVITY = Path(__file__).parents[1] / "data" / "sensitivity.json"
KEYS = ("step", "stiffness", "friction")
"""Sources that ``results.json`` shows; the file has all of them."""


def read_sensitivity(path: Path = SENSITIVITY) -> dict[str, dict[str, Any]]:
    """Return the moves by figure; the first part of a figure's key is the part of ``results.json``."""
    return dict(read_json(path))


def shown(figures: dict[str, dict[str, Any]], under: str) -> dict[str, dict[str, Any]]:
    """Return the moves of the figures directly under a key: by name, with step, stiffness, friction and what is lost."""
    keys = (*KEYS, "lost", "exceeded", "missed")
    return {
        key.removeprefix(f"{under}/"): {name: value.get(name) for name in keys}
        for key, value in figures.items()
        if key.startswith(f"{under}/") and "/" not in key.removeprefix(f"{under}/")
    }


def with_sensitivity(results: dict[str, Any], figures: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Return the values of ``results.json`` with ``sensitivity`` at each figure for which there is one, and as a whole.

    A budget is made on the slopes and frictions of its runs; rows of others stay without.
    """
    table2 = [row | {"sensitivity": shown(figures, f"table2/{_friction(row)}/{row['slope_deg']:g}")} for row in results["table2"]]
    fig09 = [
        row | {"sensitivity": shown(figures, f"fig09/{row['slope_deg']:g}") if row["loop"] == "closed" else {}}
        for row in results["fig09"]
    ]
    fig08 = results["fig08"] | {"sensitivity": shown(figures, f"fig08/{results['fig08']['slope_deg']:g}")}
    return results | {"table2": table2, "fig09": fig09, "fig08": fig08, "sensitivity": figures}


def _friction(row: dict[str, Any]) -> str:
    return "-".join(f"{value:g}" for value in row["friction"])
