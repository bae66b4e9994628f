"""Files that a user writes, typed and checked: scenario, stair, chair, camera, faults and operator actions.

Contract: ``Scenario``, ``read_scenario``, ``shipped_scenarios``, loaded at their first use: who reads a camera or chair file alone
loads no scenario.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from treadline.scenario.scenario import Scenario, read_scenario, shipped_scenarios

__all__ = ["Scenario", "read_scenario", "shipped_scenarios"]


def __getattr__(name: str) -> Any:
    """Return a name of the contract (PEP 562)."""
    if name not in __all__:
        raise AttributeError(f"module 'treadline.scenario' has no attribute '{name}'")
    return getattr(import_module("treadline.scenario.scenario"), name)
