"""Path of a shipped controller: one JSON file per vehicle, made by ``examples/make_controller.py``."""

from pathlib import Path

from treadline.core.errors import SettingsError
from treadline.core.models import ControllerDesign

SHIPPED = Path(__file__).parents[1] / "data" / "controllers"


def shipped_controller(vehicle: str) -> ControllerDesign:
    """Return the controller that is shipped for a vehicle.

    Raises:
        SettingsError: If none is shipped.
    """
    path = SHIPPED / f"{vehicle}.json"
    if not path.exists():
        raise SettingsError(f"no controller is shipped for '{vehicle}'; identify and tune one, then give --controller")
    return ControllerDesign.load(path)
