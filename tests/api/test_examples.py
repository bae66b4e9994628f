"""The examples in the docstrings of the public names: each name has one, and each example prints what it says."""

import doctest
from pathlib import Path

import pytest

import treadline as tl

NAMES = sorted(set(tl.__all__) - {"__version__"})


@pytest.mark.parametrize("name", NAMES)
def test_an_example_prints_what_its_docstring_says(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # where examples write their files
    item = getattr(tl, name)
    (example,) = doctest.DocTestFinder(recurse=False).find(item, name, globs={})
    assert example.examples, f"tl.{name} has no example"
    said: list[str] = []
    failed = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(example, out=said.append).failed
    assert not failed, "".join(said)
