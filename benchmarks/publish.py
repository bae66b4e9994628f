"""Publish a reproduction: ``python benchmarks/publish.py reproduce`` writes its headline figures to the README and to the evidence.

Reads ``results.json`` of a folder that ``treadline reproduce --seeds 5`` writes (``make publish`` runs both); writes
``docs/evidence/results.json`` and the README table.
"""

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from treadline.core.errors import SettingsError, TreadlineError
from treadline.core.files import write_whole
from treadline.report._results import Results, read_part
from treadline.report.comparison import PUBLISHED_SEEDS, comparisons

ROOT = Path(__file__).parents[1]
EVIDENCE = ROOT / "docs" / "evidence" / "results.json"

BEGIN, END = "<!-- results: written by benchmarks/publish.py -->", "<!-- end of results -->"
"""Markers of the README's table."""


def published(results: Results) -> dict[str, Any]:
    """Return the content of ``docs/evidence/results.json``: provenance and at most ten figures."""
    return {
        "command": results.command,
        "git_commit": results.git_commit,
        "versions": results.versions,
        "figures": [
            {name: getattr(row, name) for name in ("figure", "paper", "ours", "conditions")} for row in comparisons(results)
        ],
    }


def published_of(folder: Path) -> dict[str, Any]:
    """Return the content of ``docs/evidence/results.json`` from the folder of a reproduction.

    Raises:
        SettingsError: If its ``results.json`` cannot be read, or is of a quick run or of too few seeds.
    """
    results = read_part(folder / "results.json", Results)
    if results.quick:
        raise SettingsError(f"{folder}: a quick reproduction is not published: it lacks items")
    seeds = min((cell.seeds for cell in results.table2), default=0)
    if seeds < PUBLISHED_SEEDS:
        raise SettingsError(
            f"{folder}: Table II has {seeds} seeds, {PUBLISHED_SEEDS} are published: treadline reproduce --seeds {PUBLISHED_SEEDS}"
        )
    return published(results)


def with_table(readme: str, values: Mapping[str, Any]) -> str:
    """Return the README with its table replaced by that of a published file.

    Raises:
        ValueError: If it does not have both markers once, in order.
    """
    if readme.count(BEGIN) != 1 or readme.count(END) != 1 or readme.index(BEGIN) > readme.index(END):
        raise ValueError(f"README.md: wanted the markers '{BEGIN}' and '{END}' once each, in this order")
    lines = [f"| {row['figure']} | {row['paper']} | {row['ours']} | {row['conditions']} |" for row in values["figures"]]
    table = "\n".join([BEGIN, "| figure | paper | here | conditions |", "| --- | --- | --- | --- |", *lines, END])
    return readme[: readme.index(BEGIN)] + table + readme[readme.index(END) + len(END) :]


def main() -> None:
    """Write both files."""
    parser = argparse.ArgumentParser(description="Write the headline figures of a reproduction to README.md and docs/evidence.")
    parser.add_argument("folder", type=Path, help="folder that make reproduce wrote")
    options = parser.parse_args()
    try:
        values = published_of(options.folder)
    except TreadlineError as error:
        parser.error(str(error))
    readme = ROOT / "README.md"
    write_whole(EVIDENCE, json.dumps(values, indent=1, ensure_ascii=False) + "\n")
    write_whole(readme, with_table(readme.read_text(encoding="utf-8"), values))
    print(f"wrote {EVIDENCE.relative_to(ROOT)} and {readme.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
