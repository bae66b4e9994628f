"""What a verb answers: one JSON object with --json, and the contract's keys."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from treadline.cli import VERBS, doctor
from treadline.experiments.as_printed import paper_model


def test_check_says_go_for_the_papers_stair(run) -> None:
    outcome = run("check", "paper-28", "--json")
    assert outcome.code == 0
    assert outcome.values["verdict"] == "go"
    assert set(outcome.values["stability_margin_deg"]) == {"uphill", "downhill", "left", "right"}
    assert outcome.values["friction_needed"] == pytest.approx(0.5317, abs=1e-3)  # tan 28°


def test_check_refuses_by_the_friction_that_it_reports(run) -> None:
    outcome = run("check", "default", "--set", "stair.friction=[0.54, 0.5]", "--json")
    # tan β of the default stair is 0.16 / 0.30; 1.05 times that is what is asked.
    assert (outcome.code, outcome.values["friction_needed"]) == (1, pytest.approx(0.16 / 0.30))
    assert outcome.values["friction_needed_with_reserve"] == pytest.approx(1.05 * 0.16 / 0.30)


def test_tune_writes_a_controller_with_a_stable_loop(run, tmp_path: Path) -> None:
    model, controller = tmp_path / "model.json", tmp_path / "controller.json"
    paper_model(0.2).save(model)
    outcome = run("tune", model, "--state-weight", "1,1", "--input-weight", "0.05", "--out", controller, "--json")
    assert outcome.code == 0, outcome.err
    assert outcome.values["K"][1][0] == pytest.approx(1.6589, abs=5e-4)  # Eq. (14)
    assert outcome.values["spectral_radius"] < 1.0
    assert outcome.values["period_s"] == 1.0
    assert controller.exists()


def test_doctor_separates_optional_parts_from_required_ones(run, monkeypatch: pytest.MonkeyPatch) -> None:
    find = doctor.util.find_spec

    def without(*names: str) -> None:
        monkeypatch.setattr(doctor.util, "find_spec", lambda name: None if name in names else find(name))

    without("pyarrow")
    done = run("doctor")
    assert done.code == 0
    assert re.fullmatch(r"missing: 0 required, [1-9]\d* optional", done.out.splitlines()[-1])
    required = {part["name"]: part["required"] for part in run("doctor", "--json").values["parts"]}
    assert (required["mujoco-core"], required["pyarrow"], required["rospy"], required["Gazebo"]) == (True, False, False, False)
    without("scipy")
    done = run("doctor")
    assert (done.code, done.out.splitlines()[-1].split(",")[0]) == (1, "missing: 1 required")


def shell(line: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a shell's line in which $T is the command."""
    command = f"{sys.executable} -m treadline"
    line = f"set -o pipefail; {line.replace('$T', command)}"
    done = subprocess.run(
        ["bash", "-c", line], capture_output=True, text=True, check=False, env={**os.environ, **environment}, timeout=120
    )
    done.stderr = re.sub(r"treadline.*: running; Ctrl-C stops it\n", "", done.stderr)  # on a busy machine
    return done


@pytest.mark.parametrize("line", ["$T check paper-28 --json >&-", "$T --help > /dev/full"])
def test_an_answer_that_cannot_be_written_is_one_line_and_exit_2(line: str) -> None:
    done = shell(line)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1), done.stderr
    assert done.stderr.startswith("treadline: the answer cannot be written to stdout: ")


def test_an_encoding_that_lacks_a_sign_stops_no_answer() -> None:
    done = shell("$T check paper-28", PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stderr) == (0, "")
    assert "margins  uphill " in done.stdout


def test_a_reader_that_leaves_and_a_closed_stderr_are_no_failure() -> None:
    assert shell("$T --help | head -1").returncode == 0
    assert shell("$T check paper-28 2>&-").returncode == 0
    assert shell("$T check none.toml 2>&-").returncode == 2


def test_help_lists_every_command_under_its_heading(run) -> None:
    text = run("--help").out
    places = [text.index(f" {heading} ") for heading in VERBS]
    assert places == sorted(places)
    for place, end, verbs in zip(places, [*places[1:], len(text)], VERBS.values(), strict=True):
        for verb in verbs:
            assert text[place:end].partition(f"│ {verb} ")[2].lstrip()[0] != "│", f"{verb} has no line of help"


def test_completion_is_installed_for_bash(tmp_path: Path) -> None:
    shell("$T --install-completion --shell bash", HOME=str(tmp_path), SHELL="/bin/bash")
    (script,) = [path for path in tmp_path.rglob("*treadline*") if path.is_file()]
    assert "climb" in script.read_text()
