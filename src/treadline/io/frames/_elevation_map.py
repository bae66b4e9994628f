"""Elevation maps as depth images: the height of each cell of a grid, seen by a virtual camera along each axis of the map.

A cell is a level square at its height; the faces between neighbours are upright. Rows of the file are those of a picture from
above: x to the right along a row, y up against the order of the rows. Cells that are not finite are unknown.
"""

from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from treadline.core.angles import DEG
from treadline.core.camera_images import NamedFrame, PinholeCamera, RgbdFrame, black
from treadline.core.errors import ImageError, SettingsError, one_line
from treadline.core.files import bytes_of
from treadline.io.frames._cloud_files import MOST_POINTS
from treadline.io.frames._elevation_map_kernels import cast
from treadline.io.frames.point_cloud import FEWEST_POINTS, PLAUSIBLE_M

VIEWS = ("+x", "-y", "-x", "+y")
"""Axes of the map along which a camera looks; each is the one before, turned to the right."""
EYE = PinholeCamera(width_px=640, height_px=480, fx_px=400.0, fy_px=400.0, cx_px=319.5, cy_px=239.5, mount_pitch_rad=55.0 * DEG)
"""Camera of a view: the usual image, a field of 77° × 62°. Of twelve flights, turned by up to 35°
in cells of 2 to 5 cm, 35°, 45° and 55° of pitch show 12, 12, 12 from the foot, to 2.4, 0.9 and 0.4°, and 1, 8, 12 from the top."""
AWAY_M = (1.5, 4.0)
"""Least and largest distance of the camera from the middle of the map [m]: between them, the map fills the image. The detector
looks 6 m far, which the floor of a view from 4 m reaches."""


def map_views(path: Path, cell_m: float, unit_m: float) -> list[NamedFrame]:
    """Return the views of a map along its axes, whose headings are relative to these axes.

    The chair frame of a view has its origin in the middle of the map at its median height, and x along the axis.

    Args:
        cell_m: Side of a cell [m].
        unit_m: Unit of the heights [m].

    Raises:
        SettingsError: If the side of a cell is not between 0 and 1 m.
        ImageError: If the file is no grid of heights, or holds those of no stair.
    """
    if not 0.0 < cell_m < 1.0:
        raise SettingsError(f"--grid is {cell_m:g}; it is the side of a cell in metres, between 0 and 1")
    heights_m = _read(path) * unit_m
    _check(path, heights_m)
    ahead_of_rows = np.rot90(heights_m, -1)  # first index along +x, second along +y
    return [_view(f"{path.stem}{axis}", np.rot90(ahead_of_rows, turn), cell_m) for turn, axis in enumerate(VIEWS)]


def _read(path: Path) -> Float64[np.ndarray, "h w"]:
    """Return the numbers of a NumPy file or of a table in text, NaN where a height is not finite."""
    data = bytes_of(path, "a map", ImageError)
    try:
        if path.suffix.lower() in {".npy", ".npz"}:
            held = np.load(BytesIO(data), allow_pickle=False)
            grids = held.values() if path.suffix.lower() == ".npz" else [held]
        else:
            grids = [np.loadtxt(data.decode("utf-8-sig").replace(",", " ").splitlines(), dtype=float, ndmin=2)]
        (heights,) = (np.asarray(grid).astype(float, casting="safe") for grid in grids)
    except Exception as error:  # noqa: BLE001 - damaged bytes can raise any exception in the parsers
        raise ImageError(f"{path}: no grid of heights: {one_line(error)}; give one array, or rows of numbers") from None
    if heights.ndim != 2:
        raise ImageError(f"{path}: {heights.ndim} dimensions; a map has rows and columns of heights")
    return np.where(np.isfinite(heights), heights, np.nan)


def _check(path: Path, heights_m: Float64[np.ndarray, "h w"]) -> None:
    """Reject a grid that is too small or too large, or whose heights are those of no building."""
    count = int(np.isfinite(heights_m).sum())
    if not FEWEST_POINTS <= count <= MOST_POINTS:
        raise ImageError(f"{path}: {count} cells with a height; a map has {FEWEST_POINTS} to {MOST_POINTS}")
    range_m = float(np.nanmax(heights_m) - np.nanmin(heights_m))
    if range_m > PLAUSIBLE_M[1]:
        raise ImageError(
            f"{path}: the heights differ by {range_m:.4g} m, more than {PLAUSIBLE_M[1]:g} m; in millimetres? --unit mm"
        )


def _view(name: str, heights_m: Float64[np.ndarray, "nx ny"], cell_m: float) -> NamedFrame:
    """Return the view along the first index of a grid, whose second index counts to the left."""
    away_m = float(np.clip(0.5 * np.hypot(*heights_m.shape) * cell_m * EYE.fy_px / EYE.cy_px, *AWAY_M))
    back_m, up_m = away_m * float(np.cos(EYE.mount_pitch_rad)), away_m * float(np.sin(EYE.mount_pitch_rad))
    camera = replace(EYE, mount_m=(-back_m, 0.0, up_m))
    middle = np.array([0.5 * heights_m.shape[0], 0.5 * heights_m.shape[1], np.nanmedian(heights_m) / cell_m])
    depth = np.empty((camera.height_px, camera.width_px), dtype=np.float32)
    cast(np.ascontiguousarray(heights_m / cell_m), middle + np.array(camera.mount_m) / cell_m, camera.R_BC, camera.pinhole, depth)
    frame = RgbdFrame(t_s=0.0, rgb=black(*depth.shape), depth_m=depth * np.float32(cell_m), camera=camera)
    down_C = camera.R_BC.T @ np.array([0.0, 0.0, -1.0])
    return NamedFrame(name=name, frame=frame, mount_known=True, gravity_C=down_C, has_colour=False)
