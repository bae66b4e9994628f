"""Policies tuned at belt friction 10 (as FTR-Bench has) and at 0.62/0.5 (Table I), run at both: does the order of policies change?

    python benchmarks/friction.py --episodes 200 --tuning 20 --workers 2 --out runs/friction

Task ``Straighten``; six proportional heading gains. A gain is chosen at each friction on seeds that no score uses, with the fast
numerical settings. Then all gains run at both frictions on the seeds of the bench with nominal settings. Written as
``friction.json``; the table goes to stdout.
"""

import argparse
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from tables import markdown

from treadline.bench.policies import proportional
from treadline.bench.scoring import BenchRun, run_bench
from treadline.core.files import write_json

GAINS = (0.15, 0.4, 0.7, 1.0, 1.6, 2.5)
"""Belt action per heading error [1/rad]: STAIRBENCH's prototype compared 0.4, 1.0 and 2.5."""
FRICTIONS = {"10": 10.0, "0.62/0.5": None}
"""Belt friction coefficient of each column; None: that of the task, Table I."""
TUNING_SEED = 1_000_000
"""First seed of the tuning; episodes of the bench have the seeds from 0 on."""


globals().update({f"Gain{number}": partial(proportional, gain=gain) for number, gain in enumerate(GAINS)})


def run_of(number: int, friction: float | None) -> BenchRun:
    return BenchRun(policy=f"{Path(__file__).resolve()}:Gain{number}", task="Straighten", friction=friction)


def tuned(friction: float | None, episodes: int) -> int:
    """Return the number of the gain with the best mean score."""
    runs = [replace(run_of(number, friction), physics="fast") for number in range(len(GAINS))]
    seeds = range(TUNING_SEED, TUNING_SEED + episodes)
    return int(np.argmax([np.mean([run(run.scenario(seed), seed, 0.0)["score"] for seed in seeds]) for run in runs]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--tuning", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/friction"))
    given = parser.parse_args()
    chosen = {name: tuned(friction, given.tuning) for name, friction in FRICTIONS.items()}
    found = {}
    for (number, gain), (name, friction) in product(enumerate(GAINS), FRICTIONS.items()):
        folder = given.out / f"gain-{gain:g}-at-{name.replace('/', '-')}"
        scores = run_bench(run_of(number, friction), ["Straighten"], given.episodes, given.workers, folder, lambda _: None)
        found[gain, name] = scores["tasks"]["Straighten"]
    lines = []
    for number, gain in enumerate(GAINS):
        cells = [found[gain, name] for name in FRICTIONS]
        scores = [f"{cell['score']:.2f} ({cell['interval'][0]:.2f} to {cell['interval'][1]:.2f})" for cell in cells]
        lines.append(f"| {gain:g} | {' | '.join(scores)} | {', '.join(name for name in FRICTIONS if chosen[name] == number)} |")
    markdown(f"| gain [1/rad] | {' | '.join(f'score at {name}' for name in FRICTIONS)} | tuned at |", lines)
    rows = [{"gain": gain, "friction": name} | cell for (gain, name), cell in found.items()]
    write_json(given.out / "friction.json", {"tuned": {name: GAINS[k] for name, k in chosen.items()}, "rows": rows})


if __name__ == "__main__":
    main()
