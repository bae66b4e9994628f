"""docs/paper-map.md is complete, and each function, path and command on it exists."""

import re
from dataclasses import dataclass, is_dataclass
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from treadline.perception.paper import printed_heading as heading
from treadline.perception.paper.printed_heading import world_x

ROOT = Path(__file__).parents[2]
MAP = ROOT / "docs" / "paper-map.md"
EQUATIONS = [*"12345", "6a", "6b", "7a", "7b", "8a", "8b", "9a", "9b", "9c", "10", "11a", "11b", "12", "13", "14"]
PARAMETERS = (
    "mass of the system",
    "mass of the payload",
    "μ",
    "μ₂",
    "β",
    "v_system(max)",
    "ω_system(max)",
    "freq_imu",
    "freq_camera",
    "freq_control",
)
ITEMS = [
    *(f"Eq. ({number})" for number in EQUATIONS),
    *(f"Algorithm 1, step {step}" for step in range(1, 7)),
    *(f"Fig. {number}" for number in range(1, 12)),
    "Table I",
    "Table II",
    *(f"Table I: {name}" for name in PARAMETERS),
    *("Ts", "1000 samples", "rank 2", "Q", "R", "L > 2√(h²+w²)", "three pulleys", "seat linkage"),
]


@dataclass(frozen=True)
class Row:
    item: str
    what: str
    code: list[str]
    """File and function, as in ``src/treadline/core/paper.py:K``."""
    test: list[str]
    command: str

    @property
    def files(self) -> list[str]:
        """Files of the code."""
        return [entry.partition(":")[0] for entry in self.code]


def rows() -> dict[str, Row]:
    found = {}
    for line in MAP.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| ") and len(cells) == 5 and cells[0] != "item" and set(cells[0]) != {"-"}:
            assert cells[0] not in found, f"{cells[0]} has two rows"
            found[cells[0]] = Row(cells[0], cells[1], _quoted(cells[2]), _quoted(cells[3]), cells[4].strip("`"))
    return found


