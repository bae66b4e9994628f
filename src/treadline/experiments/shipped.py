"""Controllers that come with the package."""

from pathlib import Path

from treadline.errors import SettingsError
from treadline.models import ControllerDesign

SHIPPED = Path(__file__).parents[1] / "data" / "controllers"


def shipped_controller(vehicle: str) -> ControllerDesign:
    """Return the controller shipped for a vehicle; ``examples/make_controller.py`` makes it.

    Raises:
        SettingsError: If none is shipped.
    """
    path = SHIPPED / f"{vehicle}.json"
    if not path.exists():
        raise SettingsError(f"no controller is shipped for '{vehicle}'; identify and tune one, then give --controller")
    return ControllerDesign.load(path)
