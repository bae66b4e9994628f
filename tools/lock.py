"""Write the lock files: versions and hashes of the packages that the make targets install.

``requirements/base.lock`` holds the program and its build, ``uv.lock`` the resolver, the others what an extra adds, after a line
that includes the file before. uv resolves all extras together, for the oldest supported Python and every system. Its hashes are
those of all files of a version, so newer Pythons and other systems find theirs.
"""

import re
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = ROOT / "pyproject.toml"
OLDEST = "3.11.0"
"""Version to resolve for: some packages ask for a later micro version than distributions have (Debian 12: 3.11.2)."""
INCLUDES = {"base": "", "test": "base", "dev": "test", "browser": "test", "docs": "base"}
"""Lock files, each with the one that it includes; all but the first are named after an extra."""
HEADER = "# Versions and hashes for Python 3.11 and newer. Written by: make lock\n"
PACKAGE = re.compile(r"^(?=\w)", re.MULTILINE)
"""Begin of a package: its name; its hashes follow, indented."""


def main() -> int:
    """Resolve all requirements anew and write the lock files."""
    blocks = resolved([name for name in INCLUDES if name != "base"], "--generate-hashes", *sys.argv[1:])
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as pins:
        pins.write("".join(blocks.values()))
        pins.flush()
        names = {"": {"uv"}}
        for name, before in INCLUDES.items():
            names[name] = set(resolved([name] if before else [], "--constraint", pins.name))
            include = f"-r {before}.lock\n" if before else ""
            added = "".join(blocks[package] for package in sorted(names[name] - names[before]))
            write(name, include + added)
    write("uv", blocks["uv"])
    return 0


def write(name: str, text: str) -> None:
    """Write a lock file."""
    (ROOT / "requirements" / f"{name}.lock").write_text(HEADER + text, encoding="utf-8")


def resolved(extras: list[str], *options: str) -> dict[str, str]:
    """Return the lines of each package that the program, its build, some extras and this script need."""
    command = [sysconfig.get_path("scripts") + "/uv", "pip", "compile", "--quiet", "--no-config", "--universal", "--no-annotate"]
    command += ["--no-header", "--fork-strategy", "fewest", "--python-version", OLDEST, *options, str(PROJECT), "-"]
    command += [word for extra in extras for word in ("--extra", extra)]
    build = [*tomllib.loads(PROJECT.read_text(encoding="utf-8"))["build-system"]["requires"], "build", "uv"]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, input="\n".join(build))  # noqa: S603
    return {block.partition("==")[0]: block for block in PACKAGE.split(done.stdout) if block}


if __name__ == "__main__":
    sys.exit(main())
