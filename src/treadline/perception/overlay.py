"""Pictures of a detection: treads, risers, nosings and the heading with its interval, and the stages of Algorithm 1."""

import math
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import ImageError
from treadline.core.files import write_whole
from treadline.perception._plane_segmentation import Surface
from treadline.perception.detection import Picture, Stages, StairDetection

COLOURS = {
    "tread": (70, 150, 255),
    "riser": (255, 150, 50),
    "nosing": (255, 235, 60),
    "turned": (255, 90, 220),
    "text": (255, 255, 255),
    "obstacle": (255, 60, 60),
}
"""Colours of the drawn objects (red, green, blue)."""
TINT = 0.45
"""Opacity of the surface colours."""
WIDTH_PX, BAND_PX = 960, 66
"""Width of the image, for the text layout, and height of the band with two lines of text [px]."""
DIAL_PX = 96
"""Radius of the dial [px]."""
JPEG_QUALITY = 80
"""Quality of compressed overlays, 0 to 100: text stays legible, an image of 960 by 786 pixels takes about 70 kB."""


def overlay(frame: RgbdFrame, sight: StairDetection) -> Picture:
    """Return the frame with all detected objects; a rejected frame with the reason."""
    scale = WIDTH_PX / frame.camera.width_px
    picture = np.ascontiguousarray(frame.rgb.copy())
    if sight.blocks is not None:
        side_px = picture.shape[1] // sight.blocks.nearness.shape[0]
        for kind, surfaces in (("tread", sight.treads), ("riser", sight.risers)):
            for surface in surfaces:
                _tint(picture, surface, COLOURS[kind], side_px)
    picture = cv2.resize(picture, (WIDTH_PX, round(frame.camera.height_px * scale)), interpolation=cv2.INTER_LINEAR)
    straight = sight.edge_count if sight.turn is None else sight.turn.after
    for number, step in enumerate(sight.steps):
        is_of_flight = sight.shape is not None and number < straight
        _line(picture, frame.camera, np.array(step.ends_C), scale, "nosing" if is_of_flight else "turned")
    canvas = np.zeros((picture.shape[0] + BAND_PX, WIDTH_PX, 3), dtype=np.uint8)
    canvas[: picture.shape[0]] = picture
    for number, (line, kind) in enumerate(_words(sight), start=1):
        _write(canvas, line, (12, picture.shape[0] + number * BAND_PX * 2 // 5), COLOURS[kind])
    if sight.heading_rad is not None and sight.sigma_rad is not None:
        centre = WIDTH_PX - DIAL_PX - 20, picture.shape[0] - 20
        _dial(canvas, centre, sight.heading_rad, 1.96 * sight.sigma_rad)
    return canvas


def write_stages(stages: Stages, folder: Path, prefix: str = "fig05") -> list[Path]:
    """Write the six stages of Fig. 5 as ``PREFIX-1.png … -6.png``, each atomically."""
    return [write_picture(picture, folder / f"{prefix}-{number}.png") for number, picture in enumerate(stages, start=1)]


def write_picture(picture: Picture, path: Path) -> Path:
    """Write an image (RGB) as a PNG file, atomically."""
    done, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    if not done:
        raise ImageError(f"{path}: could not be written as PNG")
    write_whole(path, data.tobytes())
    return path


def as_jpeg(picture: Picture, width_px: int | None = None) -> bytes:
    """Return a picture as a JPEG file, scaled to a width if one is given."""
    scaled = picture if width_px is None else _resized(picture, width_px)
    _, data = cv2.imencode(".jpg", cv2.cvtColor(scaled, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return bytes(data)


def from_jpeg(data: bytes, width_px: int) -> Picture:
    """Return a JPEG image, scaled to a width."""
    bgr = np.asarray(cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR))
    return _resized(np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)), width_px)


def _resized(picture: Picture, width_px: int) -> Picture:
    size = width_px, round(width_px * picture.shape[0] / picture.shape[1])
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _words(sight: StairDetection) -> list[tuple[str, str]]:
    """Return the lines of text under the image and the kinds of their colours."""
    if sight.heading_rad is None or sight.sigma_rad is None:
        return [("no heading", "obstacle"), (sight.reason or "", "text")]
    heading = f"heading {sight.heading_rad / DEG:+.2f}° ± {1.96 * sight.sigma_rad / DEG:.2f}° (95 %)"
    heading += f" from {sight.edge_count} nosings"
    if sight.unconfirmed:
        return [(f"{heading}, unconfirmed", "text"), (sight.reason or "", "text")]
    if (seen := sight.stair_map) is None:
        return [(heading, "text")]
    stair = f"flight {seen.direction}: rise {1e3 * seen.rise_m:.0f} mm, run {1e3 * seen.run_m:.0f} mm, "
    stair += f"slope {seen.slope_rad / DEG:.1f}°" + (", ends in view" if seen.ends else "")
    walls = [(seen.left_wall_m, "left"), (seen.right_wall_m, "right")]
    if sight.turn is not None:
        stair += f", {sight.turn}"
    stair += "".join(f", {word} wall {1e2 * free:.0f} cm" for free, word in walls if free is not None)
    if seen.obstacle_m is not None:
        return [(heading, "text"), (f"{stair}, obstacle in {seen.obstacle_m:.2f} m", "obstacle")]
    return [(heading, "text"), (stair, "text")]


def _tint(picture: Picture, surface: Surface, colour: tuple[int, int, int], side_px: int) -> None:
    """Colour the pixels of a surface, column by column, each the reduction of a square of pixels."""
    shade = np.array(colour, dtype=float)
    for column, first, last in zip(surface.upper.columns, surface.upper.rows, surface.lower.rows, strict=True):
        part = picture[side_px * int(first + 0.5) : side_px * int(last + 0.5), side_px * column : side_px * (column + 1)]
        part[:] = ((1.0 - TINT) * part + TINT * shade).astype(np.uint8)


def _line(picture: Picture, camera: PinholeCamera, ends: Float[np.ndarray, "2 3"], scale: float, kind: str) -> None:
    if ends[:, 2].min() <= 0.0:
        return
    u = camera.fx_px * ends[:, 0] / ends[:, 2] + camera.cx_px
    v = camera.fy_px * ends[:, 1] / ends[:, 2] + camera.cy_px
    places = np.round((np.column_stack([u, v]) + 0.5) * scale - 0.5).astype(int)
    cv2.line(picture, tuple(places[0].tolist()), tuple(places[1].tolist()), COLOURS[kind], 2, cv2.LINE_AA)


def _dial(canvas: Picture, centre: tuple[int, int], heading_rad: float, half_rad: float) -> None:
    """Draw the heading as a needle seen from above, the flight straight up, with its interval as a wedge; left is anticlockwise."""

    def at(radius: float, angle_rad: float) -> tuple[int, int]:
        return round(centre[0] - radius * math.sin(angle_rad)), round(centre[1] - radius * math.cos(angle_rad))

    box = canvas[centre[1] - DIAL_PX - 20 : centre[1] + 16, centre[0] - DIAL_PX - 16 : centre[0] + DIAL_PX + 16]
    box[:] = (0.35 * box).astype(np.uint8)
    cv2.ellipse(canvas, centre, (DIAL_PX, DIAL_PX), -90.0, -60.0, 60.0, COLOURS["text"], 1, cv2.LINE_AA)
    for tick_deg in range(-60, 61, 15):
        inner_px = DIAL_PX - 10.0 + tick_deg % 30 // 3
        cv2.line(canvas, at(float(DIAL_PX), tick_deg * DEG), at(inner_px, tick_deg * DEG), COLOURS["text"])
    wedge = [centre, *(at(DIAL_PX - 12.0, heading_rad + part * max(half_rad, 1.0 / DIAL_PX)) for part in np.linspace(-1.0, 1.0, 9))]
    cv2.fillPoly(canvas, [np.array(wedge, dtype=np.int32)], COLOURS["nosing"], cv2.LINE_AA)


def _write(canvas: Picture, text: str, place: tuple[int, int], colour: tuple[int, int, int]) -> None:
    """Write a line of text; OpenCV before 5 has no degree sign."""
    if hasattr(cv2, "FontFace"):
        cv2.putText(canvas, text, place, colour, cv2.FontFace("sans"), 18)
        return
    plain = text.replace("°", " deg").replace("±", "+-")
    cv2.putText(canvas, plain, place, cv2.FONT_HERSHEY_SIMPLEX, 0.56, colour, 1, cv2.LINE_AA)
