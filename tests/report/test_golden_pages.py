"""Every page of the package as text: what it shows, that it asks for nothing, and that hostile text on it does nothing.

``TREADLINE_ACCEPT=1 pytest tests/report/test_golden_pages.py`` writes the files of ``golden`` anew; read what git then shows.
"""

import re
from collections.abc import Callable
from difflib import unified_diff
from functools import cache
from pathlib import Path

import pytest
from page_text import PageText

from treadline.report.player_page import player_page

from .conftest import Transcript, climbing, reproduced, write_reproduction
from .pages import A_CALM, PAGES, Make, identification_page, model_with, of_run, read

GOLDEN = Path(__file__).with_name("golden")
ALL = [(kind, title) for kind, made in PAGES.items() for title in made]
MOST_BYTES = 40_000
"""Largest golden file [bytes]: one that a reviewer still reads."""
OLD = 40
"""Letters of a line that a changed page lacks: the whole line stands in the first page."""
Shown = Callable[[str, str], tuple[str, PageText]]


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """Return what draws a page of ``PAGES`` once, and returns it with its text."""

    @cache
    def draw(kind: str, title: str) -> tuple[str, PageText]:
        page = PAGES[kind][title](tmp_path_factory.mktemp(kind))
        return page, PageText(page)

    return draw


@pytest.mark.parametrize(("kind", "title"), ALL)
def test_a_page_shows_what_its_golden_file_says(shown: Shown, kind: str, title: str) -> None:
    first, lines = next(iter(PAGES[kind])), shown(kind, title)[1].lines
    if title != first:
        differing = unified_diff(shown(kind, first)[1].lines, lines, n=0, lineterm="")
        changes = [line if line[0] == "+" else line[:OLD] for line in differing if not line.startswith(("---", "+++", "@@"))]
        lines = min(lines, changes, key=lambda text: len("".join(text)))
    golden = Transcript(GOLDEN / f"{kind}.txt")
    golden.check(title, lines)
    assert golden.path.stat().st_size < MOST_BYTES


@pytest.mark.parametrize(("kind", "title"), ALL)
def test_a_page_asks_for_nothing_and_names_no_host(shown: Shown, kind: str, title: str) -> None:
    page, text = shown(kind, title)
    assert "default-src 'none'" in page
    assert not re.search(r"https?:|@import|//[a-z]+\.[a-z]", page)
    assert all(address.startswith(("#", "data:", "runs/")) for address in text.addresses)
    assert {address[1:] for address in text.addresses if address.startswith("#") and "=" not in address} <= set(text.ids)
    assert text.tags.isdisjoint({"link", "iframe", "object", "image", "foreignObject"})
    assert page.count("<script") == {"run": 2, "player": 2}.get(kind, 0)  # the player's data, and its script under its hash
    assert not any(re.search(r"\bnan\b|undefined", line, re.IGNORECASE) for line in text.lines)


HOSTILE = '</script><script>alert("x")</script><img src=http://example.org/x onerror=alert(1)>{{ 7*7 }}$x$ --><b>'


def _hostile_run(folder: Path) -> str:
    event = {"t_s": 0.0, "name": HOSTILE, "cause": HOSTILE}
    robot = {"robot": {"name": HOSTILE, "mission": {"chair": "wheelchair"}}}
    return of_run(events=[event], settings=robot, command=HOSTILE, verdict=HOSTILE, **{HOSTILE: 1.0})(folder)


def _hostile_reproduction(folder: Path) -> str:
    results = reproduced()
    results["command"] = results["git_commit"] = HOSTILE
    results["versions"] = {HOSTILE: HOSTILE}
    for part in ("fig05", "fig08", "fig11"):
        results[part]["conditions"] = HOSTILE
    results["fig08"]["slopes"][0]["warnings"] = [HOSTILE]
    results["table1"][0] = dict.fromkeys(("parameter", "paper", "ours"), HOSTILE)
    for row in (results["literal"]["runs"][0], results["fig09"][0]):
        row["verdict"] = HOSTILE
    for row in results["table2"]:
        row |= {"conditions": HOSTILE, "paper_label": HOSTILE, "verdicts": [HOSTILE]}
    return read(write_reproduction(folder / "reproduce", results))


def _hostile_identification(folder: Path) -> str:
    names = (HOSTILE, "right\n\x00\x07" + "x" * 300), ("$\\frac{$", "見出し_rad")
    said = {"warnings": [HOSTILE], "method": HOSTILE, "fit_conditions": HOSTILE, "title": HOSTILE}
    return identification_page(folder, model_with(A_CALM, *names), names=names, **said)


HOSTILE_PAGES: dict[str, tuple[Make, int]] = {
    "run": (_hostile_run, 5),
    "player": (lambda _: player_page(climbing(cause=HOSTILE)), 1),
    "reproduction": (_hostile_reproduction, 15),
    "identification": (_hostile_identification, 4),
}
"""Pages with hostile text wherever a user may name something, and how often they show it at least."""


@pytest.mark.parametrize("kind", HOSTILE_PAGES)
def test_hostile_text_is_shown_and_does_nothing(shown: Shown, kind: str, tmp_path: Path) -> None:
    make, times = HOSTILE_PAGES[kind]
    page = make(tmp_path)
    usual, text = shown(kind, next(iter(PAGES[kind])))[0], PageText(page)
    assert HOSTILE not in page
    assert page.count("<script") == usual.count("<script")
    assert text.tags.isdisjoint({"b", "img"})
    assert sum(line.replace('\\"', '"').count(HOSTILE) for line in text.lines) >= times
