"""Import of a user's own modules, which lie in the working folder."""

import importlib
import sys
from pathlib import Path
from types import ModuleType


def own_module(name: str) -> ModuleType:
    """Return a module by its name, sought in the working folder first.

    Raises:
        ImportError: If there is none, or it imports what is missing; also whatever its own code raises.
    """
    here = str(Path.cwd())
    added = here not in sys.path
    if added:
        sys.path.insert(0, here)
    try:
        return importlib.import_module(name)
    finally:
        if added:
            sys.path.remove(here)
