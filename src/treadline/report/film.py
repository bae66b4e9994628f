"""Film of a run: images at mission times -> animated WebP with the time and the phase of the mission."""

from collections.abc import Iterable
from pathlib import Path

from PIL import Image, ImageDraw

from treadline.core.errors import SettingsError
from treadline.playback import Recording
from treadline.vehicle.film_camera import FRAMES_PER_S

END_S = 2.0
"""Time for which the last image is shown [s]."""
QUALITY = 55
"""WebP quality: a traversal of 50 s stays below 1.5 MB."""
INK = (27, 32, 38)


def write_film(images: Iterable[tuple[float, Image.Image]], recording: Recording, path: Path) -> Path:
    """Write the film of a recording in the format of the file's suffix: .webp or .gif.

    Args:
        images: Mission time [s] and image, in order.

    Raises:
        SettingsError: If there is no image.
    """
    frames = []
    for t_s, image in images:
        span = recording.phase_at(t_s)
        caption = f"{t_s:4.0f} s   {'' if span is None else span.name}"
        ImageDraw.Draw(image).text((16, 12), caption, fill=INK, font_size=17)
        frames.append(image)
    if not frames:
        raise SettingsError(f"{path}: the run is shorter than the time between two images of its film; let it run longer")
    durations = [round(1000.0 / FRAMES_PER_S)] * (len(frames) - 1) + [round(1000.0 * END_S)]
    path.parent.mkdir(parents=True, exist_ok=True)
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=durations, loop=0, quality=QUALITY, method=4)
    return path
