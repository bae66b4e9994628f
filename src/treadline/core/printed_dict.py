"""A dictionary that prints as a short table, however long its arrays are."""

from collections.abc import Mapping
from typing import Any

from treadline.core.printing import Printable


class PrintedDict(Printable, dict[str, Any]):
    """Text or arrays by name, printed as a table: of an array, its length and range."""

    __slots__ = ("title",)

    def __init__(self, title: str, entries: Mapping[str, Any]) -> None:
        super().__init__(entries)
        self.title = title

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return the title and each entry."""
        return self.title, [(name, item if isinstance(item, str) else _range(item)) for name, item in self.items()]


def _range(samples: Any) -> str:
    known = samples[samples == samples]  # noqa: PLR0124 - NaN differs from itself
    return f"{len(samples)} samples" + (f" from {known.min():.4g} to {known.max():.4g}" if len(known) else "")
