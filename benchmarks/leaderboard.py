"""Leaderboard of stair detectors on the frames of ``python benchmarks/scenes render``.

Run: ``python benchmarks/leaderboard.py [--frames N] [--seed N] [--results NAME=FILE ...] [--out FILE]``. Renders the frames, runs
the detector and Algorithm 1 as printed, scores both and the results tables of other programs, and writes a page.
``--frames-in FOLDER`` takes rendered frames, as another program's results refer to them.
"""

import argparse
import datetime as dt
import tempfile
from pathlib import Path
from typing import Literal

from scenes.known_answers import CONDITIONS, FRAMES_PER_CONDITION, write_benchmark
from scenes.scores import LEAST_SHARE, HeadingResult, HeadingScores, percent, read_results, read_truth, score

from treadline.io.frames.evaluation import FrameEvaluator
from treadline.io.frames.sources import read_frames

REJECTED = HeadingResult(heading_deg=None)
LABELS = ("treadline", "Algorithm 1 as printed", "Algorithm 1 less 90°")
"""Own rows of the table. Eq. (2) as printed gives 90° for a chair square to the stair; less 90° the formula is an arcsine."""
REFUSABLE = ("kinect1_bowed", "kinect1_narrow")
"""Conditions that a detector may reject on purpose: a bowed flight has an uncertain heading, a narrow one no room for a chair."""


def run_method(folder: Path, method: Literal["robust", "paper"]) -> dict[str, HeadingResult]:
    """Return the results of one of our methods. Algorithm 1 declares no standard deviation."""
    results, evaluator = {}, FrameEvaluator(method)
    for condition in CONDITIONS:
        for _, item in map(evaluator.evaluate, read_frames(folder / condition)):
            sigma = item["sigma_deg"] if method == "robust" else None
            answer = HeadingResult(heading_deg=item["heading_deg"], sigma_deg=sigma) if item["accepted"] else REJECTED
            results[f"{condition}/{item['name']}"] = answer
    return results


def own_results(folder: Path) -> dict[str, dict[str, HeadingResult]]:
    """Return the results of our methods by label."""
    printed = run_method(folder, "paper")
    turned = {
        name: answer if answer.heading_deg is None else HeadingResult(heading_deg=answer.heading_deg - 90.0)
        for name, answer in printed.items()
    }
    return dict(zip(LABELS, (run_method(folder, "robust"), printed, turned), strict=True))


def table_row(label: str, scores: HeadingScores, straight: HeadingScores) -> str:
    """Return one row of the leaderboard; ``straight`` are the scores without the conditions that may be rejected."""
    errors = [scores.rmse_deg, scores.p95_deg, scores.worst_deg]
    cells = [
        percent(scores.accepted.hits, scores.accepted.count),
        percent(straight.accepted.hits, straight.accepted.count),
        *("–" if error is None else f"{error:.2f}°" for error in errors),
        percent(scores.inside_95.hits, scores.inside_95.count) or "–",
        f"{scores.false_accepts.hits}/{scores.false_accepts.count}: "
        + percent(scores.false_accepts.hits, scores.false_accepts.count),
    ]
    return f"| {label} | {' | '.join(cells)} |"


def condition_row(condition: str, all_scores: list[HeadingScores]) -> str:
    """Return the row of one condition, with a cell per detector."""
    cells = []
    for scores in all_scores:
        if scores.false_accepts.count:
            cells.append(f"false accepts {scores.false_accepts.hits}/{scores.false_accepts.count}")
        else:
            error = "" if scores.rmse_deg is None else f", RMSE {scores.rmse_deg:.2f}°"
            cells.append(f"{scores.accepted.hits}/{scores.accepted.count}{error}")
    return f"| {condition} | {' | '.join(cells)} |"


def page(folder: Path, peers: dict[str, Path], command: str, notes: str) -> str:
    """Return the page."""
    truth = read_truth(folder / "truth.csv")
    straight = {name: true for name, true in truth.items() if name.partition("/")[0] not in REFUSABLE}
    answers = own_results(folder) | {label: read_results(path, truth) for label, path in peers.items()}
    lines = [
        "# Leaderboard of stair detectors on rendered frames",
        "",
        f"Date: {dt.datetime.now(tz=dt.UTC).date()}. Made by `{command}`.",
        "The frames are those of `python benchmarks/scenes render`.",
        f"{len(truth)} frames of {len(CONDITIONS)} conditions. Fractions have 95 % intervals (Wilson). A rejection counts as "
        f"a miss if the stair covers at least {100 * LEAST_SHARE:.0f} % of the image; errors are of all accepted frames "
        "with a stair.",
        "",
        "| detector | accepted | without bowed and narrow flights | RMSE | p95 | worst | inside the declared 95 % "
        "| false accepts |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
        *(table_row(label, score(answer, truth), score(answer, straight)) for label, answer in answers.items()),
        "",
        "Accepted frames and RMSE of each condition:",
        "",
        f"| condition | {' | '.join(answers)} |",
        f"| --- |{' --- |' * len(answers)}",
    ]
    for condition in CONDITIONS:
        part = {name: true for name, true in truth.items() if name.startswith(f"{condition}/")}
        lines.append(condition_row(condition, [score(answer, part) for answer in answers.values()]))
    return "\n".join([*lines, "", notes.strip()]).rstrip() + "\n"


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=FRAMES_PER_CONDITION, help="frames of each condition")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--frames-in", type=Path, help="folder of rendered frames; without it they are rendered")
    parser.add_argument("--results", nargs="*", default=[], metavar="NAME=FILE", help="results tables of other programs")
    parser.add_argument("--notes", type=Path, help="text to append, for example how the peers were run")
    parser.add_argument("--out", type=Path, default=Path("leaderboard.md"))
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = arguments.frames_in or Path(place) / "frames"
        if arguments.frames_in is None:
            write_benchmark(folder, seed=arguments.seed, frames=arguments.frames)
        peers = {}
        for given in arguments.results:
            label, _, path = given.partition("=")
            peers[label] = Path(path)
        notes = arguments.notes.read_text(encoding="utf-8") if arguments.notes else ""
        command = f"python benchmarks/leaderboard.py --frames {arguments.frames} --seed {arguments.seed}"
        arguments.out.write_text(page(folder, peers, command, notes), encoding="utf-8")


if __name__ == "__main__":
    main()
