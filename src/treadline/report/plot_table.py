"""Plots, colours and meanings that the player page and the live view share: ``data/plots.toml, data/palette.toml``."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.files import DATA
from treadline.playback import Limits, Recording
from treadline.report.labels import suffix

_PALETTE = tomllib.loads((DATA / "palette.toml").read_text(encoding="utf-8"))
SIGNS: Mapping[str, Mapping[str, Any]] = _PALETTE["signs"]
"""Signs of scene, plots and texts: ``colour``, its version for ``dark`` paper, and what it ``means``."""

Column = Float[np.ndarray, " n"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """One line of a plot."""

    label: str
    colour: str
    """Sign whose colour the line has."""
    series: str
    """Field of the recording, or a name among further series."""
    column: int | None = None
    """Column of a field with several."""
    sigma: str = ""
    """Field of the standard deviation that is drawn as a band; empty without one."""
    dash: tuple[int, ...] = ()

    def values(self, run: Recording, **more: Column) -> Column:
        """Return the values of a run, angles in degrees.

        Args:
            more: Further series by name.
        """
        values = more[self.series] if self.series in more else getattr(run, self.series)
        chosen = np.asarray(values if self.column is None else values[:, self.column])
        return chosen / _unit(self.series)


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """Limit of a plot."""

    name: str
    """Field of ``Limits``."""
    text: str
    """Meaning with the curve that it limits, and a place for its value."""
    both: bool = False
    zero: bool = False
    always: bool = False
    phases: tuple[str, ...] = ()

    def values(self, of: Limits) -> tuple[float, ...]:
        """Return the lines of a run, angles in degrees; the limit itself is first, and there is none if it is unknown."""
        value = getattr(of, self.name)
        size = () if value is None else (value / _unit(self.name),)
        return (*size, *(-limit for limit in size if self.both), *((0.0,) if self.zero else ()))

    def spans(self, run: Recording) -> list[tuple[float, float]]:
        """Return the spans in which the limit applies [s]."""
        if not self.phases:
            return [(-np.inf, np.inf)]
        return [(span.start_s, span.end_s) for span in run.phases if span.name in self.phases]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plot:
    """One plot: lines, limit and scale."""

    title: str
    unit: str
    curves: tuple[Curve, ...]
    limit: Limit | None = None
    digits: int = 2
    least_span: float = 0.0
    low: float = -np.inf
    high: float = np.inf
    page_only: bool = False
    no_fork: bool = False

    @property
    def heading(self) -> str:
        """Title with the unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    def known(self, run: Recording, **more: Column) -> "Plot":
        """Return the plot with the known curves of a complete run alone; without ground truth those are "measured".

        Args:
            more: Further series by name.
        """
        curves = tuple(curve for curve in self.curves if np.isfinite(curve.values(run, **more)).any())
        if run.is_reckoned:
            curves = tuple(replace(curve, label=curve.label.replace("true", "measured")) for curve in curves)
        return replace(self, curves=curves)

    def limits(self, of: Limits) -> tuple[float, ...]:
        """Return the lines of the limit of a run; none for an unknown limit."""
        return () if self.limit is None else self.limit.values(of)

    def limit_text(self, of: Limits) -> str:
        """Return the meaning of the limit with its value; empty for an unknown limit."""
        values = self.limits(of)
        if self.limit is None or not values:
            return ""
        return self.limit.text.format(f"{'±' if self.limit.both else ''}{values[0]:g}{suffix(self.unit)}")


def phase_colour(name: str) -> str:
    """Return the colour of a phase in the timeline."""
    return str(_PALETTE["phases"].get(name, "#888888"))


def _unit(name: str) -> float:
    """Return the unit in which a field is shown: the degree for angles."""
    return DEG if name.endswith(("_rad", "_rad_s")) else 1.0


def _plot(entry: Mapping[str, Any]) -> Plot:
    curves = tuple(Curve(**{**curve, "dash": tuple(curve.get("dash", ()))}) for curve in entry["curves"])
    limit = entry.get("limit")
    made = None if limit is None else Limit(**{**limit, "phases": tuple(limit.get("phases", ()))})
    return Plot(**{**entry, "curves": curves, "limit": made})


PLOTS = tuple(_plot(entry) for entry in tomllib.loads((DATA / "plots.toml").read_text(encoding="utf-8"))["plot"])
"""Plots from above."""
