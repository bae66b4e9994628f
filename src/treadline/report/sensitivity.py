"""How far a figure moves with step size, contact stiffness and friction, as words for the conditions of its row."""

from collections.abc import Mapping
from dataclasses import replace

from treadline.report.comparison import Comparison, written
from treadline.report.results import Moves

SOURCES = (("step", "step size"), ("stiffness", "stiffness"), ("friction", "friction ±20 %"))


def with_moves(row: Comparison, sensitivity: Mapping[str, Moves]) -> Comparison:
    """Return the row, with its figure's moves among the conditions where the budget has the figure."""
    moves = sensitivity.get(row.figure)
    return row if moves is None else replace(row, conditions="; ".join(part for part in (row.conditions, told(moves)) if part))


def told(moves: Moves) -> str:
    """Return the moves as words, and whether one of them exceeds the margin to the target."""
    values = [(getattr(moves, name), source) for name, source in SOURCES]
    known = ", ".join(f"±{written(value, moves.unit)} with {source}" for value, source in values if value is not None)
    where = f" ({moves.conditions})" if moves.conditions else ""
    parts = [f"moves by {known}{where}"] if known else []
    if moves.lost:
        parts.append(f"no figure with {', '.join(moves.lost)}")
    if moves.exceeded:
        parts.append(f"more than its margin with {', '.join(moves.exceeded)}")
    if moves.missed:
        parts.append(f"target missed with {', '.join(moves.missed)}")
    return "; ".join(parts)
