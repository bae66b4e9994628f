"""Write the command reference from ``--help``: ``python docs/tools/commands.py FILE``."""

import contextlib
import io
import os
import sys
from pathlib import Path

os.environ["COLUMNS"] = "100"  # the width of the help's boxes
os.environ["NO_COLOR"] = "1"

from treadline.cli import VERBS, main

HEAD = """# Commands

Every command takes `--json` (one JSON object on stdout and nothing else) and `--debug` (a traceback instead of one line).
Exit codes: 0 done; 1 the job ran and the answer is no; 2 the input is bad; 130 interrupted; 143 terminated.
Shell completion: `treadline --install-completion`.
"""


def help_of(*command: str) -> str:
    """Return what ``--help`` prints, without the epilogue that all commands share."""
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        main([*command, "--help"])
    return text.getvalue().partition("Every verb takes --json")[0].strip()


def reference() -> str:
    """Return the page: commands under the headings of the program's own help."""
    parts = [HEAD]
    for heading, verbs in VERBS.items():
        parts.append(f"## {heading}\n")
        parts += [f"### treadline {verb}\n\n```text\n{help_of(verb)}\n```\n" for verb in verbs]
    return "\n".join(parts)


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(reference(), encoding="utf-8")
