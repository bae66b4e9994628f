"""Identification next to peer libraries: ``python benchmarks/identification.py [--quick] [--only accuracy|speed|real]``.

Peers take part where they are installed: ``pip install -e ".[dev]" control sippy_unipi nfoursid``,
``apt-get install libslicot0 libopenblas0``, and modred as a run without it says. Accuracy is the relative error of Markov
parameters, with the Cramér–Rao bound of the same inputs; speed is processor time on one thread; real data are judged by
free runs on the second half. One module (``score.py``) scores every model. Peers get the best of several numbers of block rows,
chosen by ground truth; for treadline, only the method is chosen.
"""
# ruff: noqa: E402 (the number of threads must be set before a BLAS is loaded)

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import platform
import time
import warnings
from pathlib import Path

import accuracy
import numpy as np
import ours
import peers
import real
import scipy
import speed
from score import fits_apart
from systems import DATA_SETS, DataSet, halves
from tables import Row, percent, table

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "sysid"
SEEDS, QUICK_SEEDS = 20, 4
RUNS, QUICK_RUNS = 200, 10
SLOW = {"SIPPY PARSIM-K", "SIPPY CVA", "nfoursid"}
"""Peers left out of a quick run: slow on the longer records, or close to another method of the same package."""


def accuracy_part(fits: dict[str, peers.Fit], first: int, *, quick: bool) -> None:
    """Print Markov errors, then the coverage of the intervals."""
    seeds, runs = range(first, first + (QUICK_SEEDS if quick else SEEDS)), range(first, first + (QUICK_RUNS if quick else RUNS))
    cases = accuracy.cases()
    for case in cases:
        accuracy.markov_table(case, fits, seeds)
    for case in cases[1:4]:
        accuracy.coverage_table(case, runs)


def real_part(fits: dict[str, peers.Fit], folder: Path, *, quick: bool) -> None:
    """Print a table per measured set, and one line for each at the end."""
    if not folder.is_dir():
        print(f"\nreal data: no folder {folder}; name it with --data")
        return
    summary: list[Row] = []
    for data in DATA_SETS:
        if not (folder / data.file).is_file():
            print(f"\n{data.name}: no {data.file} in {folder}")
        elif quick and len(halves(data, folder)[0].u) > real.QUICK_SAMPLES:
            print(f"\n{data.name}: left out of a quick run")
        else:
            summary.append(_one_set(data, folder, fits))
    own = list(ours.WAYS)
    table(
        "free run on the second half, fit % (no seeds: nothing is drawn)",
        ("set", *own, "best peer", "which", f"{own[-1]} less best peer: 95 % of records", "known before"),
        summary,
    )


def _one_set(data: DataSet, folder: Path, fits: dict[str, peers.Fit]) -> Row:
    scores = list(real.scores(data, folder, fits))
    rows = [(score.method, percent(score.percent), score.choice) for score in scores]
    table(f"{data.name}: fit % of a free run on the second half", ("method", "fit %", "choice"), rows)
    told = list(ours.WAYS)[-1:]  # the way that chooses most by itself is the one whose warnings count
    for note in (note for score in scores if score.method in told for note in score.notes):
        print(f"  {told[0]} warns: {note}")
    best = max((score for score in scores if score.is_peer), key=lambda score: score.percent, default=None)
    shown = [percent(score.percent) for score in scores if score.method in ours.WAYS]
    known = "–" if data.known_percent is None else f"{data.known_percent:.1f}"
    if best is None or best.model is None:
        return (data.name, *shown, "–", "–", "–", known)
    model = next((score.model for score in scores if score.method in told), None)
    apart = "–"
    if model is not None:
        low, high = fits_apart(model, best.model, halves(data, folder)[1])
        apart = f"{low:+.1f} to {high:+.1f}"
    return (data.name, *shown, percent(best.percent), best.method, apart, known)


def main() -> None:
    """Print the tables asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer seeds, runs and samples; under two minutes")
    parser.add_argument("--only", choices=("accuracy", "speed", "real"))
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the measured sets")
    parser.add_argument("--memory-of", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--lags", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.memory_of is not None:
        speed.memory_of(given.memory_of, given.lags)
        return
    started = time.process_time()
    warnings.simplefilter("ignore")  # a peer's divisions by zero are its own; what failed is counted
    fits, lines = peers.installed()
    print(f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}, one BLAS thread")
    print("\n".join(lines))
    if given.quick:
        fits = {name: fit for name, fit in fits.items() if name not in SLOW}
        print(f"quick: fewer seeds, runs and samples, and without {', '.join(sorted(SLOW))}")
    if given.only in {None, "accuracy"}:
        accuracy_part(fits, given.seed, quick=given.quick)
    if given.only in {None, "speed"}:
        speed.speed_tables(fits, given.seed, quick=given.quick)
    if given.only in {None, "real"}:
        real_part(fits, given.data, quick=given.quick)
    print(f"\n{time.process_time() - started:.0f} s of processor time")


if __name__ == "__main__":
    main()
