"""The failure frontier lies where runs begin to fail, and a thumbnail shows the pose that its row holds."""

import json

import numpy as np

from treadline.campaign._campaign_page import thumbnail, view_of
from treadline.campaign._pool import VIEW, Row
from treadline.campaign._results import flat, frontier_of
from treadline.scenario.scenario import Scenario

from ..report.conftest import climbing  # noqa: TID252 - pytest names the folders; outside of it they are no package


def runs(count: int, *, seed: int) -> list[Row]:
    """Return runs over slope, friction and an idle quantity; half of them fail at 34° and friction 0.5."""
    rng = np.random.default_rng(seed)
    found: list[Row] = []
    for index in range(count):
        slope, friction, payload = rng.uniform(25, 40), rng.uniform(0.3, 0.9), rng.uniform(0, 100)
        chance = 1.0 / (1.0 + np.exp(-((slope - 34.0) / 0.8 - (friction - 0.5) / 0.05)))
        verdict = "fell" if rng.random() < chance else "arrived"
        found.append({"index": index, "verdict": verdict, "slope_deg": slope, "friction": friction, "payload_kg": payload})
    return found


def test_the_frontier_is_where_half_of_the_runs_fail() -> None:
    """Test: 800 runs of a known failure law in two of three quantities. Expected: those two, and the line of one half."""
    frontier = frontier_of(runs(800, seed=1), ["payload_kg", "slope_deg", "friction"])
    assert set(frontier.keys) == {"slope_deg", "friction"}
    ends = np.concatenate(frontier.contours[0.5])
    slope, friction = (ends[:, frontier.keys.index(key)] for key in ("slope_deg", "friction"))
    # On the line (slope - 34) / 0.8 = (friction - 0.5) / 0.05. 800 runs place it within a degree (three standard errors).
    np.testing.assert_allclose(slope, 34.0 + 16.0 * (friction - 0.5), atol=1.0)


def test_a_quantity_that_follows_from_another_is_no_second_axis() -> None:
    """Test: the rise of a stair with a run of 0.28 m follows from its slope. Expected: slope or rise, and friction."""
    rows = [row | {"rise_m": 0.28 * np.tan(np.radians(float(row["slope_deg"]))).item()} for row in runs(400, seed=3)]
    frontier = frontier_of(rows, ["slope_deg", "rise_m", "friction"])
    assert "friction" in frontier.keys
    assert frontier_of(rows, ["slope_deg", "rise_m"]) is None


def test_fewer_runs_than_coefficients_allow_draw_no_frontier() -> None:
    rows = runs(60, seed=2)
    whole = [row | {"verdict": "arrived"} for row in rows]
    assert frontier_of(whole, ["slope_deg", "friction"]) is None
    assert frontier_of(rows, ["slope_deg"]) is None


def test_a_thumbnail_is_drawn_from_the_row_alone() -> None:
    """Test: a recording whose least margin is at π/2 s. Expected: its pose there survives the journal, and is drawn."""
    recording, scenario = climbing(seconds=2.0), Scenario()
    row: Row = json.loads(json.dumps({"index": 7, "seed": 1, "verdict": "fell"} | view_of(recording)))
    place = recording.p_WB[157]
    np.testing.assert_allclose(row[VIEW]["p_WB"], place, atol=1e-5)
    assert VIEW not in flat(row)
    assert f"{place[0]:.4f} {place[2]:.4f}" in str(thumbnail(row, scenario))
    assert thumbnail({"index": 7, "seed": 1, "verdict": "fell"}, scenario) is None
