"""``treadline see``: heading and stair geometry in recorded frames, point clouds, elevation maps, logs and live cameras."""

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from treadline.cli._arguments import Force, List, check_times, choice, claim
from treadline.cli._output import Answer, Progress
from treadline.core.errors import SettingsError

if TYPE_CHECKING:
    from treadline.core.camera_images import FrameSource

MANY = 20
"""Number of frames above which progress is shown."""
LINE_S = 1.0
"""Interval of the lines of a live camera where stderr is no terminal [s]."""
PICTURE_S = 0.5
"""Shortest interval between two pictures of a live camera [s]: drawing one takes longer than detecting the stair."""


def see(
    source: Path | None = None,
    depth: Path | None = None,
    /,
    *,
    live: str | None = None,
    camera: Path | None = None,
    gravity: List = None,
    unit: str | None = None,
    axes: str | None = None,
    grid: float | None = None,
    topic: str | None = None,
    method: str = "robust",
    threshold: str | None = None,
    seconds: float | None = None,
    headings: Path | None = None,
    stair: Path | None = None,
    out: Path | None = None,
    force: Force = False,
) -> Answer:
    """Detect the stair in depth frames and report the heading.

    A depth image suffices; a colour image adds pictures in colour. A calibration without a mount gives a heading about the
    camera's own axis, and the answer states this.

    treadline see depth.png --camera camera.toml (16-bit PNG)

    treadline see rgb.png depth.png --camera camera.toml

    treadline see FOLDER (NAME_depth.png, NAME_rgb.png, camera.toml, gravity.csv)

    treadline see cloud.ply --unit mm (or .pcd; the camera is found from the points)

    treadline see map.npy --grid 0.04 (an elevation map: heights of cells of 4 cm, NaN where unknown)

    treadline see walk.mcap --headings walk.csv (or .bag, .db3, or a run folder)

    treadline see --live realsense --out seen (or orbbec, oak; Ctrl-C ends)

    Args:
        source: Depth image, colour image, point cloud, folder of these, log, run folder, or elevation map.
        depth: Depth image, 16 bit, if the first file is a colour image.
        live: Camera: realsense, orbbec or oak.
        camera: Camera file (TOML), or a kind: kinect1, kinect2, d435, d455 or tof. Default for a folder: its camera.toml; a cloud,
            a log and a live camera have their own.
        gravity: Unit vector that points down in the camera's frame: x,y,z; for a folder, of the frames that gravity.csv lacks.
        unit: Unit of depth counts, cloud coordinates or heights: m, cm or mm. Default: the calibration's depth_unit_m, else m.
        axes: Axes of point clouds: camera (x right, y down, z forward; the default), ros (x forward, y left, z up) or opengl (x
            right, y up, z backward). The camera of an organised cloud is found in any axes.
        grid: Side of a cell of an elevation map [m], which is a .npy, .npz, .csv or .txt file of heights. Its rows are those of a
            picture from above, x to the right, y up. It is looked at along +x, -y, -x and +y; each heading is relative to its axis.
        topic: Topic of the depth images or point clouds of a log, if several hold depth.
        method: Method: robust, or paper for Algorithm 1 as printed, whose heading by Eq. (2) is 90° where the chair is square to
            the stair (square_deg in the JSON answer).
        threshold: Rule for Canny's thresholds in Algorithm 1: median (the default), otsu, rosin or mad; needs --method paper, or
            --out, whose six stages are those of Algorithm 1.
        seconds: Duration of --live [s]. Default: until Ctrl-C.
        headings: Table with a row per frame, .csv or .jsonl (one JSON object per line), in place of a line per frame.
        stair: Scenario file to write, with the [stair] table of what was measured: medians of the accepted frames.
        out: Folder for the pictures: the six stages of Fig. 5 (NAME-1.png to -6.png), and treads, risers, nosings and heading of
            the robust method (NAME-seen.png); of --live, the newest picture (live-seen.png).
    """
    from treadline.io.frames import read_frames
    from treadline.io.frames.point_cloud import AXES
    from treadline.perception.detection import ThresholdRule

    if out is not None:
        claim(out, force=force)
    for option, file in (("--headings", headings), ("--stair", stair)):
        if file is not None:
            claim(file, force=force, kind="file", option=option)
    chosen = choice("--method", method, ("robust", "paper"))
    rule = choice("--threshold", threshold or "median", get_args(ThresholdRule))
    if threshold is not None and chosen != "paper" and out is None:
        raise SettingsError("--threshold is of Algorithm 1: give --method paper, or --out for pictures of its stages")
    cloud_axes = None if axes is None else choice("--axes", axes, AXES)
    if (source is None) == (live is None):
        raise SettingsError("see needs one input: a file, a folder or a log, or --live CAMERA; treadline see --help shows examples")
    if live is not None:
        given: dict[str, object] = {"--unit": unit, "--topic": topic, "--grid": grid, "--threshold": threshold}
        given["--method paper"] = chosen == "paper" or None
        if alone := [name for name, value in given.items() if value is not None]:
            raise SettingsError(
                f"{alone[0]} is of recorded frames; --live takes --camera, --gravity, --seconds, --headings and --out"
            )
        return _see_live(live, camera=camera, gravity=gravity, seconds=seconds, headings=headings, out=out)
    if seconds is not None:
        raise SettingsError("--seconds is of --live")
    assert source is not None  # noqa: S101 - for the type checker
    colour = chosen == "paper" or out is not None
    frames = read_frames(
        source, depth, camera=camera, gravity=gravity, unit=unit, axes=cloud_axes, grid=grid, topic=topic, colour=colour
    )
    return _answer(frames, chosen, rule, headings, stair, out)


