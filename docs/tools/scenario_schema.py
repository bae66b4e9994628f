"""Write the JSON Schema of the scenario file: ``python docs/tools/scenario_schema.py FILE``."""

import json
import sys
from pathlib import Path
from typing import Any

from treadline.core.setting_docs import meanings
from treadline.core.settings import Settings
from treadline.scenario.scenario import Scenario


def schema() -> dict[str, Any]:
    """Return the schema of the settings classes, with the docstring of each key as its description."""
    whole = Scenario.model_json_schema()
    classes = {cls.__name__: cls for cls in _all_subclasses(Settings)}
    for name, table in whole["$defs"].items():
        if name in classes:
            docs = meanings(classes[name])
            for key, value in table.get("properties", {}).items():
                if key in docs:
                    value["description"] = docs[key]
    about = {"title": "treadline scenario", "description": whole["description"].partition("\n\n")[0]}  # without the Python example
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **whole, **about}


def _all_subclasses(base: type) -> set[type]:
    return {base}.union(*(_all_subclasses(cls) for cls in base.__subclasses__()))


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(json.dumps(schema(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
