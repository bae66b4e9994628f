"""The crossings and the uncertainty budget are benchmarks; the tests here import them from their folder."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
