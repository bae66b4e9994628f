"""``treadline check``: mechanical feasibility of a scenario."""

from dataclasses import asdict, replace
from pathlib import Path

from treadline import api
from treadline.cli._arguments import Set, set_values
from treadline.cli._output import Answer
from treadline.core.errors import SettingsError


def check(scenario: str | None = None, /, *, changes: Set = None, plot: Path | None = None, keys: bool = False) -> Answer:
    """Check a scenario: the planner walks the whole ground with a chair at rest; friction, brakes, seat, start and view too.

    treadline check --keys > mine.toml

    Args:
        scenario: Scenario file, or the name of a shipped scenario.
        plot: Figure to write (.svg, .png, .pdf): the chair at five places, margins, pitch rate and torque along its way.
        keys: List the shipped scenarios and all keys of a scenario with type, range, default and meaning, as a scenario file of
            the defaults, and exit.
    """
    if keys:
        return _keys()
    if scenario is None:
        raise SettingsError("check needs a scenario: a file, or the name of a shipped one; treadline check --keys lists both")
    report = api.check(scenario, set=set_values(changes))
    if plot is not None:
        from treadline.report.model_plots import save_figure

        save_figure(report.plot(), plot)
    values = asdict(replace(report, walk=None))
    del values["walk"]
    return Answer(values=values, summary=str(report).splitlines(), code=0 if report.verdict == "go" else 1)


def _keys() -> Answer:
    """Return all keys of a scenario; the lines are a scenario file of the defaults."""
    from pydantic_core import PydanticUndefined

    from treadline.core.setting_docs import tables_of
    from treadline.scenario.faults import EXTENTS
    from treadline.scenario.scenario import Scenario, shipped_scenarios

    tables = tables_of(Scenario)
    shipped = sorted(shipped_scenarios())
    lines = [f"# Shipped scenarios: {', '.join(shipped)}"]
    values = {}
    for head, (purpose, keys) in tables.items():
        several = head.startswith("[[")
        lines += ["", f"# {purpose}", f"# {head}, any number of times" if several else head]
        # An item of a list is none of the defaults: it stands as a comment.
        lines += [f"# {key.line.removeprefix('# ')}" if several else key.line for key in keys]
        for key in keys:
            name = ".".join(str(part) for part in key.place if part != 0)
            default = None if key.default is PydanticUndefined else key.default
            values[name] = {"default": default, "allowed": key.allowed, "meaning": key.meaning}
    lines += [f"#   {kind}: value is {extent.means}" for kind, extent in EXTENTS.items()]
    return Answer(values={"keys": values, "scenarios": shipped}, summary=lines)
