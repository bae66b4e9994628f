"""Processor time on one thread, and peak memory on a long record."""

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import ours
from peers import Fit, PeerError, python_packages, slicot
from score import markov
from systems import driven, equation_12, light_damping
from tables import Row, table

from treadline.core.models import InputOutputRecord
from treadline.identification import IdentificationOptions, identify

GRID = ((1_000, 20), (100_000, 20), (1_000_000, 20), (1_000_000, 50), (10_000_000, 50))
QUICK_GRID = GRID[:2]
CONTROL_MOST = 100_000
"""Longest record given to python-control [samples]: it stores all regressors, 1.3 GB at a million samples."""
LONG = 1_000_000
QUICK_WAYS = {"okid-era (gram)", "pbsid"}
"""Methods that also run on records longer than ``LONG``; the others would take minutes."""
REPORTED = {"okid-era (gram)", "best"}
HANKEL_ROWS = 1000
HANKEL_RANK = 20


def speed_tables(fits: dict[str, Fit], seed: int, *, quick: bool) -> None:
    """Print the times of identification, of the Hankel decomposition, and the memory of the longest record."""
    for samples, lags in QUICK_GRID if quick else GRID:
        _identification(fits, samples, lags, seed)
    _hankel(fits, quick=quick)
    if not quick:
        _memory(*GRID[-1], seed)


def _identification(fits: dict[str, Fit], samples: int, lags: int, seed: int) -> None:
    record = driven(equation_12(), samples, 0.01, seed).record
    repeats = 50 if samples <= 1_000 else 7 if samples <= 100_000 else 3 if samples <= 1_000_000 else 1
    own: dict[str, Callable[[], object]] = {"Gram alone": partial(ours.gram_alone, record, lags)}
    for name, arguments in ours.WAYS.items():
        if samples <= LONG or name in QUICK_WAYS:
            own[f"identify, {name}"] = partial(
                identify, record, IdentificationOptions(order=2, lags=lags, feedthrough=True, **arguments)
            )
        if name in REPORTED and (samples <= LONG or name in QUICK_WAYS):
            own[f"and its report, {name}"] = partial(_reported, record, lags, arguments)
    times = {name: cpu_s(work, repeats) for name, work in own.items()}
    peers = {name: cpu_s(work, repeats) for name, work in _peer_work(fits, record, lags).items()}
    best = min((value for value in peers.values() if value is not None), default=np.nan)
    rows: list[Row] = [_timed(name, value, best) for name, value in (times | peers).items()]
    title = f"{samples:,} samples, {lags} lags: CPU s, Eq. (12), noise 1 %, order 2 given, seed {seed}, median of {repeats}"
    table(title, ("what", "CPU s", "/best peer"), rows)


def _reported(record: InputOutputRecord, lags: int, arguments: dict[str, Any]) -> object:
    """Identify and judge: free run, whiteness, intervals. A version may leave them until they are asked for."""
    return identify(record, IdentificationOptions(order=2, lags=lags, feedthrough=True, **arguments)).report


def _timed(name: str, value: float | None, best: float) -> Row:
    return (name, "–", "–") if value is None else (name, f"{value:.3g}", value / best)


def _peer_work(fits: dict[str, Fit], record: InputOutputRecord, lags: int) -> dict[str, Callable[[], object]]:
    """Return the peers' fastest settings; SLICOT's also with half the block rows, so that its whole window is ``lags``."""
    work: dict[str, Callable[[], object]] = {}
    if "SLICOT combined" in fits:
        for rows in (lags, lags // 2):
            work[f"SLICOT combined, Cholesky, {rows} block rows"] = partial(slicot.fit, record, 2, rows, method="C", cholesky=True)
    if "python-control" in fits and len(record.u) <= CONTROL_MOST:
        work[f"python-control, {2 * (lags // 2) + 1} parameters"] = partial(python_packages.control_fit, record, 2, lags // 2)
    others = {name: fit for name, fit in fits.items() if name in {"SIPPY N4SID", "nfoursid"} and len(record.u) <= 1_000}
    return work | {f"{name}, {lags} block rows": partial(fit, record, 2, lags) for name, fit in others.items()}


def cpu_s(work: Callable[[], object], repeats: int) -> float | None:
    """Return the median processor time; one untimed call loads libraries. None where the work cannot be done."""
    spent = []
    try:
        for _ in range(repeats + (repeats > 1)):
            started = time.process_time()
            work()
            spent.append(time.process_time() - started)
    except (PeerError, *ours.FAILURES, MemoryError) as error:
        print(f"  not timed: {error}")
        return None
    return statistics.median(spent[1:] if repeats > 1 else spent)


def _hankel(fits: dict[str, Fit], *, quick: bool) -> None:
    response = markov(light_damping(HANKEL_RANK // 2), 2 * HANKEL_ROWS + 1)
    times = {"treadline": cpu_s(partial(ours.realise, response, HANKEL_RANK, HANKEL_ROWS), 1 if quick else 3)}
    if "python-control" in fits and not quick:
        import control

        turned = np.moveaxis(response, 0, 2)
        realise = partial(control.eigensys_realization, turned, HANKEL_RANK, m=HANKEL_ROWS, n=HANKEL_ROWS)
        times["python-control"] = cpu_s(realise, 1)
    best = times.get("python-control") or np.nan
    rows = [_timed(name, value, best) for name, value in times.items()]
    table(
        f"Hankel {2 * HANKEL_ROWS} by {2 * HANKEL_ROWS}, rank {HANKEL_RANK}, to A, B, C, D: CPU s",
        ("what", "CPU s", "/best peer"),
        rows,
    )


def _memory(samples: int, lags: int, seed: int) -> None:
    """Print the peak of a process that loads the record and identifies."""
    with tempfile.TemporaryDirectory() as folder:
        record = driven(equation_12(), samples, 0.01, seed).record
        np.save(Path(folder) / "u.npy", record.u)
        np.save(Path(folder) / "y.npy", record.y)
        del record
        command = [sys.executable, str(Path(__file__).with_name("identification.py")), "--memory-of", folder, "--lags", str(lags)]
        answer = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    print(f"\n{samples:,} samples, {lags} lags, identify okid-era, order 2, in a process of its own: {answer.strip()}")


def memory_of(folder: Path, lags: int) -> None:
    """Identify the record in a folder and print this process's peak before and after."""
    u, y = (np.load(folder / name, allow_pickle=False) for name in ("u.npy", "y.npy"))
    before = peak_mb()
    found = identify(
        InputOutputRecord(u=u, y=y, dt_s=1.0), IdentificationOptions(order=2, lags=lags, feedthrough=True, method="okid-era")
    )
    fitted, _ = peak_mb(), found.report
    data = (u.nbytes + y.nbytes) / 1e6
    print(f"peak {fitted:.0f} MB, {peak_mb():.0f} MB with its report; {before:.0f} MB once the data ({data:.0f} MB) were loaded")


def peak_mb() -> float:
    """Return the largest resident size so far (Linux).

    ``getrusage`` would count the parent's as well: its figure survives the start of a new program.
    """
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines())
    return float(status["VmHWM"].split()[0]) * 1024.0 / 1e6
