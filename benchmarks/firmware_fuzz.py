"""Compare the firmware in C with its twin in Python on random traffic, tick by tick.

Run: ``python benchmarks/firmware_fuzz.py --ticks 10000000 --seed 60000`` (7 minutes of CPU). A run of the traffic has 10,000 ticks
and a seed of its own. The memory of the rules and the outputs are compared after each tick. Ends with 1 at the first difference.
"""

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "builders"))

from firmware_memory import first_difference

RUN_TICKS = 10_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=10_000_000)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    runs = -(-asked.ticks // RUN_TICKS)
    for run in range(runs):
        difference = first_difference(asked.seed + run, RUN_TICKS)
        if difference is not None:
            sys.exit(difference)
    seeds = f"seeds {asked.seed} to {asked.seed + runs - 1}"
    print(f"{runs * RUN_TICKS:,} ticks, {seeds}: no difference; {time.process_time():.0f} s of CPU")


if __name__ == "__main__":
    main()
