"""Files of chairs, cameras and controllers: the shipped ones by name, or the user's own.

A controller is shipped for each vehicle: one JSON file, made by ``examples/make_controller.py``.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from treadline.core.errors import SettingsError, closest
from treadline.core.files import DATA

if TYPE_CHECKING:
    from treadline.core.models import ControllerDesign

CHAIRS, CAMERAS, CONTROLLERS = DATA / "chairs", DATA / "cameras", DATA / "controllers"
KEYS = {CHAIRS: "chair.model", CAMERAS: "sensors.camera"}
"""Key of a scenario that names a file, by the folder of the shipped ones."""


def file_named(name: str, shipped_in: Path, *folders: Path) -> Path:
    """Return the path of a chair's or camera's file.

    Args:
        name: Name of a shipped one, or path of a TOML file.
        shipped_in: ``CHAIRS`` or ``CAMERAS``.
        folders: Folders in which a relative path is sought first.

    Raises:
        SettingsError: If there is none.
    """
    key = KEYS[shipped_in]
    if Path(name).suffix == ".toml":
        places = [*(folder / name for folder in folders), Path(name)]
        found = next((place for place in places if place.exists()), None)
        if found is None:
            looked = ", ".join(dict.fromkeys(str(place) for place in places))
            raise SettingsError(f"{key}: no file '{name}' (looked for {looked}); correct the path")
        return found
    shipped = {found.stem: found for found in shipped_in.glob("*.toml")}
    if name not in shipped:
        meant = closest(name, shipped)
        remedy = "or give a path to a .toml" if meant is None else f"did you mean '{meant}'?"
        kind = shipped_in.name.removesuffix("s")
        raise SettingsError(f"{key}: no shipped {kind} {name!r} (shipped: {', '.join(sorted(shipped))}); {remedy}")
    return shipped[name]


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
