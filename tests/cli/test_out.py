"""One rule for --out: what is there is kept, unless --force is given."""

from pathlib import Path

from treadline.scenario.shipped_files import CONTROLLERS


def test_force_writes_over_a_result_and_an_empty_folder_needs_no_force(run, tmp_path: Path) -> None:
    folder = tmp_path / "c"
    folder.mkdir()
    for options in ((), ("--force",)):
        assert run("export", CONTROLLERS / "wheelchair.json", "--to", "c", "--out", folder, *options).code == 0


def test_a_run_that_is_forced_leaves_nothing_of_the_earlier_one(run, tmp_path: Path) -> None:
    scenario, out = tmp_path / "short.toml", tmp_path / "run"
    scenario.write_text('[drive]\nduration_s = 0.2\n[sensors]\ncamera = "statistical"\n')
    assert run("climb", scenario, "--out", out).code == 0
    (out / "report.html").write_text("of the earlier run")
    assert run("climb", scenario, "--out", out).code == 2
    assert run("climb", scenario, "--out", out, "--force").code == 0
    assert not (out / "report.html").exists()
