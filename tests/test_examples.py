"""The examples run and print the documented results."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
WORDS = {
    "paper_gain.py": r"-2\.68 m/s",
    "see_a_frame.py": r"heading -14",
    "identify_arrays.py": r"(?s)model of order 2.*poles +0\.5.*controller of 'wheelchair'",
    "own_vehicle.py": r"(?s)28°: go.*44°: refuse.*next: no controller is shipped for 'long-chair'",
    "own_stair.py": r"(?s)^go.*arrived after",
    "climb_and_plot.py": r"(?s)arrived after .*panels; largest pitch 2[89]",
    "own_controller_pid.py": r"(?s)arrived after .*phases +search.*mount.*traction.*climb.*crest.*land",
    "own_controller_mpc.py": r"(?s)arrived after .*phases +search.*mount.*traction.*climb.*crest.*land",
    "own_detector.py": r"(?s)time_up after 6\.0 s.*phases +search.*align",
}
MADE_ELSEWHERE = {"make_controller.py"}
"""It writes the shipped controller; an identification test makes the same steps."""


@pytest.mark.parametrize("name", WORDS)
def test_an_example_prints_its_result(name: str) -> None:
    done = subprocess.run([sys.executable, EXAMPLES / name], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(WORDS[name], done.stdout), done.stdout


def test_every_example_is_short_says_what_it_is_for_and_is_run() -> None:
    assert {path.name for path in EXAMPLES.glob("*.py")} == WORDS.keys() | MADE_ELSEWHERE
    for path in EXAMPLES.glob("*.py"):
        lines = path.read_text().splitlines()
        assert lines[0].startswith('"""')
        assert len(lines) < 40, path.name
