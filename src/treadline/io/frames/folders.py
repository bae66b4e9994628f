"""Folders of recorded frames: image pairs, depth images, or point clouds, in the order of their names."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from treadline.core.errors import ImageError
from treadline.core.images import NamedFrame, gravity_table
from treadline.io.frames.image_files import read_frame
from treadline.scenario.camera_file import CameraFile

COLOUR_ENDINGS = ("_rgb.png", "_color_registered.png")
"""File name endings of colour images."""
DEPTH_ENDING = "_depth.png"
"""File name ending of depth images."""


class FolderOfFrames:
    """Frames of a folder in the order of their names, read lazily; unreadable frames are reported as such.

    A frame is NAME_depth.png, with NAME_rgb.png if there is one.

    Raises:
        ImageError: If the folder has no frame, no readable one, or an invalid gravity.csv.
    """

    warnings: Sequence[str] = ()

    def __init__(self, folder: Path, calibration: CameraFile, gravity_C: Float[np.ndarray, " 3"] | None = None) -> None:
        """List the frames of a folder.

        Args:
            gravity_C: Gravity direction for frames missing in gravity.csv.
        """
        self._calibration = calibration
        self._down = gravity_C
        self._gravity = gravity_table(folder / "gravity.csv")
        self._depths = sorted(folder.glob("*" + DEPTH_ENDING))
        if not self._depths:
            orphans = [path for ending in COLOUR_ENDINGS for path in sorted(folder.glob("*" + ending))]
            if orphans:
                raise ImageError(f"{folder}: photos without depth; {orphans[0].name} needs its 16-bit NAME{DEPTH_ENDING}")
            raise ImageError(
                f"{folder}: no frames: neither NAME{DEPTH_ENDING} (with NAME{COLOUR_ENDINGS[0]}) nor .ply or .pcd files"
            )

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self._depths)

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[NamedFrame]:
        unread: list[ImageError] = []
        for depth in self._depths:
            name = depth.name.removesuffix(DEPTH_ENDING)
            rgb = next((path for ending in COLOUR_ENDINGS if (path := depth.with_name(name + ending)).exists()), None)
            frame, reason = None, None
            try:
                frame = read_frame(rgb, depth, self._calibration)
            except ImageError as error:
                unread.append(error)
                reason = str(error)
            yield NamedFrame(
                name=name,
                frame=frame,
                gravity_C=self._gravity.get(name, self._down),
                mount_known=self._calibration.mount_known,
                reason=reason,
                has_colour=rgb is not None,
            )
        if len(unread) == len(self):
            raise unread[0]
