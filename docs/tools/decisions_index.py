"""Write the index of decisions and evidence from the pages' titles: ``python docs/tools/decisions_index.py docs``."""

import sys
from pathlib import Path

HEAD = """# Decisions and evidence

A decision record states context, decision and consequences of the present design in at most 300 words; a decision that changes is
written into the record of its matter. Evidence pages hold measurements with date, seeds and the command that makes them.

## Decisions

"""


def index(docs: Path) -> str:
    """Return the page: one line per record and per page of evidence."""
    records = ""
    for path in sorted((docs / "decisions").glob("[0-9]*.md")):
        number, _, title = _title(path).partition(": ")
        records += f"* {number} [{title}]({path.name})\n"
    evidence = "".join(f"* [{_title(path)}](../evidence/{path.name})\n" for path in sorted((docs / "evidence").glob("*.md")))
    return f"{HEAD}{records}\n## Evidence\n\n{evidence}"


def _title(page: Path) -> str:
    return page.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    (folder / "decisions" / "index.md").write_text(index(folder), encoding="utf-8")
