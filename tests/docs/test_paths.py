"""Files and decisions that documents and docstrings name exist, so that a page cannot point to where a file once was."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NAMED = re.compile(r"(?<![\w/.{}<-])((?:[a-z_0-9]+/)+[a-z_0-9]+\.(?:py|js|cc|sh))\b")
"""Path with at least one folder, relative to the repository, to ``src/treadline`` or to a package."""
CITED = re.compile(r"decisions?[ /]\[?(\d{4})")
"""Number of a decision record in a text."""
TEXTS = {".py", ".md", ".toml", ".c", ".h", ".cc", ".j2", ".ipynb", ".xml", ".msg", ".action"}
EXAMPLES = {"path/to/file.py", "install/setup.sh"}
"""Files of a reader's own."""


def tracked() -> list[str]:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode != 0:
        pytest.skip("not a git checkout")
    return [name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]


def test_decisions_that_files_cite_exist() -> None:
    records = {path.name[:4] for path in (ROOT / "docs" / "decisions").glob("[0-9]*.md")}
    texts = [name for name in tracked() if name != "CHANGELOG.md" and Path(name).suffix in TEXTS]
    cited = {name: set(CITED.findall((ROOT / name).read_text(encoding="utf-8"))) - records for name in texts}
    assert {name: numbers for name, numbers in cited.items() if numbers} == {}


def test_files_that_documents_and_docstrings_name_exist() -> None:
    files = tracked()
    places = {"/".join(parts[start:]) for name in files for parts in [name.split("/")] for start in range(len(parts))}
    readers = [name for name in files if name.endswith(".md") or (name.startswith("src/") and name.endswith(".py"))]
    missing = [
        f"{name}: {path}"
        for name in readers
        if name != "CHANGELOG.md"  # past versions had other files
        for line in (ROOT / name).read_text(encoding="utf-8").splitlines()
        if "in version 0." not in line
        for path in NAMED.findall(line)
        if path not in places | EXAMPLES
    ]
    assert not missing
