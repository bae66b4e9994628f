"""Tutorials, notebooks and how-to guides: every command and script on a page runs, in the page's order, in an empty folder.

A page's fenced blocks are its program: a block with ``title="NAME"`` is a file to write, ``sh`` and ``python`` without a title
run. A comment ``<!-- not run by the tests: REASON -->`` before a block leaves that block out.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

import treadline

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted([*(DOCS / "tutorials").glob("*.md"), *(DOCS / "how-to").glob("*.md")])
BLOCK = re.compile(
    r"(?P<skip><!-- not run by the tests: [^>]+ -->\n)?"
    r'```(?P<kind>sh|python|toml)(?: title="(?P<name>[^"]+)")?\n(?P<text>.*?)```',
    re.DOTALL,
)


class Block(NamedTuple):
    """Fenced block of a page."""

    kind: str
    name: str | None
    text: str


def blocks_of(page: Path) -> list[Block]:
    """Return the blocks of a page that run, or that are files to write."""
    found = BLOCK.finditer(page.read_text(encoding="utf-8"))
    return [Block(block["kind"], block["name"], block["text"]) for block in found if not block["skip"]]


@pytest.fixture
def shell(tmp_path: Path) -> dict[str, str]:
    """Return an environment in which ``treadline`` and ``python`` are those under test."""
    programs = tmp_path / "bin"
    programs.mkdir()
    for name, call in (("treadline", "-m treadline"), ("python", "")):
        (programs / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {call} "$@"\n', encoding="utf-8")
        (programs / name).chmod(0o755)
    source = str(Path(treadline.__file__).parents[1])
    return os.environ | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": source}


@pytest.mark.skipif(sys.platform == "win32", reason="the pages' commands are for a POSIX shell")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}/{page.stem}")
def test_every_command_of_a_page_runs(page: Path, tmp_path: Path, shell: dict[str, str]) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    (folder / "benchmarks").symlink_to(DOCS.parent / "benchmarks")  # pages with benchmarks are for a checkout
    for number, block in enumerate(blocks_of(page)):
        if block.name is not None:
            (folder / block.name).write_text(block.text, encoding="utf-8")
        if block.name is not None or block.kind == "toml":
            continue
        command = ["sh", "-e", "-c", block.text] if block.kind == "sh" else [sys.executable, "-c", block.text]
        done = subprocess.run(command, cwd=folder, env=shell, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{page.name}, block {number}:\n{block.text}\n{done.stdout}\n{done.stderr}"


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.ipynb")), ids=lambda page: page.stem)
def test_every_cell_of_a_notebook_runs(page: Path, tmp_path: Path, shell: dict[str, str]) -> None:
    cells = json.loads(page.read_text(encoding="utf-8"))["cells"]
    assert not any(cell.get("outputs") for cell in cells)  # stored results grow old
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=shell, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{page.name}:\n{done.stdout}\n{done.stderr}"


@pytest.mark.parametrize("page", sorted((DOCS / "tutorials").glob("*.md")), ids=lambda page: page.stem)
def test_a_tutorial_has_commands_and_scripts(page: Path) -> None:
    kinds = {block.kind for block in blocks_of(page)}
    assert kinds >= {"sh", "python"}
