"""The examples run and print the documented results."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.mark.parametrize(("name", "words"), [("paper_gain.py", "-2.68 m/s"), ("see_a_frame.py", "heading +26")])
def test_an_example_says_what_it_should(name: str, words: str) -> None:
    done = subprocess.run([sys.executable, EXAMPLES / name], capture_output=True, text=True, check=True)
    assert words in done.stdout


def test_every_example_is_short_and_says_what_it_is_for() -> None:
    for path in EXAMPLES.glob("*.py"):
        lines = path.read_text().splitlines()
        assert lines[0].startswith('"""')
        assert len(lines) < 40, path.name
