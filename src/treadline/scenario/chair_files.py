"""Path of a chair file: a shipped one by its name, or the user's own.

``model -> path``, for scenarios, which name a chair, and for the code that reads it.
"""

from functools import cache
from pathlib import Path

from treadline.core.errors import SettingsError

CHAIRS = Path(__file__).parents[1] / "data" / "chairs"


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
        known = ", ".join(sorted(shipped))
        raise SettingsError(f"chair.model: no shipped chair {model!r} (shipped: {known}); or give a path to a .toml")
    return shipped[model]


@cache
def _shipped() -> dict[str, Path]:
    return {found.stem: found for found in CHAIRS.glob("*.toml")}
