"""Files of chairs, cameras and controllers: the shipped ones by name, or the user's own.

A controller is shipped for each vehicle: one JSON file, made by ``examples/make_controller.py``.
"""

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from treadline.core.errors import SettingsError, closest

if TYPE_CHECKING:
    from treadline.core.models import ControllerDesign

DATA = Path(__file__).parents[1] / "data"
CHAIRS, CAMERAS, CONTROLLERS = DATA / "chairs", DATA / "cameras", DATA / "controllers"


def chair_file(model: str, *folders: Path) -> Path:
    """Return the path of a chair file.

    Args:
        model: Name of a shipped chair, or path of a TOML file.
        folders: Folders in which a relative path is sought first.

    Raises:
        SettingsError: If there is none.
    """
    return _found("chair.model", CHAIRS, model, folders)


def camera_path(camera: str, *folders: Path) -> Path:
    """Return the path of a camera file.

    Args:
        camera: Name of a shipped camera, or path of a TOML file.
        folders: Folders in which a relative path is sought first.

    Raises:
        SettingsError: If there is none.
    """
    return _found("sensors.camera", CAMERAS, camera, folders)


def _found(key: str, shipped_in: Path, name: str, folders: tuple[Path, ...]) -> Path:
    if Path(name).suffix == ".toml":
        places = [*(folder / name for folder in folders), Path(name)]
        found = next((place for place in places if place.exists()), None)
        if found is None:
            looked = ", ".join(dict.fromkeys(str(place) for place in places))
            raise SettingsError(f"{key}: no file '{name}' (looked for {looked}); correct the path")
        return found
    shipped = _shipped(shipped_in)
    if name not in shipped:
        meant = closest(name, shipped)
        remedy = "or give a path to a .toml" if meant is None else f"did you mean '{meant}'?"
        kind = shipped_in.name.removesuffix("s")
        raise SettingsError(f"{key}: no shipped {kind} {name!r} (shipped: {', '.join(sorted(shipped))}); {remedy}")
    return shipped[name]


@cache
def _shipped(folder: Path) -> dict[str, Path]:
    return {found.stem: found for found in folder.glob("*.toml")}


def shipped_controller(vehicle: str) -> "ControllerDesign":
    """Return the controller that is shipped for a vehicle.

    Raises:
        SettingsError: If none is shipped.
    """
    from treadline.core.models import ControllerDesign  # here, because scenarios name chairs and need no controller

    path = CONTROLLERS / f"{vehicle}.json"
    if not path.exists():
        raise SettingsError(f"no controller is shipped for '{vehicle}'; identify and tune one, then give --controller")
    return ControllerDesign.load(path)
