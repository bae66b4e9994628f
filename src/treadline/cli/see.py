"""``treadline see``: heading and stair geometry in recorded frames."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

from treadline.cli.answer import Answer
from treadline.cli.numbers import List, choice
from treadline.cli.out import Force, claim

MANY = 20
"""Number of frames in a folder above which progress is shown."""


def see(
    rgb: Path,
    depth: Path | None = None,
    /,
    *,
    camera: Path | None = None,
    gravity: List = None,
    method: str = "robust",
    threshold: str | None = None,
    out: Path | None = None,
    force: Force = False,
) -> Answer:
    """Detect the stair in an RGB-D frame and report the heading.

    Give a colour image and a 16-bit depth image with a calibration, or a folder of NAME_rgb.png + NAME_depth.png
    with camera.toml and, if known, gravity.csv. A calibration without a mount gives a heading about the camera's own axis, and
    the answer states this.

    Args:
        rgb: Colour image, or a folder.
        depth: Depth image, 16 bit.
        camera: Calibration file (TOML). Default for a folder: its camera.toml.
        gravity: Unit vector that points down in the camera's frame: x,y,z; for a folder, of the frames that gravity.csv lacks.
        method: Method: robust, or paper for Algorithm 1 as printed.
        threshold: Rule for Canny's thresholds in Algorithm 1: median (the default), otsu, rosin or mad; needs --method paper, or
            --out, whose six stages are those of Algorithm 1.
        out: Folder for the pictures: the six stages of Fig. 5 (NAME-1.png to -6.png), and treads, risers, nosings and heading of
            the robust method (NAME-seen.png).
    """
    from treadline.cli.compiling import report_compiling
    from treadline.errors import SettingsError
    from treadline.perception.edges import ThresholdRule
    from treadline.perception.frames import FolderOfFrames, see_frames, single_frame
    from treadline.perception.images import alone

    if out is not None:
        claim(out, force=force)
    report_compiling()
    chosen = choice("--method", method, ("robust", "paper"))
    rule = choice("--threshold", threshold or "median", get_args(ThresholdRule))
    if threshold is not None and chosen != "paper" and out is None:
        raise SettingsError("--threshold is of Algorithm 1: give --method paper, or --out for pictures of its stages")
    if depth is None and not rgb.is_dir():
        raise alone(rgb)
    if depth is None:
        frames = FolderOfFrames(rgb, camera, gravity)
        seen = list(_with_progress(see_frames(frames, method=chosen, out=out, threshold=rule), len(frames)))
        accepted = sum(bool(item["accepted"]) for item in seen)
        return Answer(
            values={"frames": seen},
            summary=[*(_line(item) for item in seen), f"{accepted} of {len(seen)} frames accepted", *_warnings(seen)],
        )
    if camera is None:
        raise SettingsError("no intrinsics: see needs the camera's calibration: --camera camera.toml")
    (answer,) = see_frames([single_frame(rgb, depth, camera, gravity)], method=chosen, out=out, threshold=rule)
    return Answer(values=answer, summary=[_line(answer), *_warnings([answer])], code=0 if answer["accepted"] else 1)


def _with_progress(seen: Iterator[dict[str, Any]], count: int) -> Iterator[dict[str, Any]]:
    """Yield the results; of many frames, show the progress."""
    from treadline.cli.progress import Progress

    if count < MANY:
        yield from seen
        return
    every = max(1, count // 20)
    with Progress("see", count // every) as progress:
        for number, item in enumerate(seen, start=1):
            yield item
            if number % every == 0 and number // every <= count // every:
                progress.done(f"{number} of {count} frames")


def _line(seen: dict[str, Any]) -> str:
    if not seen["accepted"]:
        return f"{seen['name']}: no heading: {seen['reason']}"
    words = [
        f"{seen['name']}: heading {seen['heading_deg']:+.2f}° ± {1.96 * seen['sigma_deg']:.2f}° (95 %)",
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
