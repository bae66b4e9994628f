"""Run the pages with commands and renew what they show: ``python docs/tools/pages.py docs/tutorials/own-logs.md ...``.

A page's fenced blocks are its program, in the page's order: a block with ``title="NAME"`` is a file to write, ``sh`` and ``python``
without a title run. A comment ``<!-- not run by the tests: REASON -->`` before a block leaves that block out. A ``text`` block
directly after one that runs shows its output, and a picture ``media/pages/PAGE-NAME`` is the file NAME that the page's program
wrote, in whichever folder; a picture that it did not write stays as it is.
"""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from PIL import Image

import treadline

DOCS = Path(__file__).parents[1]
BLOCK = re.compile(
    r"(?P<skip><!-- not run by the tests: [^>]+ -->\n)?"
    r'```(?P<kind>sh|python|toml)(?: title="(?P<name>[^"]+)")?\n(?P<text>.*?)```'
    r"(?:\n\n```text\n(?P<shown>.*?)```)?",
    re.DOTALL,
)
LARGEST_PX = (720, 720)
"""Size of a picture: the width of a page's text."""
NUMBER = re.compile(r"[-+−]?\d[\d.,]*(?:e[-+]?\d+)?")
OF_THE_MACHINE = re.compile(rf"{NUMBER.pattern}(?= (?:ms|runs per CPU hour|× real time)\b)")
"""Computing times, which are not compared."""
SHARE, LAST_DIGITS = 0.1, 1.0
"""How far a number may be from the one shown: share of it, and units of its last digit. On one machine outputs repeat to the digit;
kernels compiled for a generic processor round differently, which moved a margin of tutorial ``own-robot`` by 4.8 %."""


class Block(NamedTuple):
    """Fenced block of a page."""

    kind: str
    name: str | None
    text: str
    shown: str | None
    """Output that the page shows."""


def blocks_of(page: Path) -> list[Block]:
    """Return the blocks of a page that run, or that are files to write."""
    found = BLOCK.finditer(page.read_text(encoding="utf-8"))
    return [Block(block["kind"], block["name"], block["text"], block["shown"]) for block in found if not block["skip"]]


def environment(folder: Path) -> dict[str, str]:
    """Return an environment in which ``treadline`` and ``python`` are those of this process."""
    programs = folder / "bin"
    programs.mkdir()
    for name, call in (("treadline", "-m treadline"), ("python", "")):
        (programs / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {call} "$@"\n', encoding="utf-8")
        (programs / name).chmod(0o755)
    source = str(Path(treadline.__file__).parents[1])
    return os.environ | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": source, "COLUMNS": "100"}


def outputs_of(page: Path, folder: Path, env: Mapping[str, str]) -> Iterator[tuple[Block, str]]:
    """Run a page in a folder; yield each block that runs, with its output.

    Raises:
        RuntimeError: If a block fails.
    """
    folder.mkdir()
    (folder / "benchmarks").symlink_to(DOCS.parent / "benchmarks")  # pages with benchmarks are for a checkout
    for block in blocks_of(page):
        if block.name is not None:
            (folder / block.name).write_text(block.text, encoding="utf-8")
        if block.name is not None or block.kind == "toml":
            continue
        command = ["sh", "-e", "-c", block.text] if block.kind == "sh" else [sys.executable, "-c", block.text]
        done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode != 0:
            raise RuntimeError(f"{page.name}:\n{block.text}\n{done.stdout}\n{done.stderr}")
        yield block, done.stdout


def difference(shown: str, output: str) -> str | None:
    """Return how an output differs from the one that a page shows, or None: other words, or a number beyond its tolerance."""
    texts = [OF_THE_MACHINE.sub("time", text) for text in (shown, output)]
    shown_words, words = (" ".join(NUMBER.sub("#", text).split()) for text in texts)
    if shown_words != words:
        return f"shown: {shown_words}\nprinted: {words}"
    pairs = zip(*(NUMBER.findall(text) for text in texts), strict=True)
    return next((f"{was} is shown, {now} is printed" for was, now in pairs if not _agree(was, now)), None)


def _agree(was: str, now: str) -> bool:
    """Return whether two numbers agree within the tolerance; dates and versions only if they are the same."""
    shown, printed = (text.rstrip(".,").replace("−", "-").replace(",", "") for text in (was, now))
    try:
        value, other = float(shown), float(printed)
    except ValueError:
        return shown == printed
    mantissa, _, exponent = shown.partition("e")
    unit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    return abs(value - other) <= SHARE * abs(value) + LAST_DIGITS * unit * (1.0 + 1e-9)


def renew(page: Path) -> None:
    """Run a page; write its outputs and pictures."""
    text = page.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "work"
        for block, output in outputs_of(page, folder, environment(Path(place))):
            if block.shown is not None:
                text = text.replace(
                    f"{block.text}```\n\n```text\n{block.shown}```", f"{block.text}```\n\n```text\n{output.rstrip()}\n```"
                )
        for name in re.findall(rf"\(\.\./media/pages/{page.stem}-([\w.-]+)\)", text):
            for made in [*folder.rglob(name)][:1]:
                picture = Image.open(made).convert("RGB")
                picture.thumbnail(LARGEST_PX)
                picture.quantize().save(DOCS / "media" / "pages" / f"{page.stem}-{name}", optimize=True)
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    (DOCS / "media" / "pages").mkdir(exist_ok=True)
    for argument in sys.argv[1:]:
        renew(Path(argument))
