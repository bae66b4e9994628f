"""A controller of one's own on the command line: climbed with, named in the manifest, and replayed."""

import json
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
PID = f"{EXAMPLES / 'own_controller_pid.py'}:HeadingPid"


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "short.toml"
    path.write_text('[start]\nheading_deg = 4.0\n[drive]\nduration_s = 2.0\n[sensors]\ncamera = "statistical"\n')
    return path


def test_a_run_names_its_plug_in_and_its_replay_asks_for_it(run, scenario: Path, tmp_path: Path) -> None:
    first, again = tmp_path / "first", tmp_path / "again"
    assert run("climb", scenario, "--controller", PID, "--out", first).code == 0
    assert json.loads((first / "manifest.json").read_text())["plugins"] == {"controller": PID}
    assert not (first / "run-controller.json").exists()
    refused = run("replay", first, "--out", again)
    assert refused.code == 2
    assert f"give --controller {PID}, or --controller shipped" in refused.err
    assert not again.exists()
    played = run("replay", first, "--controller", PID, "--out", again, "--json")
    assert played.code == 0
    assert played.values["largest_command_gap_m_s"] == pytest.approx(0.0, abs=1e-9)  # the same readings, the same controller
    shipped = run("replay", first, "--controller", "shipped", "--out", tmp_path / "shipped", "--json")
    assert shipped.code == 0
    assert (tmp_path / "shipped" / "run-controller.json").is_file()
