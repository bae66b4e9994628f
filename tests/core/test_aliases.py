"""Former module names: still importable for one release, with a warning that names the present place."""

import importlib
import sys
from pathlib import Path

import pytest

import treadline
from treadline.core.aliases import FURTHER, PLACES

SOURCE = Path(treadline.__file__).parent


@pytest.mark.parametrize("name", sorted(PLACES))
def test_a_former_name_is_the_module_at_its_present_place(name: str) -> None:
    sys.modules.pop(f"treadline.{name}", None)
    with pytest.warns(DeprecationWarning, match=rf"treadline\.{PLACES[name]} since version 0\.3"):
        former = importlib.import_module(f"treadline.{name}")
    present = importlib.import_module(f"treadline.{PLACES[name]}")
    assert former is present or name in FURTHER
    assert [public for public in vars(present) if not public.startswith("_") and not hasattr(former, public)] == []


@pytest.mark.filterwarnings("ignore:treadline:DeprecationWarning")
@pytest.mark.parametrize("name", sorted(FURTHER))
def test_a_module_that_was_split_has_the_names_of_both_parts(name: str) -> None:
    sys.modules.pop(f"treadline.{name}", None)
    former = importlib.import_module(f"treadline.{name}")
    for place in (PLACES[name], FURTHER[name]):
        present = importlib.import_module(f"treadline.{place}")
        assert [public for public in vars(present) if not public.startswith("_") and not hasattr(former, public)] == []


def test_a_module_keeps_its_own_name() -> None:
    sys.modules.pop("treadline.models", None)
    with pytest.warns(DeprecationWarning, match="core"):
        models = importlib.import_module("treadline.models")
    assert models.__name__ == "treadline.core.models"
    assert models.__spec__.name == "treadline.core.models"


def test_a_former_name_hides_no_present_module() -> None:
    for name in PLACES:
        path = SOURCE.joinpath(*name.split("."))
        assert not path.is_dir()
        assert not path.with_suffix(".py").exists()


def test_a_name_that_never_was_is_not_found() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"treadline\.nowhere"):
        importlib.import_module("treadline.nowhere")
