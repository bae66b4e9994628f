"""Chair files with single values changed."""

from pathlib import Path

from treadline.scenario.shipped_files import CHAIRS


def changed_chair(folder: Path, old: str, new: str) -> str:
    """Write the wheelchair's file with one piece of its text replaced, and return the path."""
    text = (CHAIRS / "wheelchair.toml").read_text(encoding="utf-8")
    assert text.count(old) == 1
    path = folder / "own.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    return str(path)
