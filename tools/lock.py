"""Print the version of each package that the make targets install; ``make lock`` writes them to requirements.lock.

pip resolves them for the Python that runs this, which is the oldest supported one: its versions exist for the newer ones too.
"""

import json
import subprocess
import sys

OLDEST = (3, 11)
EXTRAS = ".[dev,docs,browser]"
HEADER = """\
# Versions that the make targets install, on Python 3.11 and newer. Written by: make lock PYTHON=python3.11
"""


def main() -> int:
    """Resolve all requirements anew and print one line for each package."""
    if sys.version_info[:2] != OLDEST:
        print("treadline: make lock needs Python 3.11, whose versions newer Pythons can install too", file=sys.stderr)
        return 2
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed", "--report", "-", EXTRAS]
    report = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)  # noqa: S603
    found = [item["metadata"] for item in report["install"]]
    lines = sorted(f"{item['name'].lower()}=={item['version']}\n" for item in found if item["name"] != "treadline")
    sys.stdout.write(HEADER + "".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
