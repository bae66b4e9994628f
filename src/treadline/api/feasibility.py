"""``tl.check``: mechanical feasibility of a scenario, before anything moves."""

from pathlib import Path

from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario, read_scenario
from treadline.vehicle.verdict import CheckReport
from treadline.vehicle.verdict import check as checked


def check(scenario: str | Path | Scenario) -> CheckReport:
    """Return the mechanical feasibility of a scenario: track length, traction, stability and seat range.

    No controller is needed, so that the answer is available for a chair for which none exists yet.

    Args:
        scenario: Scenario file, the name of a shipped scenario, or a scenario.

    Returns:
        The report; ``report.verdict`` is ``go`` or ``refuse``, ``report.reasons`` lists why.

    Raises:
        SettingsError: If the scenario or its chair cannot be read.
    """
    settings = scenario if isinstance(scenario, Scenario) else read_scenario(scenario)
    return checked(settings, read_chair(settings.chair.model))
