"""``treadline see``: heading and stair geometry in recorded frames, point clouds, logs and live cameras."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from treadline.cli.answer import Answer
from treadline.cli.numbers import List, choice
from treadline.cli.out import Force, claim

if TYPE_CHECKING:
    from treadline.core.images import FrameSource, PinholeCamera

MANY = 20
"""Number of frames above which progress is shown."""


def see(
    source: Path | None = None,
    depth: Path | None = None,
    /,
    *,
    live: str | None = None,
    camera: Path | None = None,
    gravity: List = None,
    unit: str | None = None,
    axes: str = "camera",
    topic: str | None = None,
    method: str = "robust",
    threshold: str | None = None,
    seconds: float | None = None,
    headings: Path | None = None,
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

    treadline see walk.mcap --headings walk.csv (or .bag, .db3, or a run folder)

    treadline see --live realsense --out seen (or orbbec, oak; Ctrl-C ends)

    Args:
        source: Depth image, colour image, point cloud, folder of these, log, or run folder.
        depth: Depth image, 16 bit, if the first file is a colour image.
        live: Camera: realsense, orbbec or oak.
        camera: Calibration file (TOML). Default for a folder: its camera.toml; a cloud, a log and a live camera have their own.
        gravity: Unit vector that points down in the camera's frame: x,y,z; for a folder, of the frames that gravity.csv lacks.
        unit: Unit of depth counts or cloud coordinates: m, cm or mm. Default: the calibration's depth_unit_m; m for clouds.
        axes: Axes of point clouds: camera (x right, y down, z forward), ros (x forward, y left, z up) or opengl (x right, y up,
            z backward).
        topic: Topic of the depth images or point clouds of a log, if several hold depth.
        method: Method: robust, or paper for Algorithm 1 as printed.
        threshold: Rule for Canny's thresholds in Algorithm 1: median (the default), otsu, rosin or mad; needs --method paper, or
            --out, whose six stages are those of Algorithm 1.
        seconds: Duration of --live [s]. Default: until Ctrl-C.
        headings: Table with a row per frame, .csv or .jsonl (one JSON object per line), in place of a line per frame.
        out: Folder for the pictures: the six stages of Fig. 5 (NAME-1.png to -6.png), and treads, risers, nosings and heading of
            the robust method (NAME-seen.png); of --live, the newest picture (live-seen.png).
    """
    from treadline.cli.compiling import report_compiling
    from treadline.core.errors import SettingsError
    from treadline.io.frames.options import AXES
    from treadline.perception.paper.edges import ThresholdRule

    if out is not None:
        claim(out, force=force)
    if headings is not None:
        claim(headings, force=force, kind="file")
    chosen = choice("--method", method, ("robust", "paper"))
    rule = choice("--threshold", threshold or "median", get_args(ThresholdRule))
    if threshold is not None and chosen != "paper" and out is None:
        raise SettingsError("--threshold is of Algorithm 1: give --method paper, or --out for pictures of its stages")
    choice("--axes", axes, AXES)
    if (source is None) == (live is None):
        raise SettingsError("see needs one input: a file, a folder or a log, or --live CAMERA; treadline see --help shows examples")
    report_compiling()
    if live is not None:
        given = {"--unit": unit, "--topic": topic, "--threshold": threshold, "--method paper": chosen == "paper" or None}
        if alone := [name for name, value in given.items() if value is not None]:
            raise SettingsError(
                f"{alone[0]} is of recorded frames; --live takes --camera, --gravity, --seconds, --headings and --out"
            )
        from treadline.cli.see_live import see_live

        return see_live(live, camera=camera, gravity=gravity, seconds=seconds, headings=headings, out=out)
    if seconds is not None:
        raise SettingsError("--seconds is of --live")
    assert source is not None  # noqa: S101 - for the type checker
    frames = _source(source, depth, camera, gravity, unit, axes, topic, colour=chosen == "paper" or out is not None)
    return _answer(frames, chosen, rule, headings, out)