def _answer(frames: "FrameSource", method: Any, rule: Any, headings: Path | None, stair: Path | None, out: Path | None) -> Answer:
    """Evaluate the frames of a source; a single frame answers for itself, several with a summary."""
    from treadline.core.camera_images import SeveralFrames
    from treadline.io.frames.evaluation import FrameEvaluator, Summary, heading_table, measured_stair

    evaluator, summary, seen = FrameEvaluator(method, rule), Summary(), list[dict[str, Any]]()
    with ExitStack() as stack:
        table = None if headings is None else stack.enter_context(heading_table(headings))
        are_many = frames.count is not None and frames.count >= MANY
        progress = stack.enter_context(Progress("see", frames.count)) if are_many else None
        for named in evaluator.tested(frames):
            sight, values = evaluator.evaluate(named)
            if out is not None:
                evaluator.write_pictures(named, sight, out)
            summary.add(values)
            seen.append(values)
            if table is not None:
                table(values)
            if progress is not None:
                progress.done(values["name"])
    if stair is not None:
        stair.write_text(measured_stair(seen), encoding="utf-8")
    found = dict.fromkeys(item["warning"] for item in seen if item["accepted"] and item["warning"] is not None)
    findings = evaluator.findings
    notes = [f"warning: {warning}" for warning in (*frames.warnings, *found, *findings)]
    if isinstance(frames, SeveralFrames) and len(seen) == 1:
        (values,) = seen
        return Answer(
            values=values | {"warnings": list(frames.warnings)},
            summary=[_line(values), *notes],
            code=0 if values["accepted"] else 1,
        )
    lines = [f"headings: {headings}"] if headings is not None else [_line(item) for item in seen]
    values = {"frames": seen, "summary": summary.values, "calibration": findings, "warnings": list(frames.warnings)}
    return Answer(values=values, summary=[*lines, *summary.lines, *notes])


