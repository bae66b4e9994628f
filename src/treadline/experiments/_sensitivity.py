"""Sensitivity of the figures of ``results.json`` to step size, contact stiffness and friction, as stored with the package.

``benchmarks/uncertainty.py`` measures the changes; ``reproduce`` attaches them and does not measure them anew.
A figure that the budget does not vary has the changes of the nearest figure that it does, labelled with its conditions.
"""

from typing import Any

from treadline.core.files import DATA
from treadline.experiments.plan import CONTROLLER_GROUND, FIG10_SLOPE, GROUNDS, SLOPES_DEG, Ground

SENSITIVITY = DATA / "sensitivity.json"
MAIN_SOURCES = ("step", "stiffness", "friction")
"""Sources of uncertainty next to each figure of ``results.json``."""
Changes = dict[str, dict[str, Any]]
"""Changes by figure: the first part of a figure's key is the part of ``results.json``."""

VARIED_SLOPE = f"measured at {FIG10_SLOPE}°"
NEAREST = {
    **{
        f"{part}/{slope}": (f"{part}/{FIG10_SLOPE}", VARIED_SLOPE)
        for part in ("table2/0.9-0.5", "table2_roll_back_allowed", "fig09", "fig09_open")
        for slope in SLOPES_DEG
        if slope != FIG10_SLOPE
    },
    **{
        f"fig08/{ground.name}": (
            f"fig08/{CONTROLLER_GROUND.name}",
            f"measured at {CONTROLLER_GROUND.slope_deg}°, friction 0.62/0.5",
        )
        for ground in GROUNDS
        if ground != CONTROLLER_GROUND
    },
    "table2/0.9-0.5": (f"table2/0.9-0.5/{FIG10_SLOPE}", VARIED_SLOPE),
}
"""Key of a part whose figures are not varied, key of the nearest part whose figures are, and the label of its conditions."""


def with_nearest(measured: Changes) -> Changes:
    """Return the changes, completed by those of the nearest varied figure; margins and targets are those of the measured figure."""
    completed = dict(measured)
    for part, (nearest, label) in NEAREST.items():
        for name in _names(measured, nearest):
            changes = measured[f"{nearest}/{name}"]
            conditions = ", ".join(text for text in (label, changes.get("conditions", "")) if text)
            completed.setdefault(
                f"{part}/{name}", changes | {"conditions": conditions, "target": None, "exceeded": [], "missed": []}
            )
    return completed


def shown(figures: Changes, under: str) -> Changes:
    """Return the changes of the figures directly under a key, by name: by step, stiffness, friction, and the variations without."""
    keys = (*MAIN_SOURCES, "lost", "exceeded", "missed", "conditions")
    return {name: {key: figures[f"{under}/{name}"].get(key) for key in keys} for name in _names(figures, under)}


def _names(figures: Changes, under: str) -> list[str]:
    """Return the names of the figures directly under a key."""
    inner = (key.removeprefix(f"{under}/") for key in figures if key.startswith(f"{under}/"))
    return [name for name in inner if "/" not in name]


def with_sensitivity(results: dict[str, Any], figures: Changes) -> dict[str, Any]:
    """Return the values of ``results.json`` with ``sensitivity`` at each row of each figure, and as a whole."""

    def rows(part: str, key: Any) -> list[dict[str, Any]]:
        return [row | {"sensitivity": shown(figures, key(row))} for row in results[part]]

    def of_model(model: dict[str, Any]) -> dict[str, Any]:
        ground = Ground(slope_deg=round(model["slope_deg"]), friction=tuple(model["friction"]))
        return model | {"sensitivity": shown(figures, f"fig08/{ground.name}")}

    fig08 = of_model(results["fig08"])
    return results | {
        "table2": rows("table2", lambda row: f"table2/{_friction(row)}/{row['slope_deg']:g}"),
        "table2_roll_back_allowed": rows("table2_roll_back_allowed", lambda row: f"table2_roll_back_allowed/{row['slope_deg']:g}"),
        "fig05": results["fig05"] | {"sensitivity": shown(figures, f"fig05/{FIG10_SLOPE}")},
        "fig08": fig08 | {"slopes": [of_model(model) for model in fig08["slopes"]]},
        "fig09": rows("fig09", lambda row: f"fig09{'' if row['loop'] == 'closed' else '_open'}/{row['slope_deg']:g}"),
        "fig10": rows("fig10", lambda row: f"table2/0.62-0.5/{row['slope_deg']:g}"),
        "fig11": results["fig11"] | {"sensitivity": shown(figures, f"fig11/{FIG10_SLOPE}")},
        "dead_zone": rows(
            "dead_zone", lambda row: f"dead_zone/{row['slope_deg']:g}/{row['heading_deg']:g}/{row['difference_m_s']:g}"
        ),
        "literal": results["literal"] | {"sensitivity": shown(figures, f"literal/{FIG10_SLOPE}")},
        "lugs": rows("lugs", lambda row: f"lugs/{row['course']}" if row["lug"] != "none" else ""),
        "sensitivity": figures,
    }


def _friction(row: dict[str, Any]) -> str:
    return "-".join(f"{value:g}" for value in row["friction"])
