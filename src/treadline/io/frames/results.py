"""Results of many frames: a table with a row per frame, and a summary."""

import csv
import json
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.errors import SettingsError
from treadline.core.printing import plain

COLUMNS = ("name", "t_s", "accepted", "heading_deg", "sigma_deg", "edges", "ms", "reason")
"""Columns of the table that are values of a frame."""
STAIR_COLUMNS = ("direction", "rise_m", "run_m", "slope_deg", "distance_m")
"""Columns of the table that are values of a frame's stair."""
ENDINGS = (".csv", ".jsonl")
"""File name endings of tables: CSV, and one JSON object per line."""
_NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")


@contextmanager
def heading_table(path: Path) -> Iterator[Callable[[Mapping[str, Any]], None]]:
    """Open a file with a row per frame, written row by row, so that an interrupted run leaves a readable table.

    Yields:
        The function that appends the row of a frame.

    Raises:
        SettingsError: If the ending of the name is neither .csv nor .jsonl.
    """
    suffix = path.suffix.lower()
    if suffix not in ENDINGS:
        raise SettingsError(f"--headings {path}: unknown format '{path.suffix}'; give .csv or .jsonl")
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        if suffix == ".csv":
            rows.writerow((*COLUMNS, *STAIR_COLUMNS))

        def write(values: Mapping[str, Any]) -> None:
            if suffix == ".csv":
                stair = values["stair"] or {}
                row = [values.get(column) for column in COLUMNS] + [stair.get(column) for column in STAIR_COLUMNS]
                rows.writerow(["" if cell is None else cell for cell in row])
            else:
                file.write(json.dumps(plain(values), allow_nan=False) + "\n")
            file.flush()

        yield write


class Summary:
    """Counts of accepted frames and of rejection reasons, and the processing times."""

    def __init__(self) -> None:
        self._accepted = 0
        self._times_ms: list[float] = []
        self._reasons: dict[str, tuple[str, int]] = {}

    def add(self, values: Mapping[str, Any]) -> None:
        """Count a frame."""
        self._times_ms.append(float(values["ms"]))
        if values["accepted"]:
            self._accepted += 1
            return
        reason = str(values["reason"])
        # Reasons that differ in their numbers only are one reason; the first one is the example.
        kind = _NUMBER.sub("#", reason)
        example, count = self._reasons.get(kind, (reason, 0))
        self._reasons[kind] = example, count + 1

    @property
    def values(self) -> dict[str, Any]:
        """Summary with the keys of the JSON output."""
        count = len(self._times_ms)
        ordered = sorted(self._reasons.values(), key=lambda item: -item[1])
        return {
            "count": count,
            "accepted": self._accepted,
            "accepted_share": self._accepted / count if count else None,
            "rejections": dict(ordered),
            "median_ms": float(np.median(self._times_ms)) if count else None,
        }

    @property
    def lines(self) -> list[str]:
        """Summary for people."""
        count = len(self._times_ms)
        share = f" ({100.0 * self._accepted / count:.0f} %), median {np.median(self._times_ms):.1f} ms" if count else ""
        first = f"{self._accepted} of {count} frames accepted{share}"
        return [first, *(f"  rejected {times}: {reason}" for reason, times in self.values["rejections"].items())]
