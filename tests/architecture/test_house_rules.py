"""Rules about the code itself: arrows, start-up, docstrings, and no machine's paths."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import treadline

ROOT = Path(__file__).parents[2]
SOURCES = sorted(Path(treadline.__file__).parent.rglob("*.py"))
HEAVY = ("numpy", "scipy", "numba", "mujoco", "cv2", "matplotlib", "pydantic", "mcap", "jinja2")


def test_imports_follow_the_contracts() -> None:
    """Among them: the mission cannot reach the simulator, and so not its truth."""
    done = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_mission_never_gets_the_ground_truth() -> None:
    """``Truth`` lives next to ``Plant`` in ports, where import contracts do not separate them."""
    for path in SOURCES:
        if path.is_relative_to(Path(treadline.__file__).parent / "mission"):
            names = {node.id for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Name)}
            attributes = {node.attr for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Attribute)}
            assert not names & {"Truth", "TruthPlant"}, path
            assert "truth" not in attributes, path


def test_the_command_line_starts_without_anything_heavy() -> None:
    code = f"import sys, treadline.cli; print(*[name for name in {HEAVY!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(Path(treadline.__file__).parent)))
def test_all_that_is_public_says_what_it_is(path: Path) -> None:
    tree = ast.parse(path.read_text())
    assert ast.get_docstring(tree), f"{path.name} has no docstring"
    scopes = [tree, *[node for node in tree.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")]]
    for scope in scopes:
        for node in scope.body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                assert ast.get_docstring(node), f"{path.name}:{node.lineno}: {node.name} has no docstring"


def test_no_tracked_file_names_a_machine() -> None:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode != 0:
        pytest.skip("not a git checkout")
    folders = [f"/{name}/" for name in ("home", "work", "root", "Users", "tmp")]
    found = [
        f"{name}: {folder}"
        for name in listed.stdout.split("\0")
        if name and (ROOT / name).is_file()
        for folder in folders
        if folder.encode() in (ROOT / name).read_bytes()
    ]
    assert not found
