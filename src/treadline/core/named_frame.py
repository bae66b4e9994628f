"""Frame with its name, and the direction of gravity as users give it."""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from treadline.core.errors import ImageError
from treadline.core.signals import RgbdFrame


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NamedFrame:
    """Frame, its name and the direction of gravity if known."""

    name: str
    frame: RgbdFrame | None
    """Frame; None if the images cannot be read."""
    mount_known: bool
    """Whether the calibration includes the orientation of the mount."""
    gravity_C: Float[np.ndarray, " 3"] | None
    reason: str | None = None
    """Reason for an unreadable frame."""
    has_colour: bool = True
    """Whether the frame has a colour image; without one, ``frame.rgb`` is black."""
    t_s: float | None = None
    """Time since the start of the recording [s]; None for single frames."""


@runtime_checkable
class FrameSource(Protocol):
    """Series of frames. Its warnings are complete after the last frame."""

    @property
    def warnings(self) -> Sequence[str]:
        """Properties of the source that a user has to know."""
        ...

    @property
    def count(self) -> int | None:
        """Number of frames, if known in advance."""
        ...

    def __iter__(self) -> Iterator[NamedFrame]: ...


class SeveralFrames:
    """Frames that are in memory, with the warnings of their reader."""

    def __init__(self, frames: Sequence[NamedFrame], warnings: Sequence[str] = ()) -> None:
        self._frames = frames
        self.warnings = warnings
        self.count: int | None = len(frames)

    def __iter__(self) -> Iterator[NamedFrame]:
        return iter(self._frames)


def black(height: int, width: int) -> np.ndarray:
    """Return the colour image of a frame without colour."""
    return np.zeros((height, width, 3), dtype=np.uint8)


def gravity_of(text: str | None) -> Float[np.ndarray, " 3"] | None:
    """Return the direction in the option ``--gravity x,y,z``.

    Raises:
        ImageError: If the text is not three finite numbers that are not all zero.
    """
    return None if text is None else _direction("--gravity", text.split(","))


def gravity_table(path: Path) -> dict[str, Float[np.ndarray, " 3"]]:
    """Return the direction of gravity by frame name from a CSV file with the columns name,x,y,z; empty without the file.

    Raises:
        ImageError: If the file is not such a table.
    """
    if not path.exists():
        return {}
    try:
        lines = path.read_bytes().decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ImageError(f"{path}: not UTF-8 (byte {error.start}); save it as UTF-8 text") from None
    reader = csv.DictReader(lines)
    table: dict[str, Float[np.ndarray, " 3"]] = {}
    for row in reader:
        where = f"{path}:{reader.line_num}"
        name, *cells = (row.get(column) for column in ("name", "x", "y", "z"))
        if name is None or None in cells:
            raise ImageError(f"{where}: needs the columns name,x,y,z")
        if name in table:
            raise ImageError(f"{where}: '{name}' occurs twice; remove one")
        table[name] = _direction(where, [str(cell) for cell in cells])
    return table


def _direction(where: str, parts: list[str]) -> Float[np.ndarray, " 3"]:
    try:
        vector = np.array([float(part) for part in parts])
    except ValueError:
        raise ImageError(f"{where}: gravity must be three numbers x,y,z") from None
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not np.isfinite(vector).all() or length < 1e-6:
        raise ImageError(f"{where}: gravity must be three finite numbers x,y,z that are not all zero")
    return vector / length
