"""Side view of a run of a campaign at its least tip-over margin: ``Recording -> pose -> SVG``.

A campaign keeps no logs. Each run's row keeps one pose under ``VIEW``, from which the page draws the worst runs.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from treadline.campaign.sampled_run import VIEW, Row
from treadline.playback import Recording
from treadline.report.side_view import SideViews
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario

DIGITS = 5
"""Decimals of a kept pose: 0.01 mm, and 1e-5 of a unit quaternion."""


def view_of(recording: Recording) -> dict[str, Any] | None:
    """Return the pose at the least tip-over margin, or None without poses."""
    if not recording.has_poses or not np.isfinite(recording.margin_rad).any():
        return None
    k = int(np.nanargmin(recording.margin_rad))
    joints = {"seat_rad": recording.seat_rad[k], "flipper_rad": recording.flipper_rad[k]}
    lists = {"p_WB": recording.p_WB[k], "quat_WB": recording.quat_WB[k], "belt_travel_m": recording.belt_travel_m[k]}
    return {
        "t_s": float(recording.t_s[k]),
        **{name: round(float(value), DIGITS) for name, value in joints.items()},
        **{name: value.round(DIGITS).tolist() for name, value in lists.items()},
    }


def thumbnail(row: Row, scenario: Scenario) -> str | None:
    """Return the side view of a run from its row, as SVG; None if the row holds no pose."""
    kept: Mapping[str, Any] | None = row.get(VIEW)
    if kept is None:
        return None
    known = {name: np.array([value]) for name, value in kept.items() if name != "t_s"}
    recording = Recording.of_curves(
        np.array([kept["t_s"]]), read_chair(scenario.chair.model), scenario=scenario, seed=row["seed"], **known
    )
    views = SideViews(recording, f"run{row['index']:04d}")
    words = f"Run {row['index']:04d}, {row['verdict']}: side view at its least tip-over margin, {kept['t_s']:.1f} s"
    return views.definitions + views.view(kept["t_s"], words)
