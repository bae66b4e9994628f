"""Output paths: one rule for ``--out`` in every verb, existing results are kept unless ``--force`` is given."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from treadline.core.errors import SettingsError

Force = Annotated[bool, Parameter(help="Overwrite an existing result; without it an existing, non-empty --out is refused.")]
"""The option ``--force`` of a verb."""


def make_way(out: Path, *, force: bool) -> None:
    """Remove a file that ``--force`` replaces, for bag formats whose writers only create new files."""
    if force and out.is_file():
        out.unlink()


def claim(out: Path, *, force: bool, kind: Literal["file", "folder", "either"] = "folder", resume: bool = False) -> None:
    """Check that a result may be written to a path; nothing is written or removed.

    Args:
        out: Value of ``--out``.
        force: Whether the user allows an existing result to be overwritten.
        kind: What the verb writes there.
        resume: Whether the verb continues the result that is there.

    Raises:
        SettingsError: If the path is of the other kind, or holds something and neither ``force`` nor ``resume`` is set.
    """
    if kind == "folder" and out.exists() and not out.is_dir():
        raise SettingsError(f"--out {out}: is a file; give a folder")
    if kind == "file" and out.is_dir():
        raise SettingsError(f"--out {out}: is a folder; give a file")
    if force or resume or not out.exists():
        return
    if out.is_dir() and any(out.iterdir()):
        raise SettingsError(f"--out {out}: the folder exists and is not empty; give another, or --force to overwrite its results")
    if out.is_file() and out.stat().st_size > 0:
        raise SettingsError(f"--out {out}: the file exists; give another, or --force to overwrite it")
