"""Change of a figure with step size, contact stiffness and friction, as words for its row."""

from collections.abc import Mapping
from dataclasses import replace

from treadline.report.channels import suffix
from treadline.report.comparison import Comparison
from treadline.report.results import Moves

SOURCES = (("step", "step size"), ("stiffness", "stiffness"), ("friction", "friction ±20 %"))


def with_moves(row: Comparison, sensitivity: Mapping[str, Moves]) -> Comparison:
    """Return the row with the sensitivity of its figure, where the budget has the figure."""
    moves = sensitivity.get(row.figure)
    return row if moves is None else replace(row, sensitivity=moves_text(moves))


def moves_text(moves: Moves) -> str:
    """Return the changes as words, with the variations that lose the figure or its target."""
    values = [(getattr(moves, name), source) for name, source in SOURCES]
    known = ", ".join(f"±{_two_digits(value)}{suffix(moves.unit)} with {source}" for value, source in values if value is not None)
    where = f" ({moves.conditions})" if moves.conditions else ""
    parts = [f"{known}{where}"] if known else []
    if moves.lost:
        parts.append(f"no figure with {', '.join(moves.lost)}")
    if moves.exceeded:
        parts.append(f"margin exceeded with {', '.join(moves.exceeded)}")
    if moves.missed:
        parts.append(f"target missed with {', '.join(moves.missed)}")
    return "; ".join(parts)


def _two_digits(value: float) -> str:
    """Return a value with two digits, without an exponent; below 0.001 it is 0.000."""
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}" if value >= 0.001 else f"{value:.3f}"
