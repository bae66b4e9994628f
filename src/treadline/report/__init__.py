"""Figures, tables and pages, drawn from run folders alone.

Contract: ``write_report`` here; ``player_page.write_player`` for one recording; ``identification_page``, which loads no other
page; ``run_figure.single_run``; ``side_view.SideViews`` and its silhouettes; ``comparison`` for the published figures; ``labels``
and ``answers`` for the words that campaign and live view share with the pages; ``html_pages`` for the rendering of every page;
``svg_figures`` for the drawings of the documents.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from treadline.core.errors import SettingsError

__all__ = ["write_report"]


def write_report(folder: Path, each: Callable[[str, Callable[[Any], Any], Sequence[Any]], list[Any]] | None = None) -> Path:
    """Write ``report.html`` of a reproduce folder and of its runs, or of one run's folder; return its path.

    Args:
        folder: Folder of a reproduction or of a run.
        each: Receives a title, the function that writes the page of one run of a reproduction, and the runs; returns the results,
            which may come from other processes. In this process if left out.

    Raises:
        SettingsError: If the folder holds neither, or a file in it lacks or mistypes something.
        LogFormatError: If the log of a single run is missing or damaged.
    """
    if (folder / "results.json").exists():
        from treadline.report._reproduction_page import write_reproduction_page

        return write_reproduction_page(folder, each or (lambda _title, function, items: list(map(function, items))))
    if (folder / "result.json").exists():
        from treadline.report._run_page import write_run_page

        write_run_page(folder)
        return folder / "report.html"
    if (folder / "journal.jsonl").exists():
        there = "its report.html is there" if (folder / "report.html").exists() else "treadline sweep --resume finishes it"
        raise SettingsError(f"{folder}: a sweep's folder; {there}")
    if (folder / "manifest.json").exists():
        raise SettingsError(f"{folder}: no result.json: this run was interrupted, or goes on; make it again to report it")
    raise SettingsError(f"{folder}: no results.json and no result.json; give a folder that reproduce, climb or excite finished")
