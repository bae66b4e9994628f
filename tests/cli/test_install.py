"""Scripts of the Makefile, the lock file, and what the wheel contains."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGE = re.compile(r"(?m)^([\w.-]+)==(\S+)((?:.*\\\n +--hash=sha256:[0-9a-f]{64})*)")
LOCKED = {path.stem: PACKAGE.findall(path.read_text(encoding="utf-8")) for path in (ROOT / "requirements").glob("*.lock")}
"""Name, version and hashes of each package, by lock file."""
INSTALL = ROOT / "tools" / "install.py"


def requirements() -> list[Requirement]:
    """Return what the make targets install: the program, the tests, the linters, the documentation, the browser tests."""
    optional = PROJECT["project"]["optional-dependencies"]
    lines = [*PROJECT["project"]["dependencies"], *(line for name in ("test", "dev", "docs", "browser") for line in optional[name])]
    own = {name for line in lines if (found := re.fullmatch(r"treadline\[(.+)\]", line)) for name in found[1].split(",")}
    lines += [line for name in own for line in optional[name]]
    return [Requirement(line) for line in lines if not line.startswith("treadline[")]


def test_the_lock_has_an_admitted_version_of_each_requirement() -> None:
    versions = {name: version for packages in LOCKED.values() for name, version, _ in packages}
    missing = [str(item) for item in requirements() if not item.specifier.contains(versions.get(item.name.lower(), "0"))]
    assert missing == [], "run make lock"


@pytest.mark.parametrize("name", LOCKED)
def test_each_locked_package_has_hashes_and_names_no_index(name: str) -> None:
    text = (ROOT / "requirements" / f"{name}.lock").read_text(encoding="utf-8")
    assert [package for package, _, hashes in LOCKED[name] if not hashes] == []
    rest = [line for line in PACKAGE.sub("", text).splitlines() if line and not line.startswith("#")]
    assert all(re.fullmatch(r"-r (base|test)\.lock", line) for line in rest), rest


def test_each_action_of_the_ci_is_a_commit_and_the_image_installs_by_hashes() -> None:
    used = re.findall(r"uses: (.+)", (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))
    assert used
    assert [action for action in used if not re.fullmatch(r"[\w/-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", action)] == []
    installs = re.findall(r"pip install (.+)", (ROOT / "Dockerfile").read_text(encoding="utf-8"))
    assert all("--require-hashes" in install or "--no-deps" in install for install in installs), installs


def test_a_failure_of_pip_is_shown_and_its_exit_code_passed_on() -> None:
    command = [sys.executable, INSTALL, "--no-index", "nothing-of-this-name"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "nothing-of-this-name" in done.stderr


def test_the_wheel_contains_every_file_of_the_program() -> None:
    program = ROOT / "src" / "treadline"
    patterns = PROJECT["tool"]["setuptools"]["package-data"]["treadline"]
    packed = {path for pattern in patterns for path in program.glob(pattern)}
    files = {path for path in program.rglob("*") if path.is_file() and path.suffix != ".py" and "__pycache__" not in path.parts}
    assert files <= packed, sorted(str(path.relative_to(program)) for path in files - packed)


TARGETS = {
    "test-ros1": ("make", "-o", ".venv/.test", "test-ros1"),
    "test-browser": ("make", "-o", ".venv/.browser", "test-browser"),
    "gazebo": (str(ROOT / "legacy" / "gazebo" / "environment.sh"),),
}
"""Commands that install as root."""


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize(
    ("ci", "answer", "installs"), [("", None, False), ("", b"n\n", False), ("", b"y\n", True), ("true", None, True)]
)
def test_what_installs_as_root_asks_first(tmp_path: Path, target: str, ci: str, answer: bytes | None, installs: bool) -> None:
    """Test: stubs in place of the programs; no terminal, a person at a terminal, and CI=true. Expected: nothing without a yes."""
    pty = pytest.importorskip("pty", reason="no terminals on this system")
    called = tmp_path / "called"
    for name in ("apt-get", "debootstrap"):
        (tmp_path / name).write_text(f"#!/bin/sh\necho {name} >>{called}\nexit 1\n")
    (tmp_path / "id").write_text("#!/bin/sh\necho 0\n")
    (tmp_path / "chroot").write_text("#!/bin/sh\n")
    for path in tmp_path.iterdir():
        path.chmod(0o755)
    for name in ("make", "dirname", "mkdir", "rm"):
        (tmp_path / name).symlink_to(str(shutil.which(name)))
    environment = {"PATH": str(tmp_path), "CI": ci, "TREADLINE_GAZEBO": str(tmp_path / "cache"), "TREADLINE_MIRROR": "http://a"}
    terminal, stdin = (None, subprocess.DEVNULL) if answer is None else pty.openpty()
    if terminal is not None:
        os.write(terminal, answer or b"")
    done = subprocess.run(TARGETS[target], cwd=ROOT, env=environment, stdin=stdin, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert called.exists() == installs, done.stderr
    said = [line for line in done.stderr.splitlines() if not line.startswith("make")]
    assert re.match(r"treadline: .*apt-get installs? .*", said[0])
    if answer is None and not installs:
        assert len(said) == 1
        assert said[0].endswith("set CI=true to go on")
