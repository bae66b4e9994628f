"""Headline figures of a reproduction: at most ten rows for the README and for ``docs/evidence/results.json``.

``benchmarks/publish.py`` writes both from one ``results.json``; a test fails when the README and the file differ.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from treadline.report.comparison import written
from treadline.report.results import PAPER_FRICTION, Cell, Results

BEGIN, END = "<!-- results: written by benchmarks/publish.py -->", "<!-- end of results -->"
SMOOTH_BELT = "none"


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadlineRow:
    """One row: figure, the paper's value, our value and its conditions."""

    figure: str
    paper: str
    ours: str
    conditions: str


def headline_rows(results: Results) -> list[HeadlineRow]:
    """Return the rows of the parts that were measured."""
    cells = [cell for cell in results.table2 if cell.friction == PAPER_FRICTION]
    return [*_table_two(cells), *_turns(cells), *_straight(results), *_model(results), *_seat(results), *_lugs(results)]


def published(results: Results) -> dict[str, Any]:
    """Return the content of ``docs/evidence/results.json``."""
    return {
        "command": results.command,
        "git_commit": results.git_commit,
        "versions": results.versions,
        "figures": [asdict(row) for row in headline_rows(results)],
    }


def readme_table(values: Mapping[str, Any]) -> str:
    """Return the README's table of a published file, markers included."""
    lines = [f"| {row['figure']} | {row['paper']} | {row['ours']} | {row['conditions']} |" for row in values["figures"]]
    return "\n".join([BEGIN, "| figure | paper | here | conditions |", "| --- | --- | --- | --- |", *lines, END])


def with_table(readme: str, values: Mapping[str, Any]) -> str:
    """Return the README with its table replaced.

    Raises:
        ValueError: If it does not have both markers once, in order.
    """
    if readme.count(BEGIN) != 1 or readme.count(END) != 1 or readme.index(BEGIN) > readme.index(END):
        raise ValueError(f"README.md: wanted the markers '{BEGIN}' and '{END}' once each, in this order")
    return readme[: readme.index(BEGIN)] + readme_table(values) + readme[readme.index(END) + len(END) :]


def _table_two(cells: Sequence[Cell]) -> list[HeadlineRow]:
    rows = []
    for slope in sorted({cell.slope_deg for cell in cells}):
        here = sorted((cell for cell in cells if cell.slope_deg == slope), key=lambda cell: -cell.start_heading_deg)
        rows.append(
            HeadlineRow(
                figure=f"Table II: RMS heading at {slope:g}°, from {_all(here, lambda cell: f'{cell.start_heading_deg:+g}°')}",
                paper=_all(here, lambda cell: "–" if cell.paper_deg is None else f"{cell.paper_deg:g}°"),
                ours=_all(here, lambda cell: f"{cell.rms_heading_deg:.2f}°"),
                conditions=here[0].conditions,
            )
        )
    return rows


def _turns(cells: Sequence[Cell]) -> list[HeadlineRow]:
    if not cells:
        return []
    slopes = sorted({cell.slope_deg for cell in cells})
    by_slope = [[cell for cell in cells if cell.slope_deg == slope] for slope in slopes]
    at = " / ".join(f"{slope:g}°" for slope in slopes)
    settled = [[cell.settle_s for cell in here] for here in by_slope]
    jolts = [cell.passenger_m_s2 for cell in cells if cell.passenger_m_s2 is not None]
    rows = [
        HeadlineRow(
            figure=f"roll-back in these turns at {at}",
            paper="–",
            ours=" / ".join(f"{max(cell.roll_back_m for cell in here):.3f}" for here in by_slope) + " m",
            conditions="worst run",
        ),
        HeadlineRow(
            figure=f"settling to ±2° at {at}",
            paper="10–20 s (Fig. 10, 28°)",
            ours=" / ".join("never" if None in times else f"{max(t for t in times if t is not None):.1f}" for times in settled)
            + " s",
            conditions="worst run",
        ),
    ]
    if jolts:
        rows.append(
            HeadlineRow(
                figure="passenger's acceleration in these turns",
                paper="–",
                ours=written(max(jolts), "m/s²"),
                conditions="largest mean over 50 ms, worst run, smooth belts",
            )
        )
    return rows


def _straight(results: Results) -> list[HeadlineRow]:
    closed = [run for run in results.fig09 if run.loop == "closed"]
    opened = [run for run in results.fig09 if run.loop == "open"]
    if not closed or not opened:
        return []
    return [
        HeadlineRow(
            figure="Fig. 9: straight up, RMS heading, lateral drift",
            paper="near zero",
            ours=f"{max(run.rms_heading_deg for run in closed):.2f}°, {written(max(run.lateral_m for run in closed), 'm')}"
            f" (open loop: {max(run.rms_heading_deg for run in opened):.1f}°, {max(run.lateral_m for run in opened):.1f} m)",
            conditions=f"{closed[0].duration_s:.0f} s, right belt 2 % faster, worst slope",
        )
    ]


def _model(results: Results) -> list[HeadlineRow]:
    if results.fig08 is None:
        return []
    model = results.fig08
    return [
        HeadlineRow(
            figure=f"Fig. 8: yaw rate explained one step ahead at {model.slope_deg:g}°",
            paper="–",
            ours=f"{model.yaw_rate_vaf_percent:.0f} %",
            conditions=model.conditions,
        )
    ]


def _seat(results: Results) -> list[HeadlineRow]:
    seat = results.fig11
    if seat is None:
        return []
    settling = "does not settle" if seat.settle_s is None else f"settles in {seat.settle_s:.1f} s"
    return [
        HeadlineRow(
            figure="Fig. 11: steady seat error",
            paper="about 0°",
            ours=f"{abs(seat.steady_error_deg):.3f}°, {settling}",
            conditions=seat.conditions,
        )
    ]


def _lugs(results: Results) -> list[HeadlineRow]:
    whole = [run for run in results.lugs if not run.is_turn]
    smooth, lugged = ([run for run in whole if (run.lug == SMOOTH_BELT) is flat] for flat in (True, False))
    if not smooth or not lugged:
        return []
    return [
        HeadlineRow(
            figure=f"whole traversal {smooth[0].course}, passenger's acceleration: smooth belts / lugs {lugged[0].lug} mm",
            paper="–",
            ours=f"{smooth[0].passenger_m_s2:.2g} / {lugged[0].passenger_m_s2:.2g} m/s²",
            conditions=f"{smooth[0].verdict} / {lugged[0].verdict}; seed {smooth[0].seed}, statistical camera",
        )
    ]


def _all(cells: Sequence[Cell], text: Callable[[Cell], str]) -> str:
    return " / ".join(text(cell) for cell in cells)
