"""The command line: verbs in, files and one summary out.

Exit codes: 0 done; 1 the job ran and the answer is no; 2 the input is bad, or the answer cannot be written (one line on
stderr); 130 interrupted; 143 asked to end.
Nothing heavy is imported here, nor at the top of a verb's module: a verb imports what it needs.
"""

import _thread
import io
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stderr, suppress
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import cyclopts
from cyclopts import App, Group, Parameter

from treadline import __version__, gone
from treadline.cli._arguments import check_whole_numbers
from treadline.cli._output import Answer, start_line
from treadline.core.errors import SimulationDiverged, TreadlineError
from treadline.core.processes import Terminated, on_terminate

AGAIN_S = 0.25
"""Delay after which a lost interrupt is sent again [s]: longer than a burst that counts as one (``interrupts``)."""

app = App(
    name="treadline",
    help="Makes a tracked chair climb stairs by itself: simulate, see, identify, tune, climb and report.",
    help_epilogue="Start with: treadline demo; treadline climb up-28 --out runs/first; treadline view runs/first",
    version=__version__,
    help_format="plaintext",
    suppress_keyboard_interrupt=False,
    default_parameter=Parameter(negative=()),
    config=check_whole_numbers,
)
VERBS = {
    "The paper": ("reproduce", "report"),
    "Simulation": ("demo", "check", "climb", "view", "seat", "sweep", "bench", "import", "model"),
    "Identification and control": ("excite", "identify", "tune", "export"),
    "Perception": ("see", "frames"),
    "Logs and ROS": ("replay", "record", "nodes", "node"),
    "Real chairs": ("drive",),
    "Installation": ("doctor", "compile"),
}
"""Verbs by the heading under which ``--help`` lists them."""
MODULES = {"demo": "view", "import": "import_", "model": "export", "record": "node", "report": "reproduce", "seat": "climb"}
"""Module of a verb that shares the module of another verb."""
FUNCTIONS = {"compile": "compile_", "import": "import_"}
"""Function of a verb whose name Python uses itself."""
GROUPS = {heading: Group(heading, sort_key=number) for number, heading in enumerate(VERBS)}
for heading, verbs in VERBS.items():
    for verb in verbs:  # a verb's module is imported when the verb is run, or its help is shown
        path = f"treadline.cli.{MODULES.get(verb, verb)}:{FUNCTIONS.get(verb, verb)}"
        app.command(path, name=verb, group=GROUPS[heading], help_epilogue="")
app.register_install_completion_command(group=GROUPS["Installation"])


@app.meta.default
def _launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    json: Annotated[bool, Parameter(help="Print one JSON object and nothing else.", negative=())] = False,
    debug: Annotated[bool, Parameter(help="Show a traceback when something fails.", negative=())] = False,
) -> int:
    try:
        answer = app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
    except cyclopts.CycloptsError as error:
        return _fail(_usage(error), 2, debug=debug)
    except SimulationDiverged as error:
        return _fail(str(error), 1, debug=debug)
    except TreadlineError as error:
        return _fail(str(error), 2, debug=debug)
    except KeyboardInterrupt as error:
        return _ended(error, debug=debug)
    except SystemError as error:
        if (interrupt := _interrupt_behind(error)) is None:
            raise
        return _ended(interrupt, debug=debug)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _fail(f"{where}{error.strerror or error}", 2, debug=debug)
    if isinstance(answer, Answer):
        answer.write(as_json=json)
        return answer.code
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    sys.unraisablehook = _lost_interrupts_again
    # One thread each for BLAS and OpenMP: the same sums in the same order, and no fight with the process pool.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    announced = start_line(tokens) if arguments is None else nullcontext()
    with _streams(), _heeding_requests_to_end(), announced:
        if tokens[:1] == ["help"]:
            tokens = [*tokens[1:], "--help"]
        if not tokens or tokens[0] in ("-h", "--help"):  # the list of verbs, each with the first line of its help
            app.resolved_commands()
        return _run(tokens)


def _run(tokens: list[str]) -> int:
    verb = next((token for token in tokens if not token.startswith("-")), "")
    words = " ".join(tokens).replace("=", " ").split()
    if left := gone(f"treadline {verb}", *map(" ".join, pairwise(words))):
        return _fail(left, 2, debug=False)
    try:
        code = app.meta(tokens, exit_on_error=False, print_error=False, result_action="return_value")
        if sys.stdout is not None:
            sys.stdout.flush()
    except cyclopts.CycloptsError as error:
        return _fail(_usage(error), 2, debug=False)
    except (BrokenPipeError, SystemExit):  # the reader has heard enough; rich, which prints the help, exits then
        _leave_stdout()
        return 0
    except OSError as error:
        _leave_stdout()
        return _fail(f"the answer cannot be written to stdout: {error.strerror or error}", 2, debug=False)
    return int(code or 0)


@contextmanager
def _streams() -> Iterator[None]:
    """Let no sign stop an answer that stdout's encoding lacks; without a stderr, messages go nowhere."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    if sys.stderr is not None:
        yield
        return
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere, redirect_stderr(nowhere):
        yield


def _leave_stdout() -> None:
    """Let what is still in stdout's buffer go nowhere: Python would try again at its end, and complain."""
    with suppress(OSError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def _heeding_requests_to_end() -> Iterator[None]:
    """Raise ``Terminated`` at a SIGTERM; only the main thread hears signals."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, on_terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _lost_interrupts_again(lost: "sys.UnraisableHookArgs") -> None:
    """Interrupt anew: a Ctrl-C or a request to end that falls into a callback from compiled code is swallowed there."""
    if (interrupt := _interrupt_behind(lost.exc_value)) is not None:
        number = signal.SIGTERM if isinstance(interrupt, Terminated) else signal.SIGINT
        again = threading.Timer(AGAIN_S, _thread.interrupt_main, [number])
        again.daemon = True
        again.start()
    else:
        sys.__unraisablehook__(lost)


def _interrupt_behind(cause: BaseException | None) -> KeyboardInterrupt | None:
    """Return the Ctrl-C or request to end that fell into compiled code: each value being returned wraps it once more."""
    while isinstance(cause, SystemError):
        cause = cause.__cause__
    return cause if isinstance(cause, KeyboardInterrupt) else None


def _ended(by: KeyboardInterrupt, *, debug: bool) -> int:
    said, code = ("asked to end", 143) if isinstance(by, Terminated) else ("interrupted", 130)
    further = getattr(by, "__notes__", [])  # what a verb knows beyond that
    return _fail("; ".join([said, "what was finished by then, if anything, is readable", *further]), code, debug=debug)


def _usage(error: cyclopts.CycloptsError) -> str:
    if isinstance(error, cyclopts.MissingArgumentError) and error.argument is not None and error.keyword is None:
        verb = " ".join(error.command_chain or ())
        return f"{verb} requires {error.argument.name}; see treadline {verb} --help"
    if isinstance(error, cyclopts.UnusedCliTokensError):
        verb = " ".join(error.command_chain or ())
        return f"{verb} has no use for {' '.join(error.unused_tokens or ())}; see treadline {verb} --help"
    said = str(error).partition(" Available commands:")[0].rstrip(".")  # a list that is cut off after a few
    return said + (" See treadline --help" if said.endswith("?") else "; see treadline --help")


def _fail(message: str, code: int, *, debug: bool) -> int:
    if debug:
        traceback.print_exc()
    sys.stderr.write(f"treadline: {' '.join(message.split())}\n")
    return code
