"""Identification next to peer libraries: ``python benchmarks/identification.py [--quick] [--only accuracy|speed|real]``.

Peers take part where they are installed: ``pip install -e ".[dev]" control sippy_unipi nfoursid jax-sysid``,
``apt-get install libslicot0 libopenblas0``, and modred as a run without it says. Accuracy is the relative error of Markov
parameters, with the Cramér–Rao bound of the same inputs; speed is processor time on one thread; real data are judged by
free runs on the half that did not estimate. One module (``score.py``) scores every model. On simulated systems peers get the best
of several numbers of block rows, chosen by ground truth, on measured ones what ``real.py`` says; for treadline, only the method
is chosen.
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
import peers
import real
import scipy
import speed
from systems import DATA_SETS, halves
from tables import Row, percent, table

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "sysid"
SEEDS, QUICK_SEEDS = 20, 4
RUNS, QUICK_RUNS = 200, 10
SEARCH_S, QUICK_SEARCH_S = 6.0, 1.0
"""CPU time of a peer's search for order and block rows on one cut [s]."""
SLOW = {"SIPPY CVA", "nfoursid", "jax-sysid"}
"""Peers left out of a quick run: slow on the longer records, or close to another method of the same package."""


def accuracy_part(fits: dict[str, peers.Fit], first: int, *, quick: bool) -> None:
    """Print Markov errors, then the coverage of the intervals."""
    seeds, runs = range(first, first + (QUICK_SEEDS if quick else SEEDS)), range(first, first + (QUICK_RUNS if quick else RUNS))
    cases = accuracy.cases()
    for case in cases:
        accuracy.markov_table(case, fits, seeds)
    for case in cases[1:4]:
        accuracy.coverage_table(case, runs)


def real_part(fits: dict[str, peers.Fit], folder: Path, search_s: float) -> None:
    """Print the scores of each cut, then all side by side, then ours against each single peer."""
    cuts: dict[str, dict[str, real.Score]] = {}
    for data, turned in ((data, turned) for data in DATA_SETS for turned in (False, True)):
        if not (folder / data.file).is_file():
            print(f"\n{data.name}: no {data.file} in {folder}; name the folder with --data")
            continue
        name = f"{data.name}, turned" if turned else data.name
        found = list(real.scores(*halves(data, folder, turned=turned), fits, search_s))
        rows = [(score.method, percent(score.percent), score.choice, score.cpu_s) for score in found]
        table(f"{name}: fit % of a free run on the half that did not estimate", ("method", "fit %", "choice", "CPU s"), rows)
        print("\n".join(f"  {score.method} warns: {note}" for score in found for note in score.notes))
        cuts[name] = {score.method: score for score in found}
    if cuts:
        _summary(cuts)


def _summary(cuts: dict[str, dict[str, real.Score]]) -> None:
    methods = list(next(iter(cuts.values())))
    rows: list[Row] = [(name, *(percent(by[method].percent) for method in methods)) for name, by in cuts.items()]
    table("free runs, fit %", ("cut", *methods), rows)
    against: list[Row] = []
    for method in methods:
        able = [by for by in cuts.values() if by[method].percent > 0.0]
        close = [by for by in able if by["best"].percent > by[method].percent - real.CLOSE_POINTS]
        close_to = [
            by for by in cuts.values() if by["best"].percent <= 0.0 or by[method].percent > by["best"].percent - real.CLOSE_POINTS
        ]
        cpu_s = sum(by[method].cpu_s for by in cuts.values())
        against.append(
            (method, f"{len(able)} of {len(cuts)}", f"{len(close)} of {len(able)}", f"{len(close_to)} of {len(cuts)}", cpu_s)
        )
    heads = ("method", "above 0 on", "best at most 2 points behind it", "it at most 2 behind best", "CPU s")
    table("`best` against each single method", heads, against)


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
        real_part(fits, given.data, QUICK_SEARCH_S if given.quick else SEARCH_S)
    print(f"\n{time.process_time() - started:.0f} s of processor time")


if __name__ == "__main__":
    main()
