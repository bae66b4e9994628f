"""``treadline compile``: compile all kernels once, by short runs of the commands that use them."""

from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

from treadline.cli._output import Answer, Progress, say

COMPILING_TEXT = (
    "compiling for this machine, kept for later runs; this takes about half a minute (treadline compile does it once for all)"
)

SCENARIOS = {
    "flight": 'start = {place = "flight", step = 4, heading_deg = 5}\ndrive.duration_s = 6',
    "lugs": """
        start = {place = "flight", step = 4}
        drive.duration_s = 1
        belts.lug = "15/80"
        sensors.camera = "statistical"
    """,
    "down": """
        stair = {slope_deg = 28, steps = 8, landing_m = 3.0}
        start.place = "landing"
        drive = {direction = "down", duration_s = 3}
    """,
}
"""Scenarios of the short runs, by name."""

JOBS = (
    ("rendered frames", "frames --out {}/frames --count 12 --seed 1"),
    ("rendered frames, Kinect 2", "frames --out {}/kinect2 --count 1 --sensor kinect2"),
    ("rendered frames, time of flight", "frames --out {}/tof --count 1 --sensor tof"),
    ("rendered frames, stereo", "frames --out {}/d435 --count 1 --sensor d435"),
    ("stair detection", "see {}/frames"),
    ("stair detection, Algorithm 1", "see {}/frames --method paper"),
    ("simulator", "climb {}/flight.toml --out {}/run --log-images"),
    ("belts with lugs", "climb {}/lugs.toml --out {}/lugs"),
    ("descent", "climb {}/down.toml --out {}/down"),
    ("replay", "replay {}/run --out {}/again"),
    ("camera mount", "mount {}/run --out {}/mounted.toml"),
    ("seat", "seat {}/flight.toml --out {}/seat"),
    ("excitation", "excite {}/flight.toml --samples 120 --out {}/excite"),
    ("identification", "identify {}/excite --method best --out {}/model.json"),
    ("identification, QR", "identify {}/excite --method okid-era --solver qr --out {}/model-qr.json"),
)
"""Commands that call every kernel with every type of argument, with what each compiles."""


def compile_() -> Answer:
    """Compile all kernels for this machine once, so that later commands start at once.

    ``make setup`` runs this command. It takes about a minute of CPU time, and less than a second when nothing has changed.
    """
    spent_s = compile_once()
    return Answer(
        values={"compiled": spent_s is not None, "cpu_s": spent_s},
        summary=[
            "all kernels were compiled already" if spent_s is None else f"all kernels compiled in {spent_s:.0f} s of CPU time"
        ],
    )


def compile_once() -> float | None:
    """Compile all kernels unless that is done; return the CPU time of compiling [s], or None.

    A command that starts several processes calls this first, so that they do not compile the same kernels each.
    """
    from treadline.core.compile_cache import locked, marker_path

    marker = marker_path()
    if marker.exists():
        return None
    with locked(marker.with_suffix(".lock.nbs")):
        if marker.exists():  # another process compiled while this one waited for the lock
            return None
        spent_s = _run_jobs()
        marker.touch()
    return spent_s


def _run_jobs() -> float:
    from treadline.cli import app
    from treadline.core.compile_cache import compiling

    started_s = compiling().spent_s
    with TemporaryDirectory() as folder, Progress("compile", len(JOBS)) as progress:
        for name, text in SCENARIOS.items():
            (Path(folder) / f"{name}.toml").write_text(text, encoding="utf-8")
        for name, command in JOBS:
            with redirect_stderr(StringIO()):  # the progress of these runs is not the user's
                app(command.replace("{}", folder).split(), exit_on_error=False, print_error=False, result_action="return_value")
            progress.done(name)
    return compiling().spent_s - started_s


def report_compiling() -> None:
    """Write one line to stderr if this command has to compile for long."""
    from treadline.core.compile_cache import compiling

    compiling().call_once_if_long(lambda: say(COMPILING_TEXT))