def _source(
    source: Path,
    depth: Path | None,
    camera: Path | None,
    gravity: str | None,
    unit: str | None,
    axes: Any,
    topic: str | None,
    *,
    colour: bool,
) -> "FrameSource":
    from treadline.core.images import gravity_of
    from treadline.io.frames.options import FrameOptions
    from treadline.io.frames.sources import open_frames
    from treadline.scenario.camera_file import read_camera

    options = FrameOptions(
        camera=None if camera is None else read_camera(camera),
        gravity_C=gravity_of(gravity),
        unit=unit,
        axes=axes,
        topic=topic,
        mount=_mount_of_run(source),
        colour=colour,
    )
    return open_frames(source, depth, options)


def _mount_of_run(source: Path) -> "PinholeCamera | None":
    """Return the camera of the chair that made a run folder; None for other inputs."""
    from treadline.io.runs import LOG, MANIFEST

    folder = source.parent if source.name == LOG else source
    if not (folder / MANIFEST).is_file():
        return None
    from treadline.experiments.replay_source import source_of

    return source_of(folder).base.chair.camera_at()


def _answer(frames: "FrameSource", method: Any, rule: Any, headings: Path | None, out: Path | None) -> Answer:
    """Evaluate the frames of a source; a single frame answers for itself, several with a summary."""
    from treadline.core.images import SeveralFrames
    from treadline.io.frames.results import HeadingTable, Summary
    from treadline.perception.frame_evaluation import see_frames

    summary, seen = Summary(), list[dict[str, Any]]()
    with ExitStack() as stack:
        table = None if headings is None else stack.enter_context(HeadingTable(headings))
        for values in _with_progress(see_frames(frames, method=method, out=out, threshold=rule), frames.count):
            summary.add(values)
            seen.append(values)
            if table is not None:
                table.write(values)
    notes = [*(f"warning: {warning}" for warning in frames.warnings), *_warnings(seen)]
    if isinstance(frames, SeveralFrames) and len(seen) == 1:
        (values,) = seen
        return Answer(
            values=values | {"warnings": list(frames.warnings)},
            summary=[_line(values), *notes],
            code=0 if values["accepted"] else 1,
        )
    lines = [f"headings: {headings}"] if headings is not None else [_line(item) for item in seen]
    values = {"frames": seen, "summary": summary.values, "warnings": list(frames.warnings)}
    return Answer(values=values, summary=[*lines, *summary.lines, *notes])


def _with_progress(seen: Iterator[dict[str, Any]], count: int | None) -> Iterator[dict[str, Any]]:
    """Yield the results; of many frames, show the progress."""
    from treadline.cli.progress import Progress

    if count is None or count < MANY:
        yield from seen
        return
    every = max(1, count // 20)
    with Progress("see", count // every) as progress:
        for number, item in enumerate(seen, start=1):
            yield item
            if number % every == 0 and number // every <= count // every:
                progress.done(f"{number} of {count} frames")


def _line(seen: dict[str, Any]) -> str:
    name = seen["name"] + (f" at {seen['t_s']:.3f} s" if "t_s" in seen else "")
    if not seen["accepted"]:
        return f"{name}: no heading: {seen['reason']}"
    words = [
        f"{name}: heading {seen['heading_deg']:+.2f}° ± {1.96 * seen['sigma_deg']:.2f}° (95 %)",
        f"{seen['edges']} edges",
    ]
    stair = seen["stair"]
    if stair is not None:
        words.append(
            f"flight {stair['direction']}, slope {stair['slope_deg']:.1f}°, rise {1e3 * stair['rise_m']:.0f} mm, "
            f"run {1e3 * stair['run_m']:.0f} mm"
        )
    if not seen["mount_known"]:
        places = [(seen[f"heading_on_{place}_deg"], place) for place in ("flight", "level")]
        on_chair = ", ".join(f"{value:+.2f}° on the {place}" for value, place in places if value is not None)
        words.append("about the camera's own axis: no mount" + (f" (the chair's {on_chair})" if on_chair else ""))
    return ", ".join([*words, f"{seen['ms']:.1f} ms"])


def _warnings(seen: list[dict[str, Any]]) -> list[str]:
    """Return the warnings about the calibration, each once for all frames."""
    return [
        f"warning: {warning}" for warning in {item["warning"]: None for item in seen if item["accepted"]} if warning is not None
    ]
