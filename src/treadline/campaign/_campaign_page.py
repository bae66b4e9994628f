"""Report page of a campaign: one self-contained HTML file, with side views of the worst runs at their least tip-over margin.

A campaign keeps no logs. Each run's row keeps one pose under ``VIEW``, from which the page draws the worst runs.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from treadline.campaign._draws import is_number
from treadline.campaign._pool import BLOCK, VIEW, Row
from treadline.campaign._results import ARRIVED, Frontier, flat, frontier_of, has_rms
from treadline.core.files import write_whole
from treadline.playback import Recording
from treadline.report.labels import score_name, score_unit, suffix
from treadline.report.side_view import SideViews
from treadline.scenario.scenario import Scenario

FRAME = {"x": 64.0, "y": 12.0, "width": 560.0, "height": 276.0}
"""Frame of a chart in a drawing of 640 by 320 px, with room for ticks; the axis titles are text of the page."""


def write_page(
    folder: Path,
    summary: Mapping[str, Any],
    times: Mapping[str, Any],
    rows: Iterable[Row],
    drawn: Sequence[str],
    views: Mapping[int, str] | None = None,
) -> Path:
    """Write ``report.html`` of a campaign. Its charts show the first ``BLOCK`` runs, which are a sample of the same distribution.

    Args:
        drawn: Columns that are not scores.
        views: Side views of the worst runs as SVG, by run index.
    """
    from markupsafe import Markup

    from treadline.report.html_pages import page_of

    shown = [flat(row) for row in islice(rows, BLOCK)]
    found = frontier_of(shown, drawn)
    page = page_of(
        "sweep.html.j2",
        {},
        summary=summary,
        times=times,
        shown=len(shown),
        chart=_chart(shown, drawn, summary["score"]),
        frontier=None if found is None else _frontier(shown, found),
        views={index: Markup(view) for index, view in (views or {}).items()},  # noqa: S704 - drawn by this package
        score_name=score_name,
        unit_of=_unit,
        titled=_titled,
        has_rms=has_rms,
        suffix=suffix,
    )
    write_whole(folder / "report.html", page)
    return folder / "report.html"


def view_of(recording: Recording) -> dict[str, Any]:
    """Return the entry of a run's row that holds its pose at the least tip-over margin; None without poses."""
    if not recording.has_poses or not np.isfinite(recording.margin_rad).any():
        return {VIEW: None}
    k = int(np.nanargmin(recording.margin_rad))
    joints = {"seat_rad": recording.seat_rad[k], "flipper_rad": recording.flipper_rad[k]}
    lists = {"p_WB": recording.p_WB[k], "quat_WB": recording.quat_WB[k], "belt_travel_m": recording.belt_travel_m[k]}
    # 0.01 mm, and 1e-5 of a unit quaternion.
    pose = {name: round(float(value), 5) for name, value in joints.items()}
    pose_lists = {name: value.round(5).tolist() for name, value in lists.items()}
    return {VIEW: {"t_s": float(recording.t_s[k]), **pose, **pose_lists}}


def thumbnail(row: Row, scenario: Scenario) -> str | None:
    """Return the side view of a run from its row, as SVG; None if the row holds no pose."""
    kept: Mapping[str, Any] | None = row.get(VIEW)
    if kept is None:
        return None
    known = {name: np.array([value]) for name, value in kept.items() if name != "t_s"}
    recording = Recording.of_curves(np.array([kept["t_s"]]), scenario.read_chair(), scenario=scenario, seed=row["seed"], **known)
    views = SideViews(recording, f"run{row['index']:04d}")
    words = f"Run {row['index']:04d}, {row['verdict']}: side view at its least tip-over margin, {kept['t_s']:.1f} s"
    return views.definitions + views.view(kept["t_s"], words)


def _chart(rows: Sequence[Row], drawn: Sequence[str], score: str) -> dict[str, Any] | None:
    """Return the scatter chart of the score over a drawn key, the slope if it varies; None if no drawn number varies."""
    scored = [row for row in rows if is_number(row.get(score))]
    keys = ("stair.slope_deg", *drawn)  # the slope has the strongest effect on the verdict
    key = next((key for key in keys if len({row[key] for row in scored if is_number(row.get(key))}) > 1), None)
    if key is None:
        return None
    shown = [row for row in scored if is_number(row.get(key))]
    titles = (_titled(key, key), _titled(score_name(score), score))
    return _scatter(shown, (key, score), titles, lambda verdict: 6.0 if verdict == "fell" else 3.0)


def _frontier(rows: Sequence[Row], found: Frontier) -> dict[str, Any]:
    """Return the chart of all runs over the two quantities that separate failures best, with the contours of their share."""
    across, up = (_titled(key, key) for key in found.keys)
    chart = _scatter(rows, found.keys, (across, up), lambda verdict: 3.0 if verdict in ARRIVED else 5.0)
    lines = {level: "".join(_path(line, chart["axes"]) for line in contour) for level, contour in found.contours.items()}
    return chart | {"lines": {level: line for level, line in lines.items() if line}}


def _scatter(
    rows: Sequence[Row], keys: tuple[str, str], titles: tuple[str, str], radius_px: Callable[[str], float]
) -> dict[str, Any]:
    """Return a chart of runs for the template, larger dots last."""
    across = _Axis.of([float(row[keys[0]]) for row in rows], FRAME["x"], FRAME["width"])
    up = _Axis.of([float(row[keys[1]]) for row in rows], FRAME["y"] + FRAME["height"], -FRAME["height"])
    dots = sorted(((radius_px(row["verdict"]), row) for row in rows), key=lambda dot: dot[0])
    return {"dots": dots, "frame": FRAME, "keys": keys, "axes": (across, up), "titles": titles}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Axis:
    """Axis range with a margin, its place in the drawing, and round tick values."""

    low: float
    high: float
    start_px: float
    length_px: float

    @classmethod
    def of(cls, values: Sequence[float], start_px: float, length_px: float) -> "_Axis":
        least, most = min(values), max(values)
        room = 0.05 * (most - least) or max(0.05 * abs(most), 0.5)
        return cls(low=least - room, high=most + room, start_px=start_px, length_px=length_px)

    @property
    def ticks(self) -> list[float]:
        """At most seven multiples of 1, 2 or 5 times a power of ten."""
        rough = (self.high - self.low) / 7
        decade = 10.0 ** math.floor(math.log10(rough))
        step = next(decade * times for times in (1, 2, 5, 10) if decade * times >= rough)
        return [round(k * step, 12) for k in range(math.ceil(self.low / step), math.floor(self.high / step) + 1)]

    def place(self, value: float) -> float:
        return self.start_px + self.length_px * (value - self.low) / (self.high - self.low)


def _path(line: np.ndarray, axes: tuple[_Axis, _Axis]) -> str:
    return "M" + "L".join(f"{axes[0].place(x):.1f} {axes[1].place(y):.1f}" for x, y in line.tolist())


def _unit(key: str) -> str:
    """Return the unit from the suffix of a key; list items have the unit of the list."""
    return score_unit(key) or score_unit(key.rstrip(".0123456789"))


def _titled(name: str, key: str) -> str:
    return f"{name} [{unit}]" if (unit := _unit(key)) else name
