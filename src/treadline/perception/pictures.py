"""The six stages of Fig. 5 as pictures, and their files."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from treadline.errors import ImageError
from treadline.perception.sight import Sight
from treadline.signals import RgbdFrame

NAMES = ("a_depth", "b_edges", "c_filtered", "d_lines", "e_merged", "f_box")
LINE, BOX = (255, 80, 40), (40, 220, 90)


def six_stages(
    depth: UInt8[np.ndarray, "h w"],
    edges: tuple[UInt8[np.ndarray, "h w"], UInt8[np.ndarray, "h w"]],
    filtered: tuple[UInt8[np.ndarray, "h w"], UInt8[np.ndarray, "h w"]],
    lines: Float[np.ndarray, "n 4"],
    nosings: Float[np.ndarray, "m 4"],
    box: tuple[int, int, int, int] | None,
    rgb: UInt8[np.ndarray, "h w 3"],
) -> tuple[UInt8[np.ndarray, "h w 3"], ...]:
    """Return depth, edges, filtered edges, lines, merged lines and the box as RGB pictures."""
    found = _with_lines(rgb, nosings)
    if box is not None:
        cv2.rectangle(found, box[:2], box[2:], BOX, 2)
    return (
        np.repeat(depth[:, :, None], 3, axis=2),
        _both(edges),
        _both(filtered),
        _with_lines(rgb, lines),
        _with_lines(rgb, nosings),
        found,
    )


def write_stages(sight: Sight, frame: RgbdFrame, folder: Path) -> tuple[Path, ...]:
    """Write the stages of a sight as PNG files, each whole or not at all; return their paths.

    Raises:
        ImageError: If the sight was taken without stages, or a file cannot be written.
    """
    if sight.stages is None:
        raise ImageError(f"frame at {frame.t_s:.3f} s: no stages were kept; look with stages=True in mode paper")
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, picture in zip(NAMES, sight.stages.pictures, strict=True):
        path, part = folder / f"fig05_{name}.png", folder / f"fig05_{name}.part.png"
        if not cv2.imwrite(str(part), np.ascontiguousarray(picture[:, :, ::-1])):
            raise ImageError(f"{path}: cannot be written; check the folder")
        part.replace(path)
        paths.append(path)
    return tuple(paths)


def _both(pair: tuple[UInt8[np.ndarray, "h w"], UInt8[np.ndarray, "h w"]]) -> UInt8[np.ndarray, "h w 3"]:
    """Return colour's edges in red and depth's in cyan."""
    return np.dstack([pair[0], pair[1], pair[1]])


def _with_lines(rgb: UInt8[np.ndarray, "h w 3"], lines: Float[np.ndarray, "n 4"]) -> UInt8[np.ndarray, "h w 3"]:
    drawn = rgb.copy()
    for u1, v1, u2, v2 in np.round(lines).astype(int).tolist():
        cv2.line(drawn, (u1, v1), (u2, v2), LINE, 2)
    return drawn
