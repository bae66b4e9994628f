"""``treadline compile``: compile the kernels of the usual commands once, in two processes."""

import hashlib
import signal
import sqlite3
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, redirect_stderr
from io import StringIO
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from treadline.cli._output import Answer, Share, say

COMPILING_TEXT = (
    "compiling for this machine, kept for later runs; this takes about half a minute (treadline compile does it once for all)"
)
LONG_S = 1.0
"""CPU time of compiling that counts as long [s]; loading every kernel from disk compiles nothing."""
SCENARIO = """
start = {place = "flight", step = 4, heading_deg = 5}
drive.duration_s = 1
sensors.camera = "statistical"
"""
"""Scenario of the short runs: without images, so that they call no kernel of the detector."""
RUNS = (
    "frames --out {}/frames --count 1 --seed 1",
    "climb {}/short.toml --out {}/climb",
    "excite {}/short.toml --samples 60 --out {}/excite",
    "identify {}/excite --method best --out {}/model.json",
)
"""Commands that call the kernels of the simulator, its camera and identification."""


def compile_() -> Answer:
    """Compile the kernels of the usual commands for this machine once, so that later commands start at once.

    ``make setup`` runs this command. It takes about 80 s of CPU time on two cores, and a second when nothing has changed.
    Kernels that few commands need (other depth cameras, the QR solver) are compiled when a command first calls them. A file of a
    kernel that was damaged is found when it is loaded, and compiled again.
    """
    spent_s = compile_once()
    return Answer(
        values={"compiled": spent_s is not None, "cpu_s": spent_s},
        summary=["all kernels were compiled already" if spent_s is None else f"kernels compiled in {spent_s:.0f} s of CPU time"],
    )


def compile_once() -> float | None:
    """Compile the kernels of the usual commands unless that is done; return the CPU time of compiling [s], or None.

    A command that starts several processes calls this first, so that they do not compile the same kernels each.
    """
    marker = marker_path()
    if marker.exists():
        return None
    marker.parent.mkdir(parents=True, exist_ok=True)
    # Ten minutes are ten times what the other process takes on a slow machine.
    with closing(sqlite3.connect(marker.with_name("compiled.lock.nbs"), timeout=600.0)) as lock:
        lock.execute("BEGIN EXCLUSIVE")  # ends with the process, also with one that is killed
        if marker.exists():  # another process compiled while this one waited
            return None
        spent_s = _compile_groups()
        marker.touch()
    return spent_s


def marker_path() -> Path:
    """Return the file that says that ``compile`` has run; its name changes with kernels, compiler and processor.

    Raises:
        TreadlineError: If no folder for compiled kernels can be written.
    """
    import llvmlite
    import numba
    from llvmlite import binding

    from treadline.core.errors import TreadlineError
    from treadline.core.kernel_cache import REMEDY

    parts = [numba.__version__, llvmlite.__version__, sys.version]
    parts += [binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()]
    stamps = {path: path.stat() for path in kernel_sources()}
    parts += [f"{path}:{stamp.st_mtime_ns}:{stamp.st_size}" for path, stamp in stamps.items()]
    try:
        place: Any = numba.njit(cache=True)(marker_path).stats.cache_path  # where numba keeps the kernels of this folder
    except RuntimeError:
        raise TreadlineError(f"no folder for compiled kernels can be written: {REMEDY}") from None
    fingerprint = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]
    return Path(place) / f"compiled-{fingerprint}.nbs"


def kernel_sources() -> list[Path]:
    """Return the source files of the kernels."""
    return sorted(Path(__file__).parents[1].rglob("*_kernels.py"))


def _call_detection() -> None:
    """Call the kernels of stair detection: a camera node sees synthetic frames when it starts."""
    from treadline.ros.assembly import node_of
    from treadline.run.resolve import resolve

    node_of("camera", resolve("up-28").mission)


def _call_simulation() -> None:
    """Call the kernels of the simulator, of rendered frames and of identification: short runs of the commands."""
    from treadline.cli import app

    with TemporaryDirectory() as folder, redirect_stderr(StringIO()):  # the progress of these runs is not the user's
        (Path(folder) / "short.toml").write_text(SCENARIO, encoding="utf-8")
        for command in RUNS:
            app(command.replace("{}", folder).split(), exit_on_error=False, print_error=False, result_action="return_value")


GROUPS: tuple[Callable[[], object], ...] = (_call_detection, _call_simulation)
"""Two halves of the kernels; numba's files cannot be written by two processes at once, so that no kernel belongs to both."""


def _compile_groups() -> float:
    """Compile each group in a process of its own; return the CPU time of compiling [s]."""
    from treadline.core.errors import TreadlineError

    count = sum(path.read_text(encoding="utf-8").count("@njit(") for path in kernel_sources())
    spawn = get_context("spawn")
    compiled = spawn.Value("i", 0)
    with (
        Share("compile", lambda: compiled.value / count) as share,
        ProcessPoolExecutor(len(GROUPS), spawn, _begin_worker, (compiled,)) as pool,
    ):
        share.running("compilation of the kernels, in two processes")
        groups = [pool.submit(_compile, group) for group in GROUPS]
        for _ in share.of(iter(lambda: wait(groups, timeout=0.5).not_done, set())):
            pass
        try:
            return sum(group.result() for group in groups)
        except BrokenProcessPool:
            raise TreadlineError("a process that compiled kernels was killed; is there enough memory?") from None


def _begin_worker(compiled: Any) -> None:
    """Count each compiled kernel; the parent reports an interrupt, and its end ends the worker."""
    from treadline.core.kernel_cache import compiling
    from treadline.core.processes import end_with_parent

    def count() -> None:
        with compiled.get_lock():
            compiled.value += 1

    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent()
    compiling().on_kernel = count


def _compile(group: Callable[[], object]) -> float:
    """Compile a group; return the CPU time of compiling [s]."""
    from treadline.core.kernel_cache import compiling

    group()
    return compiling().spent_s


def report_compiling() -> None:
    """Write one line to stderr if this command has to compile for long."""
    from treadline.core.kernel_cache import compiling

    def report() -> None:
        if compiling().spent_s > LONG_S:
            compiling().on_kernel = None
            say(COMPILING_TEXT)

    compiling().on_kernel = report
