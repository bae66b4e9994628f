"""Benchmark of stair detectors: render frames with known answers, and score a detector's results on them.

Run: ``python benchmarks/scenes render --out known [--count N] [--seed N]``, then
``python benchmarks/scenes score results.csv --truth known/truth.csv [--json]``. ``results.csv`` has the columns ``name``,
``heading_deg`` (empty: rejected) and, optional, ``sigma_deg``. ``python benchmarks/scenes detect known --out results.csv`` writes
those of treadline; with ``--method paper`` those of Algorithm 1, and with ``--less-deg 90`` of its Eq. (2) as an arcsine.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Literal

sys.path.insert(0, str(Path(__file__).parents[1]))

from scenes.known_answers import CONDITIONS, FRAMES_PER_CONDITION, write_benchmark
from scenes.scores import scored_table
from treadline.core.errors import TreadlineError
from treadline.io.frames.evaluation import FrameEvaluator
from treadline.io.frames.sources import read_frames


def detected(known: Path, method: Literal["robust", "paper"], less_deg: float) -> str:
    """Return the results table of one of our methods; Algorithm 1 declares no standard deviation."""
    lines, evaluator = ["name,heading_deg,sigma_deg"], FrameEvaluator(method)
    for condition in CONDITIONS:
        for _, item in map(evaluator.evaluate, read_frames(known / condition)):
            sigma = item["sigma_deg"] if method == "robust" else ""
            answer = f"{item['heading_deg'] - less_deg},{sigma}" if item["accepted"] else ","
            lines.append(f"{condition}/{item['name']},{answer}")
    return "\n".join([*lines, ""])


def main() -> int:
    """Render or score; a bad input is one line on stderr and exit code 2."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    render = commands.add_parser("render", help=f"write frames of {len(CONDITIONS)} conditions, a folder each, and one truth.csv")
    render.add_argument("--out", type=Path, required=True, help="folder to write")
    render.add_argument("--count", type=int, default=FRAMES_PER_CONDITION, help="frames of each condition")
    render.add_argument("--seed", type=int, default=0, help="random seed; the same seed gives byte-identical frames")
    detect = commands.add_parser("detect", help="write the results of treadline's own methods")
    detect.add_argument("known", type=Path, help="folder of rendered frames")
    detect.add_argument("--out", type=Path, required=True, help="CSV file to write")
    detect.add_argument("--method", choices=("robust", "paper"), default="robust")
    detect.add_argument("--less-deg", type=float, default=0.0, help="angle to take off each heading")
    score = commands.add_parser("score", help="score the headings of any detector against a truth.csv")
    score.add_argument("results", type=Path, help="CSV file of the detector's results")
    score.add_argument("--truth", type=Path, required=True, help="truth.csv of the frames")
    score.add_argument("--json", action="store_true", help="print one JSON object")
    given = parser.parse_args()
    try:
        if given.command == "render":
            total = write_benchmark(given.out, seed=given.seed, frames=given.count, watch=lambda name: print(name, file=sys.stderr))
            print(f"{total} frames in {len(CONDITIONS)} folders and truth.csv written to {given.out}")
        elif given.command == "detect":
            given.out.write_text(detected(given.known, given.method, given.less_deg), encoding="utf-8")
        else:
            values, summary = scored_table(given.results, given.truth)
            print(json.dumps(values) if given.json else "\n".join(summary))
    except TreadlineError as error:
        print(f"scenes: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
