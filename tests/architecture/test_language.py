"""The wording of the code: docstrings read alone, class names have one meaning, retired terms stay retired."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

import treadline

PACKAGE = Path(treadline.__file__).parent
ROOT = Path(__file__).parents[2]
FOLDERS = [*sorted(path.name for path in PACKAGE.iterdir() if path.is_dir() and any(path.glob("*.py"))), "."]
"""Package folders, and "." for the modules directly in the package."""


def _checker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("language", Path(__file__).with_name("language.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["language"] = module
    spec.loader.exec_module(module)
    return module


language = _checker()


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_folder_reads_in_field_terms(folder: str) -> None:
    found = language.findings(sorted(PACKAGE.glob("*.py")) if folder == "." else language.files_of(PACKAGE / folder))
    assert not found, "\n".join(str(finding) for finding in found)


def _documents() -> list[Path]:
    return [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]


def test_documents_tests_and_benchmarks_use_field_terms() -> None:
    terms = {Path(language.__file__), Path(__file__)}  # which list the retired terms
    files = [*_documents(), *language.files_of(ROOT / "tests"), *language.files_of(ROOT / "benchmarks")]
    found = {str(path.relative_to(ROOT)) for path in files if path not in terms and language.findings([path])}
    assert not found, "python tests/architecture/language.py FILE lists the terms"


def test_at_most_three_percent_of_the_documents_words_are_pronouns() -> None:
    assert language.pronoun_share(page for page in _documents() if page.name != "CHANGELOG.md") <= 0.03


def test_a_class_name_has_one_meaning() -> None:
    twice = set(language.homonyms(sorted(PACKAGE.rglob("*.py"))))
    assert not twice, "class names defined in two modules"


BAD = {
    "a preposition": ('X = 1\n"""Of the chair [m]."""\n', "fragment"),
    "a preposition in a class": ('class A:\n    """A."""\n\n    x: int\n    """From the foot [m]."""\n', "fragment"),
    "lower case": ('X = 1\n"""whether it moves."""\n', "fragment"),
    "a continued sentence": ('X = 1\n"""… and at most half of it."""\n', "continued"),
    "a sentence to be continued": ('X = 1\n"""Speed of the chair …"""\n', "continued"),
    "a retired name": ("class Whereabouts:\n    pass\n", "retired"),
    "a part of a name": ("def arm_angle() -> None:\n    pass\n", "retired"),
    "a parameter": ("def f(told_s):\n    pass\n", "retired"),
    "a docstring": ('"""What the planner is told."""\n', "retired"),
    "a comment": ("x = 1  # the chair stands askew\n", "retired"),
    "a message": ('raise ValueError("the camera tells nothing")\n', "retired"),
}
GOOD = {
    "a quantity": 'X = 1\n"""Speed of the chair [m/s], positive up the stair."""\n',
    "a symbol": 'X = 1\n"""p-value of the whiteness test."""\n\nY = 1\n"""u1, v1: left end of the edge [px]."""\n',
    "a lever arm": "def f(lever_arm_m):\n    # the lever arm about the axle\n    return lever_arm_m\n",
    "code in prose": '"""The key ``arm`` of older files is read as ``flipper``."""\n',
    "an ellipsis within a sentence": 'X = 1\n"""Rows z_1, …, z_n of the record."""\n',
}


@pytest.mark.parametrize("case", BAD)
def test_the_checker_finds(case: str, tmp_path: Path) -> None:
    source, rule = BAD[case]
    (tmp_path / "module.py").write_text(source, encoding="utf-8")
    assert rule in {finding.rule for finding in language.findings(language.files_of(tmp_path))}


@pytest.mark.parametrize("case", GOOD)
def test_the_checker_accepts(case: str, tmp_path: Path) -> None:
    (tmp_path / "module.py").write_text(GOOD[case], encoding="utf-8")
    assert language.findings(language.files_of(tmp_path)) == []


def test_the_checker_finds_a_class_that_is_defined_twice(tmp_path: Path) -> None:
    for name in ("a.py", "b.py"):
        (tmp_path / name).write_text("class Row:\n    pass\n", encoding="utf-8")
    assert list(language.homonyms(language.files_of(tmp_path))) == ["Row"]


def test_a_line_of_a_document_is_named(tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text("# Title\n\nThe planner is told.\n", encoding="utf-8")
    assert [(finding.line, finding.rule) for finding in language.findings([tmp_path / "page.md"])] == [(3, "retired")]
