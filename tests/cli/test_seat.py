"""``treadline seat``: Fig. 11 on any scenario's stair and chair."""

from pathlib import Path

import pytest

from treadline.scenario.shipped_files import CHAIRS

SLOPE = """\
[stair]
slope_deg = {slope}
[chair]
model = "{model}"
payload_kg = {payload}
"""


@pytest.mark.parametrize(("model", "payload"), [("wheelchair", 50), ("rescue", 3)])
def test_the_seat_levels_itself_within_seconds(run, tmp_path: Path, model: str, payload: float) -> None:
    scenario, out = tmp_path / "stair.toml", tmp_path / "run"
    scenario.write_text(SLOPE.format(slope=25, model=model, payload=payload))
    outcome = run("seat", scenario, "--out", out, "--json")
    assert outcome.code == 0, outcome.err
    values = outcome.values
    assert values["start_deg"] == pytest.approx(25.0, abs=1.0)
    # At 16°/s and a gain of 2 per second: 25° to 1° takes 1.1 s at full rate and 1.0 s of decay; the paper's needs 12 s.
    assert 1.0 < values["settle_s"] < 4.0
    assert abs(values["steady_error_deg"]) < 0.2
    assert values["max_error_deg"] <= 1.0
    assert {path.name for path in out.iterdir()} >= {"manifest.json", "result.json", "series.csv", "log.mcap"}


def test_a_seat_whose_stroke_ends_before_level_is_answered_with_1(run, tmp_path: Path) -> None:
    chair, scenario = tmp_path / "short.toml", tmp_path / "stair.toml"
    text = (CHAIRS / "wheelchair.toml").read_text()
    assert text.count("0.150]") == 1
    chair.write_text(text.replace("0.150]", "0.060]"))
    scenario.write_text(SLOPE.format(slope=28, model=chair, payload=50))
    outcome = run("seat", scenario, "--out", tmp_path / "run", "--json")
    assert outcome.code == 1
    assert outcome.values["settle_s"] is None
    assert outcome.values["steady_error_deg"] > 1.0
