"""The drawings of docs/drawings: complete, small, the same bytes every time, and drawn from the chair that runs."""

from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from drawings.paper_figures import DRAWINGS, write_drawings

from treadline.report.svg_figures import svg_of

SHIPPED = Path(__file__).parents[2] / "docs" / "drawings"
LARGEST_BYTES = 120_000
"""Size of a drawing [bytes]: the silhouettes of a chair with a hundred lugs, and letters as outlines."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drawings")
    write_drawings(folder)
    return folder


@pytest.mark.parametrize("name", DRAWINGS)
def test_a_drawing_is_a_small_picture_that_needs_nothing_else_and_the_same_twice(folder: Path, name: str) -> None:
    path = folder / f"{name}.svg"
    text = path.read_text(encoding="utf-8")
    assert path.stat().st_size < LARGEST_BYTES
    assert ET.fromstring(text).tag == "{http://www.w3.org/2000/svg}svg"  # noqa: S314 - our own file
    assert "<script" not in text
    assert "<image" not in text
    assert svg_of(DRAWINGS[name]()) in text


def test_docs_hold_every_drawing_and_no_other() -> None:
    assert sorted(path.stem for path in SHIPPED.glob("fig*.svg")) == sorted(DRAWINGS)
