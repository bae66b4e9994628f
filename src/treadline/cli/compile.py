"""``treadline compile``: compile the kernels of the usual commands once."""

import hashlib
import sqlite3
import sys
from contextlib import closing, redirect_stderr
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

from treadline.cli._output import Answer, Progress

RUNS = (
    "frames --out {}/frames --count 1 --seed 1",
    "climb flight-20 --set drive.duration_s=1 --out {}/climb",
    "excite flight-20 --samples 60 --out {}/excite",
    "identify {}/excite --method best --out {}/model.json",
)
"""Commands that call the kernels of the simulator, its camera and identification."""


def compile_() -> Answer:
    """Compile the kernels of the usual commands for this machine once, so that later commands start at once.

    ``make setup`` runs this command. It takes about 80 s, and a second when nothing has changed.
    Kernels that few commands need (other depth cameras, the QR solver) are compiled when a command first calls them. A file of a
    kernel that was damaged is found when it is loaded, and compiled again.
    """
    spent_s = compile_once()
    return Answer(
        values={"compiled": spent_s is not None, "cpu_s": spent_s},
        summary=["no kernel was left to compile" if spent_s is None else f"kernels compiled in {spent_s:.0f} s of CPU time"],
    )


def compile_once() -> float | None:
    """Compile the kernels of the usual commands unless that is done; return the CPU time of compiling [s], or None.

    A command that starts several processes calls this first, so that they do not compile the same kernels each.
    """
    marker = marker_path()
    if marker is None or marker.exists():
        return None
    # Ten minutes are five times what the other process takes on a slow machine.
    with closing(sqlite3.connect(marker.with_name("compiled.lock.nbs"), timeout=600.0)) as lock:
        lock.execute("BEGIN EXCLUSIVE")  # ends with the process, also with one that is killed
        if marker.exists():  # another process compiled while this one waited
            return None
        spent_s = _call_kernels()
        marker.touch()
    return spent_s


def marker_path() -> Path | None:
    """Return the file that says that ``compile`` has run; its name changes with kernels, compiler and processor.

    None if no folder for compiled kernels can be written, which the log says.
    """
    import numba
    from llvmlite import binding

    from treadline.core.kernel_cache import njit

    stamps = [(path, path.stat().st_mtime_ns) for path in sorted(Path(__file__).parents[1].rglob("*_kernels.py"))]
    state = (numba.__version__, sys.version, binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten(), stamps)
    fingerprint = hashlib.sha256(repr(state).encode()).hexdigest()[:16]
    folder = njit(cache=True)(marker_path).stats.cache_path  # where numba keeps the kernels of this folder
    return None if folder is None else Path(folder) / f"compiled-{fingerprint}.nbs"


def _call_kernels() -> float:
    """Call the kernels by short runs of the usual commands; return the CPU time of compiling [s]."""
    from treadline.cli import app
    from treadline.core.kernel_cache import compiling
    from treadline.ros.assembly import node_of
    from treadline.run.resolve import resolve

    with TemporaryDirectory() as folder, Progress("compile", len(RUNS)) as progress, redirect_stderr(StringIO()):
        node_of("camera", resolve("up-28").mission)  # sees synthetic frames when it starts
        for command in RUNS:
            app(command.replace("{}", folder).split(), exit_on_error=False, print_error=False, result_action="return_value")
            progress.done(command.split()[0])
    return compiling().spent_s