def _line(seen: dict[str, Any]) -> str:
    name = seen["name"] + (f" at {seen['t_s']:.3f} s" if "t_s" in seen else "")
    if not seen["accepted"]:
        return "; ".join([f"{name}: no heading: {seen['reason']}", *seen["ground"]])
    square = f" by Eq. (2), in which {seen['square_deg']:g}° is square to the stair," if seen["square_deg"] else ""
    words = [
        f"{name}: heading{square} {seen['heading_deg']:+.2f}° ± {1.96 * seen['sigma_deg']:.2f}° (95 %)",
        f"{seen['edges']} edges",
    ]
    stair = seen["stair"]
    if stair is not None:
        words.append(f"flight {stair['direction']}, slope {stair['slope_deg']:.1f}°, {_step_text(stair)}")
    if seen["turn"] is not None:
        words.append(seen["turn"])
    if not seen["mount_known"]:
        places = [(seen[f"heading_on_{place}_deg"], place) for place in ("flight", "level")]
        on_chair = ", ".join(f"{value:+.2f}° on the {place}" for value, place in places if value is not None)
        words.append("about the camera's own axis: no mount" + (f" (the chair's {on_chair})" if on_chair else ""))
    return ", ".join([*words, f"{seen['ms']:.1f} ms"])


def _step_text(stair: dict[str, Any]) -> str:
    return f"rise {1e3 * stair['rise_m']:.0f} mm, run {1e3 * stair['run_m']:.0f} mm"


def _see_live(
    name: str, *, camera: Path | None, gravity: str | None, seconds: float | None, headings: Path | None, out: Path | None
) -> Answer:
    """Detect the stair in the frames of a live camera.

    Raises:
        CameraError: If the camera is missing, busy, or stops.
        ImageError: If its images do not fit its intrinsics.
    """
    from treadline.core.camera_images import gravity_of
    from treadline.core.processes import Terminated, deferred
    from treadline.io.frames.evaluation import FrameEvaluator, Summary, heading_table, write_seen
    from treadline.io.live import camera_by_name
    from treadline.io.live.stream import LiveFrames
    from treadline.scenario.camera_file import read_camera

    check_times(seconds=seconds)
    calibration = None if camera is None else read_camera(camera)
    device = camera_by_name(name)
    line = StatusLine()
    frames = LiveFrames(
        device, calibration=calibration, gravity_C=gravity_of(gravity), colour=out is not None, on_warning=line.warn
    )
    evaluator, summary, last = FrameEvaluator("robust", warm_up=False), Summary(), dict[str, Any]()
    drawn_s, picture = -PICTURE_S, None if out is None else out / "live-seen.png"
    with ExitStack() as stack:
        stack.enter_context(_stdout_on_stderr())
        stack.callback(line.end)
        table = None if headings is None else stack.enter_context(heading_table(headings))
        try:
            for named in frames:
                with deferred():  # an interrupt inside compiled code would be wrapped in another exception
                    sight, last = evaluator.evaluate(named)
                    summary.add(last)
                    if table is not None:
                        table(last)
                    if picture is not None and time.monotonic() - drawn_s >= PICTURE_S:
                        write_seen(named, sight, picture)
                        drawn_s = time.monotonic()
                line.show(_live_text(last, frames.rate.rate_hz))
                if seconds is not None and last["t_s"] >= seconds:
                    break
        except Terminated:
            raise
        except KeyboardInterrupt:
            pass  # Ctrl-C is how a person ends a live view
    warnings = (*frames.warnings, last.get("warning"), *evaluator.findings)
    notes = [f"warning: {warning}" for warning in warnings if warning is not None]
    pictures = [] if picture is None else [f"newest picture: {picture}"]
    return Answer(
        values={"camera": device.name, "summary": summary.values, "last": last or None, "warnings": frames.warnings},
        summary=[f"{device.name}: {summary.lines[0]}", *summary.lines[1:], *pictures, *notes],
    )


def _live_text(values: dict[str, Any], rate_hz: float | None) -> str:
    """Return the newest result on one line: heading, interval, rise, run or the rejection reason, and the frame rate."""
    rate = "" if rate_hz is None else f" | {rate_hz:.0f} frames/s"
    if not values["accepted"]:
        return f"no heading: {values['reason']}{rate}"
    stair = values["stair"]
    size = "" if stair is None else f", {_step_text(stair)}"
    return f"heading {values['heading_deg']:+.2f}° ± {1.96 * values['sigma_deg']:.2f}°{size}{rate}"


@contextmanager
def _stdout_on_stderr() -> Iterator[None]:
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
