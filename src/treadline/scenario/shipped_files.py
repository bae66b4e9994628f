"""Files of chairs and controllers: the shipped ones by name, or the user's own.

A controller is shipped for each vehicle: one JSON file, made by ``examples/make_controller.py``.
"""

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from treadline.core.errors import SettingsError, closest

if TYPE_CHECKING:
    from treadline.core.models import ControllerDesign

DATA = Path(__file__).parents[1] / "data"
CHAIRS, CONTROLLERS = DATA / "chairs", DATA / "controllers"


def chair_file(model: str, *folders: Path) -> Path:
    """Return the path of a chair file.

    Args:
        model: Name of a shipped chair, or path of a TOML file.
        folders: Folders in which a relative path is sought first.

    Raises:
        SettingsError: If there is none.
    """
    if Path(model).suffix == ".toml":
        places = [*(folder / model for folder in folders), Path(model)]
        found = next((place for place in places if place.exists()), None)
        if found is None:
            looked = ", ".join(dict.fromkeys(str(place) for place in places))
            raise SettingsError(f"chair.model: no file '{model}' (looked for {looked}); correct the path")
        return found
    shipped = _shipped()
    if model not in shipped:
        meant = closest(model, shipped)
        remedy = "or give a path to a .toml" if meant is None else f"did you mean '{meant}'?"
        raise SettingsError(f"chair.model: no shipped chair {model!r} (shipped: {', '.join(sorted(shipped))}); {remedy}")
    return shipped[model]


@cache
def _shipped() -> dict[str, Path]:
    return {found.stem: found for found in CHAIRS.glob("*.toml")}


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
