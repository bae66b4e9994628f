"""Chairs with single values changed, and what the check says of them."""

from pathlib import Path
from typing import Any

from treadline.run.resolve import checked as check
from treadline.run.verdict import CheckReport
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.scenario.scenario import Scenario
from treadline.scenario.shipped_files import CHAIRS

CHAIR = read_chair("wheelchair")


def judge(chair: ChairDescription = CHAIR, /, **tables: dict[str, Any]) -> CheckReport:
    return check(Scenario.model_validate(tables), chair)


def with_piece(piece: str, **values: object) -> ChairDescription:
    """Return the wheelchair with values of one of its tables replaced."""
    return CHAIR.model_copy(update={piece: getattr(CHAIR, piece).model_copy(update=values)})


def changed_chair(folder: Path, old: str, new: str) -> str:
    """Write the wheelchair's file with one piece of its text replaced, and return the path."""
    text = (CHAIRS / "wheelchair.toml").read_text(encoding="utf-8")
    assert text.count(old) == 1
    path = folder / "own.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    return str(path)
