"""The whole way of a user: excite, identify, tune, climb, report; small, but nothing left out."""

import json
from pathlib import Path

import pytest

SHORT = """
[stair]
slope_deg = {slope}
run_m = 0.30
steps = 30
width_m = 2.4
[start]
place = "flight"
step = 6
heading_deg = {heading}
[drive]
duration_s = {duration}
[sensors]
camera = "statistical"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("way")
    (path / "excite.toml").write_text(SHORT.format(slope=20, heading=0, duration=60))
    (path / "climb.toml").write_text(SHORT.format(slope=25, heading=12, duration=8))
    return path


def test_from_random_speeds_to_a_report(run, folder: Path) -> None:
    excited = run("excite", folder / "excite.toml", "--samples", 240, "--out", folder / "excited", "--seed", 5, "--json")
    assert excited.code == 0, excited.err
    assert excited.values["samples"] == 240
    header = (folder / "excited" / "record.csv").read_text().splitlines()[0]
    assert header == "t_s,left_m_s,right_m_s,heading_rad,yaw_rate_rad_s"

    found = run("identify", folder / "excited", "--validate-on", folder / "excited", "--out", folder / "model.json", "--json")
    assert found.code == 0, found.err
    assert found.values["order"] in (
        2,
        3,
    )  # at 20°, where the belts turn the chair: heading and its rate; a minute of data may or may not show the drives' lag
    assert {"lags", "method", "singular_values", "poles", "fit_percent", "one_step_vaf_percent", "whiteness_p"} <= set(found.values)

    tuned = run("tune", folder / "model.json", "--out", folder / "controller.json", "--json")
    assert tuned.code == 0, tuned.err
    assert tuned.values["spectral_radius"] < 0.98

    climbed = run("climb", folder / "climb.toml", "--controller", folder / "controller.json", "--out", folder / "run", "--json")
    assert climbed.code == 0, climbed.err
    assert climbed.values["verdict"] == "time_up"
    assert climbed.values["settle_s"] < 5.0
    assert climbed.values["roll_back_m"] < 0.02

    manifest = json.loads((folder / "run" / "manifest.json").read_text())
    assert manifest["settings"]["start"]["heading_deg"] == 12
    page = run("report", folder / "run", "--json")
    assert page.code == 0, page.err
    assert "to the end of its time" in Path(page.values["path"]).read_text()


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(run, tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(SHORT.format(slope=20, heading=0, duration=60))
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert run("excite", scenario, "--samples", 57, "--period", 0.1, "--seed", seed, "--out", tmp_path / name).code == 0
    for file in ("record.csv", "series.csv", "log.mcap"):
        same = (tmp_path / "a" / file).read_bytes()
        assert same == (tmp_path / "b" / file).read_bytes()
        assert same != (tmp_path / "c" / file).read_bytes()


WHOLE = """
[stair]
slope_deg = {slope}
width_m = 1.4
landing_m = 3.0
friction = [1.0, 0.8]
[chair]
payload_kg = 80
payload_offset_m = [{back}, 0.0, 0.10]
[start]
place = "floor"
[drive]
check = {check}
duration_s = 0.5
[sensors]
camera = "statistical"
"""


def test_a_seat_that_must_be_shifted_is_shifted_as_in_a_campaign(run, tmp_path: Path) -> None:
    """Test: a passenger who sits 5 cm back. Expected result: run with the seat shifted, which the run's manifest says."""
    scenario = tmp_path / "back.toml"
    scenario.write_text(WHOLE.format(slope=30, back=-0.05, check="true"))
    outcome = run("climb", scenario, "--out", tmp_path / "run", "--json")
    assert outcome.values["verdict"] == "time_up", outcome.err
    assert outcome.values["events"][0]["name"] == "seat_shifted"
    settings = json.loads((tmp_path / "run" / "manifest.json").read_text())["settings"]
    assert 0.0 < settings["chair"]["seat_shift_m"] <= 0.10


def test_a_scenario_that_check_refuses_runs_only_with_check_off(run, tmp_path: Path) -> None:
    steep = tmp_path / "steep.toml"
    steep.write_text(WHOLE.format(slope=35, back=0.0, check="true"))
    refused = run("climb", steep, "--out", tmp_path / "run", "--json")
    assert (refused.code, refused.values["verdict"]) == (1, "refused")
    assert refused.values["cause"] == "; ".join(refused.values["reasons"])
    assert not (tmp_path / "run").exists()
    steep.write_text(WHOLE.format(slope=35, back=0.0, check="false"))
    outcome = run("climb", steep, "--out", tmp_path / "run", "--json")
    assert outcome.values["verdict"] in ("time_up", "refused")
    assert outcome.values["duration_s"] > 0.0
    assert "reasons" not in outcome.values
