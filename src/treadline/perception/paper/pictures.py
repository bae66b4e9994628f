"""Result images as PNG files."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from treadline.core.errors import ImageError
from treadline.core.files import write_whole
from treadline.perception.detection import Stages


def write_stages(stages: Stages, folder: Path, prefix: str = "fig05") -> list[Path]:
    """Write the six stages of Fig. 5 as ``PREFIX-1.png … -6.png``, each atomically."""
    return [write_picture(picture, folder / f"{prefix}-{number}.png") for number, picture in enumerate(stages.pictures, start=1)]


def write_picture(picture: UInt8[np.ndarray, "h w 3"], path: Path) -> Path:
    """Write an image (RGB) as a PNG file, atomically."""
    done, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    if not done:
        raise ImageError(f"{path}: could not be written as PNG")
    write_whole(path, data.tobytes())
    return path
