"""Scenario as TOML text, so that a drawn run can be repeated on its own."""

import json
from collections.abc import Mapping
from typing import Any

from treadline.scenario.scenario import Scenario


def scenario_toml(scenario: Scenario, note: str) -> str:
    """Return the text of a scenario file with every key; it reads back as the identical scenario."""
    lines = [f"# {note}"]
    for table, value in scenario.model_dump(exclude_none=True).items():
        tables = value if isinstance(value, tuple) else (value,)
        for one in tables:
            lines += ["", f"[[{table}]]" if isinstance(value, tuple) else f"[{table}]"]
            lines += _keys(one)
    return "\n".join(lines) + "\n"


def _keys(table: Mapping[str, Any]) -> list[str]:
    # JSON writes strings, numbers, true and false as TOML does; numbers by repr, without loss.
    return [f"{key} = {json.dumps(value)}" for key, value in table.items()]
