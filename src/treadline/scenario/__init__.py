"""Files that a user writes, typed and checked: scenario, stair, chair, camera, faults and operator actions.

Contract: ``Scenario``, ``read_scenario``, ``with_values``, ``shipped_scenarios``.
"""

from treadline.scenario.scenario import Scenario, read_scenario, shipped_scenarios, with_values

__all__ = ["Scenario", "read_scenario", "shipped_scenarios", "with_values"]
