"""Recorded frames: a 16-bit depth image and, if given, a colour image, checked against their calibration."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from treadline.core.camera_images import RgbdFrame, black
from treadline.core.errors import ImageError, SettingsError
from treadline.core.files import bytes_of
from treadline.io.frames.point_cloud import PLAUSIBLE_M
from treadline.io.images import metres
from treadline.scenario.camera_file import CameraFile

PNG_START = b"\x89PNG\r\n\x1a\n"
JPEG_START, JPEG_END = b"\xff\xd8\xff", b"\xff\xd9"


def read_frame(rgb: Path | None, depth: Path, calibration: CameraFile) -> RgbdFrame:
    """Return the frame in a depth image and, if given, a colour image; without one, the frame's colour is black.

    Raises:
        ImageError: If a file is missing or not an image, the sizes differ, or the depth is implausible.
    """
    if rgb is None:
        depth_m = _depth(depth, calibration)
        return RgbdFrame(t_s=0.0, rgb=black(*depth_m.shape), depth_m=depth_m, camera=calibration.camera)
    if not calibration.registered and calibration.X_depth_colour is None:
        raise ImageError(
            f"{depth}: the calibration says registered = false; register depth to colour first, or give the pose X_depth_colour"
        )
    colour, depth_m = _colour(rgb, calibration), _depth(depth, calibration)
    if not calibration.registered:
        colour = _on_depth(colour, depth_m, calibration)
    return RgbdFrame(t_s=0.0, rgb=colour, depth_m=depth_m, camera=calibration.camera)


NOMINAL = {(512, 424): ("Kinect 2", 365.3)}
"""Depth image sizes, width and height, that belong to one camera model only, with its name and nominal focal length [px].

A Kinect 2 sees 70.6° × 60.0° (data sheet), which is a focal length of 361.6 to 367.2 px; recorded units have 365.3 px. Other common
sizes belong to several cameras: 640×480 is a Kinect 1 (575 px) and a D435 (383 px).
"""


def nominal_camera(depth: Path) -> tuple[CameraFile, str]:
    """Return the nominal calibration of the camera that a depth image's size identifies, and the warning that states the guess.

    Raises:
        ImageError: If the file is not a depth image.
        SettingsError: If the size belongs to several cameras.
    """
    image = _depth_counts(depth)
    height, width = image.shape
    if (width, height) not in NOMINAL:
        beside = depth.parent / "camera.toml"
        remedy = f"--camera {beside}" if beside.is_file() else "--camera camera.toml (width, height, fx_px, fy_px, cx_px, cy_px)"
        raise SettingsError(f"{depth}: no intrinsics: {width}×{height} pixels fit several cameras; give {remedy}")
    name, focal_px = NOMINAL[width, height]
    centre = 0.5 * (width - 1), 0.5 * (height - 1)
    calibration = CameraFile(width=width, height=height, fx_px=focal_px, fy_px=focal_px, cx_px=centre[0], cy_px=centre[1])
    return calibration, (
        f"no --camera: {width}×{height} is the size of a {name}, so its nominal intrinsics are used: fx = fy = {focal_px:g} px, "
        f"cx, cy = {centre[0]:g}, {centre[1]:g} px; a focal length 2 % off costs 0.2° of heading"
    )


def _on_depth(
    colour: UInt8[np.ndarray, "h w 3"], depth_m: Float32[np.ndarray, "h w"], calibration: CameraFile
) -> UInt8[np.ndarray, "h w 3"]:
    """Return the colour of each depth pixel's point; pixels without a return use the median depth."""
    camera = calibration.camera
    X_DC = np.array(calibration.X_depth_colour).reshape(-1, 4)
    z = np.where(np.isfinite(depth_m), depth_m, np.nanmedian(depth_m)).astype(float)
    v, u = np.mgrid[: z.shape[0], : z.shape[1]]
    p_D = camera.pixel_to_point(u, v, z)
    p_C = (p_D - X_DC[:3, 3]) @ X_DC[:3, :3]
    ahead = np.maximum(p_C[..., 2], 1e-3)
    columns = camera.fx_px * p_C[..., 0] / ahead + camera.cx_px
    rows = camera.fy_px * p_C[..., 1] / ahead + camera.cy_px
    return np.asarray(cv2.remap(colour, columns.astype(np.float32), rows.astype(np.float32), cv2.INTER_LINEAR))


