"""Tutorials, notebooks and how-to guides: every command and script on a page runs, and an output that it shows is the program's.

``docs/tools/pages.py`` says how a page is read, and renews outputs and pictures.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from scripts import module_of

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted([*(DOCS / "tutorials").glob("*.md"), *(DOCS / "how-to").glob("*.md")])
pages = module_of(DOCS / "tools" / "pages.py")


@pytest.fixture
def shell(tmp_path: Path) -> dict[str, str]:
    """Return an environment in which ``treadline`` and ``python`` are those under test."""
    env: dict[str, str] = pages.environment(tmp_path)
    return env


@pytest.mark.skipif(sys.platform == "win32", reason="the pages' commands are for a POSIX shell")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}/{page.stem}")
def test_every_command_of_a_page_runs_and_prints_what_the_page_shows(page: Path, tmp_path: Path, shell: dict[str, str]) -> None:
    for block, output in pages.outputs_of(page, tmp_path / "work", shell):
        if block.shown is not None:
            assert pages.words_of(block.shown) == pages.words_of(output), f"python docs/tools/pages.py {page}"


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.ipynb")), ids=lambda page: page.stem)
def test_every_cell_of_a_notebook_runs(page: Path, tmp_path: Path, shell: dict[str, str]) -> None:
    cells = json.loads(page.read_text(encoding="utf-8"))["cells"]
    assert not any(cell.get("outputs") for cell in cells)  # stored results grow old
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=shell, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{page.name}:\n{done.stdout}\n{done.stderr}"
    bare = subprocess.run([sys.executable, "-I", "-S", "-c", code], capture_output=True, text=True, check=False)
    assert bare.stderr.startswith("treadline is not installed: pip install . in treadline's folder, ")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}/{page.stem}")
def test_a_page_with_commands_shows_an_output_and_a_tutorial_a_picture_too(page: Path) -> None:
    blocks = pages.blocks_of(page)
    commands = [block for block in blocks if block.kind == "sh"]
    assert any(block.shown for block in blocks) or not commands
    assert page.parent.name != "tutorials" or (commands and f"](../media/pages/{page.stem}-" in page.read_text(encoding="utf-8"))
