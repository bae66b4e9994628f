"""Publish a reproduction: ``python benchmarks/publish.py reproduce`` writes its headline figures to the README and to the evidence.

Reads ``results.json`` of the folder that ``make reproduce`` writes; writes ``docs/evidence/results.json`` and the README table.
"""

import argparse
import json
from pathlib import Path

from treadline.core.models import write_whole
from treadline.report.comparison import published_of, with_table

ROOT = Path(__file__).parents[1]
EVIDENCE = ROOT / "docs" / "evidence" / "results.json"


def main() -> None:
    """Write both files."""
    parser = argparse.ArgumentParser(description="Write the headline figures of a reproduction to README.md and docs/evidence.")
    parser.add_argument("folder", type=Path, help="folder that make reproduce wrote")
    options = parser.parse_args()
    values = published_of(options.folder)
    readme = ROOT / "README.md"
    write_whole(EVIDENCE, json.dumps(values, indent=1, ensure_ascii=False) + "\n")
    write_whole(readme, with_table(readme.read_text(encoding="utf-8"), values))
    print(f"wrote {EVIDENCE.relative_to(ROOT)} and {readme.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
