"""``treadline compile``: compile the kernels of the usual commands once, in two processes."""

import signal
from collections.abc import Callable
from contextlib import ExitStack, redirect_stderr
from io import StringIO
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from treadline.cli._output import Answer, Progress, say

COMPILING_TEXT = (
    "compiling for this machine, kept for later runs; this takes about half a minute (treadline compile does it once for all)"
)

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

    ``make setup`` runs this command. It takes about 80 s of CPU time on two cores, and two seconds when nothing has changed: each
    kernel is loaded, and a damaged one is compiled again.
    Kernels that few commands need (other depth cameras, the QR solver) are compiled when a command first calls them.
    """
    from treadline.core.compile_cache import marker_path
    from treadline.core.kernel_cache import kernel_caches

    damaged = {kernel: state for kernel in kernel_caches() if isinstance(state := kernel.state(), Exception)}
    for kernel, error in damaged.items():
        kernel.remove(error)
        marker_path().unlink(missing_ok=True)
    spent_s = compile_once()
    return Answer(
        values={"compiled": spent_s is not None, "cpu_s": spent_s, "mended": [kernel.name for kernel in damaged]},
        summary=["all kernels were compiled already" if spent_s is None else f"kernels compiled in {spent_s:.0f} s of CPU time"],
    )


def compile_once() -> float | None:
    """Compile the kernels of the usual commands unless that is done; return the CPU time of compiling [s], or None.

    A command that starts several processes calls this first, so that they do not compile the same kernels each.
    """
    from treadline.core.compile_cache import locked, marker_path
    from treadline.core.kernel_cache import kernel_caches

    marker = marker_path()
    if marker.exists():
        return None
    with locked(marker.with_suffix(".lock.nbs")):
        if marker.exists():  # another process compiled while this one waited for the lock
            return None
        with Progress("compile", len(kernel_caches())) as progress:
            progress.running("compilation of the kernels, in two processes")
            spent_s = _compile_groups(progress)
        marker.touch()
    return spent_s


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


GROUPS = {"stair detection": _call_detection, "the simulator, its camera and identification": _call_simulation}
"""Two halves of the kernels by their name in the progress line; numba's files cannot be written by two processes at once, so that
no kernel belongs to both."""


def _compile_groups(progress: Progress) -> float:
    """Compile each group in a process of its own; return the CPU time of compiling [s]."""
    spawn, names, spent_s = get_context("spawn"), dict[Any, str](), 0.0
    with ExitStack() as started:
        for name, group in GROUPS.items():
            ours, theirs = spawn.Pipe(duplex=False)
            process = spawn.Process(target=_compile, args=(group, theirs), daemon=True)
            process.start()
            started.callback(process.kill)
            theirs.close()
            names[ours] = name
        while names:
            for pipe in wait(list(names)):
                message = _receive(pipe, names[pipe])
                if message is None:
                    progress.done(f"kernels of {names[pipe]}")
                else:
                    spent_s += message
                    del names[pipe]
    return spent_s


def _receive(pipe: Any, name: str) -> float | None:
    """Return None for a compiled kernel, and at the end the CPU time [s].

    Raises:
        OSError: If the process was killed.
        Exception: What ended the group.
    """
    try:
        message: float | Exception | None = pipe.recv()
    except EOFError:
        raise OSError(f"the process that compiled {name} was killed; is there enough memory?") from None
    if isinstance(message, Exception):
        raise message
    return message


def _compile(group: Callable[[], None], pipe: Connection) -> None:
    """Compile a group; send None for each kernel, and at the end the CPU time or what went wrong."""
    from treadline.core.compile_cache import compiling
    from treadline.core.processes import end_with_parent

    signal.signal(signal.SIGINT, signal.SIG_DFL)  # the parent reports the interrupt
    end_with_parent()
    compiling().call_for_each(lambda: pipe.send(None))
    try:
        group()
        pipe.send(compiling().spent_s)
    except Exception as error:  # noqa: BLE001 - the parent raises it
        pipe.send(error)


def report_compiling() -> None:
    """Write one line to stderr if this command has to compile for long."""
    from treadline.core.compile_cache import compiling

    compiling().call_once_if_long(lambda: say(COMPILING_TEXT))
