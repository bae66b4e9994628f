"""Recording of a run folder for its page: from its log, or without one from ``series.csv`` at 10 Hz, which has no poses."""

from pathlib import Path

import numpy as np

from treadline.core.angles import DEG
from treadline.core.errors import TreadlineError
from treadline.core.signals import Event
from treadline.io.runs import LOG
from treadline.playback import PhaseSpan, Recording, read_recording
from treadline.report.results import RunResult
from treadline.report.svg_figures import Series
from treadline.scenario.chair import read_chair

READ_BYTES = 512 * 1024**2
"""Largest log that is read for a page [bytes]; a log with images is decompressed as a whole."""
DEFAULT_CHAIR = "wheelchair"


def recording_of(folder: Path, series: Series, result: RunResult) -> Recording:
    """Return the recording of a run folder; ``missing`` gives the reason where its log does not serve."""
    path = folder / LOG
    if not path.is_file():
        return of_series(series, result, "No log was kept: the scene is not drawn, and curves have 10 samples a second.")
    if path.stat().st_size > READ_BYTES:
        return of_series(series, result, f"{LOG} is longer than {READ_BYTES // 1024**2} MB: the scene is not drawn.")
    try:
        return read_recording(folder)
    except TreadlineError as error:
        said = str(error).removeprefix(f"{path}: ").replace(str(folder), folder.name)
        return of_series(series, result, f"The scene is not drawn: {said}.")


def of_series(series: Series, result: RunResult, missing: str) -> Recording:
    """Return the curves of ``series.csv`` with the run's phases and events."""
    t_s = series["t_s"]
    events = [Event(t_s=event.t_s, name=event.name, cause=event.cause) for event in result.events]
    causes = {(event.name, event.t_s): event.cause for event in events}
    course = result.course
    ends = [*(start for start, _ in course[1:]), float(t_s[-1]) if len(t_s) else 0.0]
    return Recording.of_curves(
        t_s,
        read_chair(DEFAULT_CHAIR),
        belt_m_s=np.column_stack([series["left_m_s"], series["right_m_s"]]),
        heading_rad=series["heading_deg"] * DEG,
        estimate_rad=series["estimate_deg"] * DEG,
        pitch_rad=series["pitch_deg"] * DEG,
        seat_pitch_rad=series["seat_pitch_deg"] * DEG,
        margin_rad=series["stability_margin_deg"] * DEG,
        friction_use=series["friction_use"],
        place_S=np.column_stack([series["x_m"], series["y_m"]]),
        events=tuple(events),
        phases=tuple(
            PhaseSpan(start_s=start, end_s=end, name=name, cause=causes.get((name, start), ""))
            for (start, name), end in zip(course, ends, strict=False)
        ),
        verdict=result.verdict,
        cause=result.cause,
        missing=(missing,),
    )
