"""The reference: the committed schema is the settings classes', and the command page lists every command."""

import importlib
import importlib.util
import json
import tomllib
from pathlib import Path
from types import ModuleType

from scripts import module_of

from treadline.cli import VERBS
from treadline.scenario.scenario import shipped_scenarios

DOCS = Path(__file__).parents[2] / "docs"


def _tool(name: str) -> ModuleType:
    return module_of(DOCS / "tools" / f"{name}.py")


def test_the_committed_schema_is_the_one_of_the_settings_classes() -> None:
    committed = json.loads((DOCS / "reference" / "scenario.schema.json").read_text(encoding="utf-8"))
    assert committed == json.loads(json.dumps(_tool("scenario_schema").schema())), "write it again: make schema"


def test_the_page_of_hazards_has_the_rules_of_the_guard() -> None:
    page = (DOCS / "explanation" / "safety.md").read_text(encoding="utf-8")
    assert page == _tool("hazards").with_table(page), "write it again: make docs"


def test_the_schema_has_every_key_of_the_shipped_scenarios() -> None:
    schema = json.loads((DOCS / "reference" / "scenario.schema.json").read_text(encoding="utf-8"))
    for path in shipped_scenarios().values():
        for name, table in tomllib.loads(Path(path).read_text(encoding="utf-8")).items():
            if name == "draw":  # a sweep's distributions are no part of a scenario
                continue
            asked = schema["properties"][name]
            defined = schema["$defs"][asked.get("items", asked)["$ref"].rpartition("/")[2]]
            keys = set(table) if isinstance(table, dict) else set().union(*table)
            assert keys <= set(defined["properties"]), (path, name)


def test_the_command_page_shows_the_help_of_every_command() -> None:
    page = _tool("commands").reference()
    for heading, verbs in VERBS.items():
        assert f"\n## {heading}\n" in page
        for verb in verbs:
            assert f"Usage: treadline {verb}" in page


def _exists(name: str) -> bool:
    """Return whether a name is that of a module or of an attribute of one."""
    module, _, attribute = name.rpartition(".")
    if attribute[:1].isupper():
        return hasattr(importlib.import_module(module), attribute)
    return importlib.util.find_spec(name) is not None


def test_every_module_of_the_python_reference_exists() -> None:
    pages = sorted((DOCS / "reference" / "api").glob("*.md"))
    named = [
        line.removeprefix("::: ")
        for page in pages
        for line in page.read_text(encoding="utf-8").splitlines()
        if line.startswith("::: ")
    ]
    assert len(named) > 20
    assert [name for name in named if not _exists(name)] == []
