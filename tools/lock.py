"""Print the version of each package that the make targets install; ``make lock`` writes them to requirements.lock.

pip resolves them for the first micro version of the oldest supported Python: newer ones can install its versions too.
"""

import json
import subprocess
import sys

OLDEST = (3, 11)
MICRO = "3.11.0"
"""Version to resolve for: some packages ask for a later micro version than distributions have (Debian 12: 3.11.2)."""
EXTRAS = ".[dev,docs,browser]"
HEADER = """\
# Versions that the make targets install, on Python 3.11 and newer. Written by: make lock PYTHON=python3.11
"""


def main() -> int:
    """Resolve all requirements anew and print one line for each package."""
    if sys.version_info[:2] != OLDEST:
        print("treadline: make lock needs Python 3.11, whose versions newer Pythons can install too", file=sys.stderr)
        return 2
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed", "--report", "-"]
    command += ["--python-version", MICRO, "--only-binary", ":all:", "--target", "build/lock", EXTRAS]  # as pip demands
    report = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)  # noqa: S603
    found = [item["metadata"] for item in report["install"]]
    lines = sorted(f"{item['name'].lower()}=={item['version']}\n" for item in found if item["name"] != "treadline")
    sys.stdout.write(HEADER + "".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
