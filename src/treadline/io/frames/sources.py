"""Frames of a file, a folder or a recording, by what the path is."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from numpy.typing import ArrayLike

from treadline.core.camera_images import FrameSource, NamedFrame, PinholeCamera, SeveralFrames, gravity_of, gravity_table
from treadline.core.errors import ImageError, SettingsError
from treadline.core.models import BAG_SUFFIXES
from treadline.io.frames._cloud_files import ENDINGS, read_cloud
from treadline.io.frames._elevation_map import map_views
from treadline.io.frames._image_files import is_photo, nominal_camera, read_frame
from treadline.io.frames.point_cloud import AXES, UNITS, Axes, FrameOptions, cloud_image
from treadline.scenario.camera_file import CameraFile, calibration_in, read_camera

COLOUR_ENDINGS = ("_rgb.png", "_color_registered.png")
"""File name endings of colour images."""
DEPTH_ENDING = "_depth.png"
"""File name ending of depth images."""


def read_frames(
    path: Path | str,
    depth: Path | str | None = None,
    *,
    camera: Path | str | CameraFile | PinholeCamera | None = None,
    gravity: str | ArrayLike | None = None,
    unit: str | None = None,
    axes: Axes | None = None,
    grid: float | None = None,
    topic: str | None = None,
    colour: bool = True,
) -> FrameSource:
    """Return the frames of a depth image, a colour and a depth image, a point cloud, a folder of these, a log or a map.

    Each frame has ``.name``, ``.frame`` (``.depth_m``, ``.rgb``, ``.camera``) and ``.gravity_C``, and ``tl.detect_stair`` takes it.
    Frames are read one by one.

    Args:
        path: Depth image (16-bit PNG), colour image, .ply or .pcd file, folder, or .mcap, .bag or .db3 file; with ``grid``, an
            elevation map: heights in a .npy, .npz, .csv or .txt file.
        depth: Depth image, if ``path`` is a colour image.
        camera: Calibration, its file (TOML), or the name of a shipped camera.
        gravity: Vector that points down in the camera frame (x right, y down, z forward): three numbers, or text x,y,z. For clouds
            it is in their frame, after ``axes``.
        unit: Unit of depth counts, cloud coordinates or heights: m, cm or mm.
        axes: Axes of clouds: camera (x right, y down, z forward; the default), ros (x forward, z up) or opengl (y up, z backward).
            The camera of an organised cloud is found in any axes.
        grid: Side of a cell of an elevation map [m]. Rows of the map are those of a picture from above, x to the right and y up;
            its frames NAME+x, NAME+y, NAME-x and NAME-y look along these axes, and their headings are relative to them.
        topic: Topic of the depth of a log, if it has several.
        colour: Whether the colour images of a log are wanted; depth alone is read faster.

    Raises:
        TreadlineError: If the path holds no frames, or information is missing.

    Examples:
        >>> import cv2, numpy as np
        >>> import treadline as tl
        >>> cv2.imwrite("wall.png", np.full((424, 512), 1500, dtype=np.uint16))  # a Kinect 2 before a wall
        True
        >>> for frame in tl.read_frames("wall.png", gravity=[0.0, 1.0, 0.0]):
        ...     print(frame.name, frame.frame.depth_m.shape)
        wall.png (424, 512)
    """
    if axes is not None and axes not in AXES:
        raise SettingsError(f"axes are '{axes}'; allowed: {', '.join(AXES)}")
    used, down = None if camera is None else calibration_in(camera), gravity_of(gravity)
    options = FrameOptions(camera=used, gravity_C=down, unit=unit, axes=axes, grid_m=grid, topic=topic, colour=colour)
    return _opened(Path(path), None if depth is None else Path(depth), options)


def _opened(path: Path, depth: Path | None, options: FrameOptions) -> FrameSource:
    if options.unit is not None and options.unit not in UNITS:
        raise SettingsError(f"--unit is '{options.unit}'; allowed: {', '.join(UNITS)}")
    if options.grid_m is not None:
        if any(item is not None for item in (depth, options.camera, options.gravity_C, options.axes, options.topic)):
            raise SettingsError("an elevation map is seen by cameras of its own: --grid goes with --unit alone")
        return SeveralFrames(map_views(path, options.grid_m, UNITS[options.unit or "m"]))
    if depth is not None:
        if options.camera is None:
            raise SettingsError("no intrinsics: see needs the camera's calibration: --camera camera.toml")
        return SeveralFrames([_image(path, depth, _with_unit(options.camera, options), options)])
    if path.suffix.lower() in ENDINGS and not path.is_dir():
        named, warning = _cloud(path, options)
        return SeveralFrames([named], [] if warning is None else [warning])
    endings = {item.suffix for item in path.iterdir()} if path.is_dir() else {path.suffix.lower()}
    if not endings.isdisjoint(BAG_SUFFIXES):
        from treadline.io.frames._recorded_frames import FramesOfLog
        from treadline.io.runs import chair_of_folder

        chair = chair_of_folder(path)
        return FramesOfLog(path, replace(options, mount=None if chair is None else chair.camera_at()))
    if options.topic is not None:
        raise SettingsError(f"--topic is of logs; {path} is none")
    return _folder(path, options) if path.is_dir() else _depth_image(path, options)


def _folder(path: Path, options: FrameOptions) -> FrameSource:
    """Return the clouds or the depth images of a folder; NAME_depth.png is a frame, with NAME_rgb.png if there is one.

    Raises:
        ImageError: If the folder has no frame, or an invalid gravity.csv.
    """
    clouds = sorted(file for file in path.iterdir() if file.suffix.lower() in ENDINGS)
    depths = sorted(path.glob("*" + DEPTH_ENDING))
    if clouds and not depths:
        unseen = NamedFrame(name="", frame=None, mount_known=False, gravity_C=None)
        return _FolderOfFrames(clouds, partial(_cloud, options=options), lambda file: replace(unseen, name=file.name))
    calibration = _with_unit(options.camera or read_camera(path / "camera.toml"), options)
    gravity = gravity_table(path / "gravity.csv")
    if not depths:
        orphans = [file for ending in COLOUR_ENDINGS for file in sorted(path.glob("*" + ending))]
        if orphans:
            raise ImageError(f"{path}: photos without depth; {orphans[0].name} needs its 16-bit NAME{DEPTH_ENDING}")
        raise ImageError(f"{path}: no frames: neither NAME{DEPTH_ENDING} (with NAME{COLOUR_ENDINGS[0]}) nor .ply or .pcd files")

    def unread(depth: Path) -> NamedFrame:
        name = depth.name.removesuffix(DEPTH_ENDING)
        return NamedFrame(
            name=name,
            frame=None,
            gravity_C=gravity.get(name, options.gravity_C),
            mount_known=calibration.mount_known,
            has_colour=_photo_of(depth) is not None,
        )

    def read(depth: Path) -> tuple[NamedFrame, None]:
        return replace(unread(depth), frame=read_frame(_photo_of(depth), depth, calibration)), None

    return _FolderOfFrames(depths, read, unread)


def _photo_of(depth: Path) -> Path | None:
    """Return the colour image of a depth image, or None."""
    name = depth.name.removesuffix(DEPTH_ENDING)
    return next((path for ending in COLOUR_ENDINGS if (path := depth.with_name(name + ending)).exists()), None)


def _depth_image(path: Path, options: FrameOptions) -> FrameSource:
    if is_photo(path):
        raise ImageError(
            f"{path}: a photo without depth; a heading needs the 16-bit depth image of the same moment: "
            "see DEPTH --camera camera.toml, or see RGB DEPTH --camera camera.toml"
        )
    if options.camera is not None:
        return SeveralFrames([_image(None, path, _with_unit(options.camera, options), options)])
    calibration, warning = nominal_camera(path)
    return SeveralFrames([_image(None, path, _with_unit(calibration, options), options)], [warning])


def _image(rgb: Path | None, depth: Path, calibration: CameraFile, options: FrameOptions) -> NamedFrame:
    return NamedFrame(
        name=(rgb or depth).name,
        frame=read_frame(rgb, depth, calibration),
        gravity_C=options.gravity_C,
        mount_known=calibration.mount_known,
        has_colour=rgb is not None,
    )


def _cloud(path: Path, options: FrameOptions) -> tuple[NamedFrame, str | None]:
    named, warning = cloud_image(path, read_cloud(path), options)
    return replace(named, name=path.name), warning


class _FolderOfFrames:
    """Frames of a folder in the order of their names, read lazily; unreadable frames are reported as such."""

    def __init__(
        self, files: list[Path], read: Callable[[Path], tuple[NamedFrame, str | None]], unread: Callable[[Path], NamedFrame]
    ) -> None:
        """Choose the files.

        Args:
            read: Function that returns the frame in a file, and a warning or None.
            unread: Function that returns the name and properties of a frame whose file cannot be read.
        """
        self._files = files
        self._read = read
        self._unread = unread
        self.count: int | None = len(files)
        self.warnings: list[str] = []

    def __iter__(self) -> Iterator[NamedFrame]:
        errors: list[ImageError] = []
        for path in self._files:
            try:
                named, warning = self._read(path)
            except ImageError as error:
                errors.append(error)
                named, warning = replace(self._unread(path), reason=str(error)), None
            if warning is not None and not self.warnings:
                self.warnings.append(f"{path.name}: {warning}")
            yield named
        if len(errors) == len(self._files):
            raise errors[0]


def _with_unit(calibration: CameraFile, options: FrameOptions) -> CameraFile:
    """Return the calibration with the unit that the user gives."""
    return calibration if options.unit is None else calibration.model_copy(update={"depth_unit_m": UNITS[options.unit]})
