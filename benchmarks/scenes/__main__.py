"""Benchmark of stair detectors: render frames with known answers, and score a detector's results on them.

Run: ``python benchmarks/scenes render --out known [--count N] [--seed N]``, then
``python benchmarks/scenes score results.csv --truth known/truth.csv [--json]``. ``results.csv`` has the columns ``name``,
``heading_deg`` (empty: rejected) and, optional, ``sigma_deg``.
"""

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from scenes.known_answers import CONDITIONS, FRAMES_PER_CONDITION, write_benchmark
from scenes.scores import scored_table
from treadline.core.errors import TreadlineError


def main() -> int:
    """Render or score; a bad input is one line on stderr and exit code 2."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    render = commands.add_parser("render", help=f"write frames of {len(CONDITIONS)} conditions, a folder each, and one truth.csv")
    render.add_argument("--out", type=Path, required=True, help="folder to write")
    render.add_argument("--count", type=int, default=FRAMES_PER_CONDITION, help="frames of each condition")
    render.add_argument("--seed", type=int, default=0, help="random seed; the same seed gives byte-identical frames")
    score = commands.add_parser("score", help="score the headings of any detector against a truth.csv")
    score.add_argument("results", type=Path, help="CSV file of the detector's results")
    score.add_argument("--truth", type=Path, required=True, help="truth.csv of the frames")
    score.add_argument("--json", action="store_true", help="print one JSON object")
    given = parser.parse_args()
    try:
        if given.command == "render":
            total = write_benchmark(given.out, seed=given.seed, frames=given.count, watch=lambda name: print(name, file=sys.stderr))
            print(f"{total} frames in {len(CONDITIONS)} folders and truth.csv written to {given.out}")
        else:
            values, summary = scored_table(given.results, given.truth)
            print(json.dumps(values) if given.json else "\n".join(summary))
    except TreadlineError as error:
        print(f"scenes: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
