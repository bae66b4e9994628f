"""Time and accuracy of identification on Eq. (12): ``python benchmarks/identification.py``."""

import statistics
import time

import numpy as np

from treadline import paper
from treadline.identification import identify
from treadline.identification.validate import impulse_response, simulate
from treadline.models import InputOutputRecord, LinearModel

SEEDS = range(10)
REPEATS = 7
STEPS = 20
TRUE = LinearModel(
    A=paper.A.copy(),
    B=paper.B.copy(),
    C=paper.C.copy(),
    D=paper.D.copy(),
    dt_s=paper.SAMPLING_TIME_S,
    input_offset=np.zeros(2),
    output_offset=np.zeros(2),
)


def record(samples: int, noise: float, seed: int) -> InputOutputRecord:
    """Return random inputs and the outputs of Eq. (12), with white noise of a share of their deviation."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((samples, 2))
    y = simulate(TRUE, u, np.zeros(2))
    return InputOutputRecord(u=u, y=y + noise * y.std(axis=0) * rng.standard_normal(y.shape), dt_s=TRUE.dt_s)


def markov_error(model: LinearModel) -> float:
    """Return ‖Y - Ŷ‖/‖Y‖ over the first Markov parameters."""
    expected = impulse_response(TRUE, STEPS)
    return float(np.linalg.norm(impulse_response(model, STEPS) - expected) / np.linalg.norm(expected))


def cpu_s(data: InputOutputRecord) -> float:
    """Return the processor time of one identification, report and validation included."""
    started = time.process_time()
    identify(data)
    return time.process_time() - started


def main() -> None:
    print(f"identify on Eq. (12), 2 inputs and 2 outputs, lags and order automatic; seed 0, median of {REPEATS}, CPU")
    for samples in (1_000, 10_000, 100_000):
        data = record(samples, 0.01, 0)
        identify(data)  # the first call loads libraries
        times_ms = [1e3 * cpu_s(data) for _ in range(REPEATS)]
        print(f"  {samples:7d} samples   {statistics.median(times_ms):8.1f} ms  ({min(times_ms):.1f}…{max(times_ms):.1f})")
    print(f"relative error of {STEPS} Markov parameters, 1000 samples, order 2, seeds {SEEDS.start}…{SEEDS.stop - 1}")
    for noise in (0.0, 0.01, 0.1):
        errors = [markov_error(identify(record(paper.SAMPLES, noise, seed), order=2).model) for seed in SEEDS]
        mean, median, most = statistics.mean(errors), statistics.median(errors), max(errors)
        print(f"  noise {100.0 * noise:4.0f} %   mean {mean:.1e}   median {median:.1e}   max {most:.1e}")


if __name__ == "__main__":
    main()