def _quoted(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


def cited(tag: str) -> set[str]:
    """Return the items that a ``Paper:`` line names: lists and ranges of equations, steps, figures, tables."""
    items: set[str] = set()
    for numbers in re.findall(r"Eq\. ((?:\(\w+\)(?:, |-| and | to )?)+)", tag):
        ends = re.findall(r"\((\w+)\)", numbers)
        if re.search(r"\)(?:-| to )\(", numbers):
            ends = [str(k) for k in range(int(ends[0]), int(ends[-1]) + 1)]
        for end in ends:
            items |= {f"Eq. ({number})" for number in EQUATIONS if number == end or number.rstrip("abc") == end}
    for steps in re.findall(r"Algorithm 1(?:, steps? ([\d, and]+))?", tag):
        wanted = re.findall(r"\d", steps) or list("123456")
        items |= {f"Algorithm 1, step {step}" for step in wanted}
    items |= {f"Fig. {number}" for number in re.findall(r"Fig\. (\d+)", tag)}
    items |= {f"Table {number}" for number in re.findall(r"Table (II?)\b", tag)}
    if "2√(h² + w²)" in tag:
        items.add("L > 2√(h²+w²)")
    return items


def tags() -> list[tuple[str, str]]:
    """Return (path, first sentence) of every ``Paper:`` line of the source."""
    paragraph = re.compile(r"^ *Paper: (.+?)(?:\n\s*\n|\"\"\")", re.MULTILINE | re.DOTALL)
    return [
        (path.relative_to(ROOT).as_posix(), re.split(r"\.\s+(?=[A-Z\"])", tag)[0].replace("\n", " "))
        for path in sorted((ROOT / "src").rglob("*.py"))
        for tag in paragraph.findall(path.read_text(encoding="utf-8"))
    ]


@pytest.mark.parametrize("item", ITEMS)
def test_the_map_has_a_row_with_code_test_and_command(item: str) -> None:
    row = rows()[item]
    assert row.what
    assert row.code
    assert row.test
    assert row.command


def test_the_map_has_no_row_for_what_the_paper_does_not_have() -> None:
    assert sorted(rows()) == sorted(ITEMS)


def test_every_path_on_the_map_exists() -> None:
    named = {path for row in rows().values() for path in [*row.files, *row.test, *_quoted(row.what)]}
    assert sorted(path for path in named if not (ROOT / path).is_file()) == []


def test_every_row_names_functions_classes_or_constants_that_exist() -> None:
    for row in rows().values():
        for entry in row.code:
            path, _, name = entry.partition(":")
            if not path.endswith(".py"):
                continue  # a file of data has no functions
            assert name, f"{row.item}: {path} without a function"
            module = import_module(path.removeprefix("src/").removeprefix("docs/tools/").removesuffix(".py").replace("/", "."))
            assert hasattr(module, name), f"{row.item}: {path} has no {name}"


def test_equation_1_is_called_by_equation_3_on_the_way_of_algorithm_1(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[float, float]] = []

    def counted(x_px: float, depth_m: float, a: float, centre_px: float) -> float:
        calls.append((x_px, depth_m))
        return world_x(x_px, depth_m, a, centre_px)

    monkeypatch.setattr(heading, "world_x", counted)
    found = heading.delta_x(np.array([100.0, 2.0]), np.array([500.0, 3.0]), 0.002, 320.0)
    assert calls == [(500.0, 3.0), (100.0, 2.0)]
    # Eq. (3) as printed: a (X2 D2 - X1 D1 + 320 (D1 - D2)); rounding alone.
    assert found == pytest.approx(0.002 * (500.0 * 3.0 - 100.0 * 2.0 + 320.0 * (2.0 - 3.0)), rel=1e-12)


def test_every_command_on_the_map_is_one_of_ours() -> None:
    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    verbs = {path.stem for path in (ROOT / "src/treadline/cli").glob("*.py")}
    for command in (command for row in rows().values() for command in row.command.split("; ")):
        program, word = command.split()[:2]
        assert word in (targets if program == "make" else verbs), command
        assert program in ("make", "treadline")
        if program == "treadline":
            options = re.findall(r"--[\w-]+", command)
            assert [option for option in options if option not in _options(word)] == [], command


def _options(verb: str) -> set[str]:
    """Return the options of a command: those of its parameters, and names given in their annotations."""
    parameters = dict(signature(getattr(import_module(f"treadline.cli.{verb}"), verb), eval_str=True).parameters)
    for parameter in tuple(parameters.values()):  # options that belong together are the fields of one dataclass
        kind = get_args(parameter.annotation)[0] if get_args(parameter.annotation) else parameter.annotation
        if is_dataclass(kind):
            parameters |= signature(kind, eval_str=True).parameters
    named = {
        name
        for parameter in parameters.values()
        for note in getattr(parameter.annotation, "__metadata__", ())
        for name in getattr(note, "name", None) or ()
    }
    return named | {f"--{name.replace('_', '-')}" for name in parameters}


def test_every_paper_line_of_the_source_is_on_the_map() -> None:
    listed = rows()
    missing = [
        f"{path} says '{tag[:60]}': add it to the row {item}"
        for path, tag in tags()
        for item in sorted(cited(tag))
        if item not in listed or path not in listed[item].files
    ]
    assert missing == []


@pytest.mark.parametrize(
    ("tag", "items"),
    [
        ("Eq. (1)-(4).", {"Eq. (1)", "Eq. (2)", "Eq. (3)", "Eq. (4)"}),
        ("Eq. (9a), (9b).", {"Eq. (9a)", "Eq. (9b)"}),
        ("Section V, Eq. (11).", {"Eq. (11a)", "Eq. (11b)"}),
        ("Algorithm 1, steps 5 and 6, Fig. 5(e), (f).", {"Algorithm 1, step 5", "Algorithm 1, step 6", "Fig. 5"}),
        ("Fig. 10, Table II. 80 s", {"Fig. 10", "Table II"}),
    ],
)
def test_lists_and_ranges_in_a_paper_line_are_understood(tag: str, items: set[str]) -> None:
    assert cited(tag) == items


def test_the_source_speaks_of_the_paper() -> None:
    # A parser that finds nothing would pass every test above.
    assert len(tags()) > 40
    assert len({item for _, tag in tags() for item in cited(tag)}) > 30
