"""Pictures of what was seen, as PNG files."""

from pathlib import Path

import cv2

from treadline.errors import ImageError
from treadline.perception.sight import Stages


def write_stages(stages: Stages, folder: Path, prefix: str = "fig05") -> list[Path]:
    """Write the six stages of Fig. 5 as ``PREFIX-1.png … -6.png``, each whole or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number, picture in enumerate(stages.pictures, start=1):
        done, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
        if not done:
            raise ImageError(f"stage {number} could not be written as PNG")
        path = folder / f"{prefix}-{number}.png"
        temporary = path.with_suffix(".part")
        temporary.write_bytes(data.tobytes())
        temporary.replace(path)
        paths.append(path)
    return paths
