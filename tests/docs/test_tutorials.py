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
            assert pages.difference(block.shown, output) is None, f"python docs/tools/pages.py {page}"


@pytest.mark.parametrize(
    ("shown", "printed", "differs"),
    [
        ("heading +6.60° ± 0.10°", "heading +6.31° ± 0.09°", False),
        ("heading +6.60° ± 0.10°", "heading +6.60° ± 0.02°", True),
        ("49 of 50 frames, 8.2 ms a frame", "49 of 50 frames, 31 ms a frame", False),
        ("5 steps", "7 steps", True),
        ("6.48°", "5.58°", True),
        ("poles 1.2e-3, −0.5", "poles 1.25e-3, −0.51", False),
        ("arrived in 44 s", "held in 44 s", True),
    ],
)
def test_a_number_is_compared_within_its_tolerance_and_words_to_the_letter(shown: str, printed: str, differs: bool) -> None:
    assert (pages.difference(shown, printed) is not None) == differs


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
