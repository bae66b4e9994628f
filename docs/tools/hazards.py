"""Write the guard's rules into the table of hazards: ``python docs/tools/hazards.py docs/explanation/safety.md``."""

import inspect
import re
import sys
from pathlib import Path

from treadline.guard._half_cosine_stop import Stop
from treadline.guard._known import Monitor
from treadline.guard._rules import RULES

BEGIN, END = "<!-- rules -->\n", "<!-- end of rules -->\n"
STOPS = {Stop.BRAKE: "braked", Stop.RAMP: "ramped"}


def words(rule: type[Monitor]) -> tuple[str, str, str]:
    """Return what a rule's docstring says: the guarantee, its time, and what it does not cover."""
    first, *further = inspect.getdoc(rule).split("\n\n")  # type: ignore[union-attr]
    said = dict(re.findall(r"^(Time|Not covered): (.*?)\.$", further[0], re.MULTILINE | re.DOTALL))
    guarantee, time, not_covered = (" ".join(text.split()) for text in (first, said["Time"], said.get("Not covered", "–")))
    return guarantee.removesuffix("."), time, not_covered


def table() -> str:
    """Return one row for each rule of the guard, in the order in which the first cause counts."""
    head = "| row | holds | time | stop | does not cover |\n| --- | --- | --- | --- | --- |\n"
    rows = [(rule, *words(rule)) for rule in RULES]
    return head + "".join(
        f"| {rule.rows} | {holds} | {time} | {STOPS[rule.stop]} | {spared} |\n" for rule, holds, time, spared in rows
    )


def with_table(page: str) -> str:
    """Return a page with the table between its two marks."""
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}\n{table()}\n{END}{rest.partition(END)[2]}"


if __name__ == "__main__":
    path = Path(sys.argv[1])
    path.write_text(with_table(path.read_text(encoding="utf-8")), encoding="utf-8")
