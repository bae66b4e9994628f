"""The whole way of a user: excite, identify, tune, climb, report; small, but nothing left out."""

from pathlib import Path

from treadline.scenario.shipped_files import CHAIRS

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


def test_from_random_speeds_to_a_report(run, tmp_path: Path) -> None:
    """A vehicle of one's own is named in the scenario alone: record, model and controller know it."""
    folder = tmp_path
    (folder / "own.toml").write_text((CHAIRS / "wheelchair.toml").read_text().replace('name = "wheelchair"', 'name = "ours"'))
    (folder / "climb.toml").write_text(SHORT.format(slope=25, heading=12, duration=8) + '[chair]\nmodel = "own.toml"\n')
    gentler = ("--set", "stair.slope_deg=20", "--set", "start.heading_deg=0", "--set", "drive.duration_s=60")
    excited = run("excite", folder / "climb.toml", *gentler, "--samples", 240, "--out", folder / "excited", "--seed", 5, "--json")
    assert (excited.code, excited.values["samples"]) == (0, 240), excited.err

    found = run("identify", folder / "excited", "--validate-on", folder / "excited", "--out", folder / "model.json", "--json")
    assert found.code == 0, found.err
    # At 20°, where the belts turn the chair: heading and its rate; a minute of data may or may not show the drives' lag.
    assert found.values["order"] in (2, 3)

    tuned = run("tune", folder / "model.json", "--out", folder / "controller.json", "--json")
    assert tuned.code == 0, tuned.err
    assert tuned.values["spectral_radius"] < 0.98

    climbed = run("climb", folder / "climb.toml", "--controller", folder / "controller.json", "--out", folder / "run", "--json")
    assert climbed.code == 0, climbed.err
    assert climbed.values["verdict"] == "time_up"
    assert climbed.values["settle_s"] < 5.0
    assert climbed.values["roll_back_m"] < 0.02

    page = run("report", folder / "run", "--json")
    assert page.code == 0, page.err
    assert "to the end of its time" in Path(page.values["path"]).read_text()


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(run, tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(SHORT.format(slope=20, heading=0, duration=60))
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert run("excite", scenario, "--samples", 57, "--period", 0.05, "--seed", seed, "--out", tmp_path / name).code == 0
    for file in ("record.csv", "series.csv", "log.mcap"):
        same = (tmp_path / "a" / file).read_bytes()
        assert same == (tmp_path / "b" / file).read_bytes()
        assert same != (tmp_path / "c" / file).read_bytes()


def test_a_scenario_that_check_refuses_leaves_no_run_unless_check_is_off(run, tmp_path: Path) -> None:
    scenario = tmp_path / "steep.toml"
    scenario.write_text(SHORT.format(slope=44, heading=0, duration=0.1))
    refused = run("climb", scenario, "--out", tmp_path / "run", "--json")
    assert (refused.code, refused.values["verdict"]) == (1, "refused")
    assert refused.values["cause"] == "; ".join(refused.values["reasons"])
    assert not (tmp_path / "run").exists()
    outcome = run("climb", scenario, "--set", "drive.check=false", "--out", tmp_path / "run", "--json")
    assert "reasons" not in outcome.values
    assert (tmp_path / "run").exists()
