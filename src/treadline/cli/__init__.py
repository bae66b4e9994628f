"""The command line: verbs in, files and one summary out.

Exit codes: 0 done; 1 the job ran and the answer is no; 2 the input is bad (one line on stderr); 130 interrupted.
Nothing heavy is imported here: each verb imports what it needs.
"""

import _thread
import os
import sys
import threading
import traceback
from collections.abc import Sequence
from typing import Annotated

import cyclopts
from cyclopts import App, Parameter

from treadline import __version__
from treadline.cli import (
    check,
    climb,
    doctor,
    excite,
    export,
    frames,
    identify,
    model,
    mount,
    node,
    nodes,
    record,
    replay,
    report,
    reproduce,
    seat,
    see,
    sweep,
    tune,
)
from treadline.cli.answer import Answer, say
from treadline.cli.numbers import check_whole_numbers
from treadline.errors import SimulationDiverged, TreadlineError

AGAIN_S = 0.05
"""After which an interrupt that was swallowed comes again."""
EPILOGUE = """\
Every verb takes --json (one JSON object on stdout, nothing else) and --debug (a traceback instead of one line).
Start with: treadline doctor; treadline check paper-28; treadline climb paper-28 --out runs/first
"""

app = App(
    name="treadline",
    help="Makes a tracked chair climb stairs by itself: simulate, see, identify, tune, climb and report.",
    help_epilogue=EPILOGUE,
    version=__version__,
    help_format="plaintext",
    suppress_keyboard_interrupt=False,
    default_parameter=Parameter(negative=()),
    config=check_whole_numbers,
)
for verb in (
    reproduce.reproduce,
    check.check,
    excite.excite,
    identify.identify,
    tune.tune,
    export.export,
    climb.climb,
    seat.seat,
    model.model,
    node.node,
    nodes.nodes,
    record.record,
    sweep.sweep,
    see.see,
    frames.frames,
    mount.mount,
    replay.replay,
    report.report,
    doctor.doctor,
):
    app.command(verb)


@app.meta.default
def _launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    json: Annotated[bool, Parameter(help="Print one JSON object and nothing else.", negative=())] = False,
    debug: Annotated[bool, Parameter(help="Show a traceback when something fails.", negative=())] = False,
) -> int:
    try:
        answer = app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
    except cyclopts.CycloptsError as error:
        return _fail(str(error).rstrip(".") + "; see treadline --help", 2, debug=debug)
    except SimulationDiverged as error:
        return _fail(str(error), 1, debug=debug)
    except TreadlineError as error:
        return _fail(str(error), 2, debug=debug)
    except KeyboardInterrupt:
        return _fail("interrupted; what was finished is readable", 130, debug=debug)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _fail(f"{where}{error.strerror or error}", 2, debug=debug)
    if isinstance(answer, Answer):
        say(answer, as_json=json)
        return answer.code
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    sys.unraisablehook = _lost_interrupts_again
    # One thread each for BLAS and OpenMP: the same sums in the same order, and no fight with the process pool.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    try:
        code = app.meta(tokens, exit_on_error=False, print_error=False, result_action="return_value")
    except cyclopts.CycloptsError as error:
        return _fail(str(error).rstrip(".") + "; see treadline --help", 2, debug=False)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return int(code or 0)


def _lost_interrupts_again(lost: "sys.UnraisableHookArgs") -> None:
    """Interrupt anew: a Ctrl-C that falls into a callback from compiled code is swallowed there."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        again = threading.Timer(AGAIN_S, _thread.interrupt_main)
        again.daemon = True
        again.start()
    else:
        sys.__unraisablehook__(lost)


def _fail(message: str, code: int, *, debug: bool) -> int:
    if debug:
        traceback.print_exc()
    sys.stderr.write(f"treadline: {' '.join(message.split())}\n")
    return code
