"""``treadline see --live``: one updating line and the newest picture, until Ctrl-C or a duration ends."""

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from treadline.cli.answer import Answer

LINE_S = 1.0
"""Interval of the lines where stderr is no terminal [s]."""
PICTURE_S = 0.5
"""Shortest interval between two pictures [s]: drawing one takes longer than detecting the stair."""
NAME = "live-seen.png"
"""File name of the newest picture."""


def see_live(
    name: str, *, camera: Path | None, gravity: str | None, seconds: float | None, headings: Path | None, out: Path | None
) -> Answer:
    """Detect the stair in the frames of a live camera.

    Raises:
        CameraError: If the camera is missing, busy, or stops.
        ImageError: If its images do not fit its intrinsics.
    """
    from treadline.cli.numbers import check_times
    from treadline.core.images import gravity_of
    from treadline.core.interrupts import Terminated, deferred
    from treadline.io.frames.results import HeadingTable, Summary
    from treadline.io.live.depth_camera import camera_by_name
    from treadline.io.live.stream import LiveFrames
    from treadline.perception.frame_evaluation import FrameEvaluator, write_seen
    from treadline.scenario.camera_file import read_camera

    check_times(seconds=seconds)
    calibration = None if camera is None else read_camera(camera)
    device = camera_by_name(name)
    line = StatusLine()
    frames = LiveFrames(
        device, calibration=calibration, gravity_C=gravity_of(gravity), colour=out is not None, on_warning=line.warn
    )
    evaluator, summary, last = FrameEvaluator("robust", warm_up=False), Summary(), dict[str, Any]()
    drawn_s = -PICTURE_S
    with ExitStack() as stack:
        stack.enter_context(stdout_on_stderr())
        stack.callback(line.end)
        table = None if headings is None else stack.enter_context(HeadingTable(headings))
        try:
            for named in frames:
                with deferred():  # an interrupt inside compiled code would be wrapped in another exception
                    sight, last = evaluator.evaluate(named)
                    summary.add(last)
                    if table is not None:
                        table.write(last)
                    if out is not None and time.monotonic() - drawn_s >= PICTURE_S:
                        write_seen(named, sight, out / NAME)
                        drawn_s = time.monotonic()
                line.show(live_line(last, frames.rate.rate_hz))
                if seconds is not None and last["t_s"] >= seconds:
                    break
        except Terminated:
            raise
        except KeyboardInterrupt:
            pass  # Ctrl-C is how a person ends a live view
    notes = [f"warning: {warning}" for warning in frames.warnings]
    if last.get("warning") is not None:
        notes.append(f"warning: {last['warning']}")
    pictures = [] if out is None else [f"newest picture: {out / NAME}"]
    return Answer(
        values={"camera": device.name, "summary": summary.values, "last": last or None, "warnings": frames.warnings},
        summary=[f"{device.name}: {summary.lines[0]}", *summary.lines[1:], *pictures, *notes],
    )


def live_line(values: dict[str, Any], rate_hz: float | None) -> str:
    """Return the newest result on one line: heading, interval, rise, run or the rejection reason, and the frame rate."""
    rate = "" if rate_hz is None else f" | {rate_hz:.0f} frames/s"
    if not values["accepted"]:
        return f"no heading: {values['reason']}{rate}"
    stair = values["stair"]
    size = "" if stair is None else f", rise {1e3 * stair['rise_m']:.0f} mm, run {1e3 * stair['run_m']:.0f} mm"
    return f"heading {values['heading_deg']:+.2f}° ± {1.96 * values['sigma_deg']:.2f}°{size}{rate}"


@contextmanager
def stdout_on_stderr() -> Iterator[None]:
    """Send what the vendors' libraries write to stdout to stderr: stdout is for the answer alone."""
    try:
        kept = os.dup(1)
    except OSError:  # stdout is closed
        yield
        return
    try:
        os.dup2(2, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


class StatusLine:
    """Line on stderr that is overwritten on a terminal, and repeated once a second elsewhere."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._shown_s = -LINE_S
        self._open = False

    def show(self, text: str) -> None:
        """Replace the line."""
        if sys.stderr.isatty():
            sys.stderr.write(f"\r\x1b[K{text}")
            self._open = True
        elif self._clock() - self._shown_s >= LINE_S:
            self._shown_s = self._clock()
            sys.stderr.write(f"{text}\n")
        sys.stderr.flush()

    def warn(self, text: str) -> None:
        """Write a warning on a line of its own."""
        self.end()
        sys.stderr.write(f"warning: {text}\n")
        sys.stderr.flush()

    def end(self) -> None:
        """Leave the line as it is and begin a new one."""
        if self._open:
            sys.stderr.write("\n")
            self._open = False