def is_photo(path: Path) -> bool:
    """Return whether an image file is a colour image without depth.

    Raises:
        ImageError: If the file is not an image.
    """
    image = decoded(path, cv2.IMREAD_UNCHANGED)
    return not (image.dtype == np.uint16 and image.ndim == 2)


def _colour(path: Path, calibration: CameraFile) -> UInt8[np.ndarray, "h w 3"]:
    # Applying a stored image rotation would misalign colour and depth.
    image = decoded(path, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION)
    if image.dtype == np.uint16:
        if np.ptp(image, axis=2).max() == 0:
            raise ImageError(f"{path}: 16 bits of grey are no colour image; is it the depth image? give RGB first, then DEPTH")
        image = (image >> 8).astype(np.uint8)
    _check_size(path, image, calibration)
    return np.ascontiguousarray(image[:, :, ::-1])


def _depth_counts(path: Path) -> np.ndarray:
    image = decoded(path, cv2.IMREAD_UNCHANGED)
    if image.ndim != 2 or image.dtype != np.uint16:
        kind = f"{image.dtype.itemsize * 8}-bit with {1 if image.ndim == 2 else image.shape[2]} channel(s)"
        raise ImageError(f"{path}: depth must be 16-bit with one channel, this is {kind}; record the raw depth image")
    return image


def _depth(path: Path, calibration: CameraFile) -> Float32[np.ndarray, "h w"]:
    image = _depth_counts(path)
    _check_size(path, image, calibration)
    depth = metres(image, calibration.depth_unit_m)
    if np.isnan(depth).all():
        word = "zero" if not image.any() else "saturated"
        raise ImageError(f"{path}: every depth is {word}: no return anywhere; was the sensor covered or out of range?")
    middle = float(np.nanmedian(depth))
    if not PLAUSIBLE_M[0] <= middle <= PLAUSIBLE_M[1]:
        raise ImageError(
            f"{path}: the median depth is {middle:.3g} m with depth_unit_m = {calibration.depth_unit_m:g}; "
            "wrong unit? millimetres need depth_unit_m = 0.001 (--unit mm)"
        )
    return depth


def decoded(path: Path, flags: int) -> np.ndarray:
    """Return the pixels of a whole PNG or JPEG file.

    Raises:
        ImageError: If the file is missing, truncated, or no image.
    """
    data = bytes_of(path, "an image", ImageError)
    if not data.startswith((PNG_START, JPEG_START)):
        raise ImageError(
            f"{path}: not an image that can be read; give colour as PNG or JPEG, depth as 16-bit PNG in units of depth_unit_m"
        )
    # The decoder fills the missing part of a truncated image with grey, without an error.
    if not (_is_whole_png(data) if data.startswith(PNG_START) else JPEG_END in data[-64:]):
        raise ImageError(f"{path}: truncated or damaged image; copy or record it again")
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error:  # a small file can declare more pixels than OpenCV allows
        image = None
    if image is None:
        raise ImageError(f"{path}: not an image that can be read; save it again as PNG")
    return np.asarray(image)


def _is_whole_png(data: bytes) -> bool:
    """Return whether all chunks up to IEND are present with correct checksums."""
    place = len(PNG_START)
    while place + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, place)
        body, end = data[place + 4 : place + 8 + length], place + 12 + length
        if end > len(data) or zlib.crc32(body) != struct.unpack_from(">I", data, end - 4)[0]:
            return False
        if body[:4] == b"IEND":
            return True
        place = end
    return False


def _check_size(path: Path, image: np.ndarray, calibration: CameraFile) -> None:
    height, width = image.shape[:2]
    if (width, height) != (calibration.width, calibration.height):
        raise ImageError(
            f"{path}: {width}×{height} pixels, the calibration is for {calibration.width}×{calibration.height}; is the camera file "
            "of another resolution? scale width, height, fx, fy, cx and cy with the image"
        )
