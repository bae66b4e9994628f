"""Bad input, verb by verb: exit code 2, one line that names what, where and the remedy, nothing half-written."""

import json
from pathlib import Path

import numpy as np
import pytest

from treadline.core import paper
from treadline.experiments.as_printed import paper_model
from treadline.io.mcap_log import RunLog
from treadline.scenario.shipped_files import CHAIRS

from .conftest import assert_refused

SCENARIOS = {
    "unknown key": ("[stair]\nriser_m = 0.16\n", "stair.riser_m: unknown key; did you mean rise_m?"),
    "wrong type": ('[stair]\nrise_m = "high"\n', "stair.rise_m"),
    "out of range": ("[stair]\nrise_m = 0.9\n", "stair.rise_m"),
    "two truths": ("[stair]\nrise_m = 0.16\nslope_deg = 28\n", "not both"),
    "unknown chair": ('[chair]\nmodel = "throne"\n', "chair.model"),
    "unknown fault": ('[[fault]]\nkind = "gremlin"\n', "fault.0.kind"),
}


@pytest.mark.parametrize("verb", ["check", "excite"])
@pytest.mark.parametrize("case", SCENARIOS)
def test_a_bad_scenario_names_its_file_and_key(run, tmp_path: Path, verb: str, case: str) -> None:
    text, key = SCENARIOS[case]
    path = tmp_path / "scenario.toml"
    path.write_text(text)
    out = tmp_path / "run"
    arguments = [verb, path] if verb == "check" else [verb, path, "--out", out]
    assert_refused(run(*arguments), key)
    assert not out.exists()


@pytest.mark.parametrize("verb", ["check", "climb", "sweep", "view"])
def test_a_value_that_cannot_be_set_is_refused_before_anything_runs(run, tmp_path: Path, verb: str) -> None:
    out = tmp_path / "run"
    rest = {"climb": ["--out", out], "sweep": ["--runs", 1, "--out", out], "view": ["--port", 0, "--no-browser"]}.get(verb, [])
    name = "envelope" if verb == "sweep" else "up-28"
    for item, said in (
        ("stair.slop_deg=30", f"{name}, as changed: stair.slop_deg: unknown key; did you mean slope_deg?"),
        ("stair.slope_deg=90", f"{name}, as changed: stair.slope_deg: must be a number from 5 to 45 (got 90)"),
        ("stair.slope_deg", "--set stair.slope_deg: must be key=value"),
    ):
        assert_refused(run(verb, name, "--set", item, *rest), said)
    assert not out.exists()


@pytest.mark.parametrize("verb", ["check", "climb"])
def test_a_scenario_that_is_no_file_says_so(run, tmp_path: Path, verb: str) -> None:
    rest = [] if verb == "check" else ["--out", tmp_path / "run"]
    assert_refused(run(verb, tmp_path / "none.toml", *rest), "none.toml", "no such file")
    assert_refused(run(verb, tmp_path, *rest), "folder")
    latin = tmp_path / "latin.toml"
    latin.write_bytes(b'[chair]\nmodel = "caf\xe9"\n')
    assert_refused(run(verb, latin, *rest), "UTF-8")


@pytest.mark.parametrize(
    ("verb", "arguments", "word"),
    [
        ("excite", ["paper-28", "--out", "run", "--samples", "56"], "--samples is 56; treadline identify needs at least 57"),
        ("excite", ["paper-28", "--out", "run", "--period", "0.013"], "--period"),
        ("reproduce", ["--workers", "0"], "--workers"),
        ("identify", ["--method", "magic", "a.csv"], "--method"),
        ("identify", ["--inputs", "a,,b", "a.csv"], "--inputs"),
        ("identify", ["--order", "two", "a.csv"], "--order"),
        ("see", ["none.png", "none2.png", "--camera", "none.toml"], "none.toml"),
        ("see", ["a.png", "b.png"], "--camera"),
        ("see", ["a.png", "b.png", "--camera", "c.toml", "--method", "magic"], "--method"),
        ("report", ["no-run"], "no-run"),
        ("jump", [], 'Unknown command "jump"; see treadline --help'),
        ("sea", [], 'Did you mean "seat"? See treadline --help'),
        ("check", ["envelope"], "run it with treadline sweep envelope"),
        ("sweep", ["paper-28", "--runs", "3"], "run it once with treadline climb paper-28"),
        ("check", [""], "no scenario is named"),
        ("climb", ["paper-28", "--out", "run", "--seed", "1.5"], "--seed: '1.5' is not a whole number"),
        *((verb, ["paper-28", "--out", "run", "--seed", "-1"], "--seed is -1; at least 0") for verb in ("climb", "seat")),
        *(("nodes", ["paper-28", "--out", "run", "--duration", value], "--duration is") for value in ("nan", "0")),
        *(("nodes", ["paper-28", "--out", "run", "--pace", value], "--pace is") for value in ("-1", "inf")),
        ("nodes", ["paper-28", "--out", "run", "--without", "plant"], "--without plant needs --transport"),
        ("record", ["--out", "run", "--duration", "-1"], "--duration is -1; it must be above 0"),
        # A list that begins with a minus is a value, not an option: what follows it is what is refused.
        ("see", ["a.png", "b.png", "--gravity", "-0.05,0.8,0.6"], "--camera"),
        ("tune", ["none.json", "--state-weight", "-1,1"], "none.json: no such file"),
        ("climb", ["paper-28", "--out", "run", "--picture", "film.webp"], "--picture is drawn by Gazebo: add --plant gazebo"),
        (
            "climb",
            ["paper-28", "--out", "run", "--plant", "gazebo", "--picture", "film.avi"],
            "suffix of --picture is '.avi'; allowed: .webp, .gif",
        ),
        ("climb", ["paper-28"], "climb requires --out; see treadline climb --help"),
        ("export", ["--to", "c"], "export requires --out"),
        ("model", ["paper-28", "--to", "obj", "--out", "run"], "--to"),
        ("model", ["paper-28", "--out", "run"], "--to"),
        ("report", [], "report requires RUN"),
        ("climb", ["paper-28", "--out"], "--out requires an argument"),
        ("check", ["paper28"], "did you mean paper-28?"),
    ],
)
def test_bad_arguments_are_named(run, tmp_path: Path, monkeypatch, verb: str, arguments: list[str], word: str) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused(run(verb, *arguments), word)
    assert not list(tmp_path.iterdir())


RECORD_HEADER = "t_s,left_m_s,right_m_s,heading_rad,yaw_rate_rad_s"


def record_text(rows: int = 300) -> list[str]:
    rng = np.random.default_rng(7)
    u = 0.2 + 0.1 * rng.uniform(-1, 1, (rows, 2))
    heading = np.cumsum(u[:, 1] - u[:, 0]) * 0.05
    table = np.column_stack([0.25 * np.arange(rows), u, heading, (u[:, 1] - u[:, 0]) * 0.2])
    return [RECORD_HEADER, *(",".join(map(repr, row)) for row in table.tolist())]


RECORDS = {
    "missing file": (None, "no such file"),
    "no header": (record_text()[1:], "there are: 0, 1, 2, 3, 4"),
    "no time": ([record_text()[0].replace("t_s", "row"), *record_text()[1:]], "give --period, or name the time t_s"),
}


@pytest.mark.parametrize("case", RECORDS)
def test_a_bad_record_names_its_file_and_place(run, tmp_path: Path, case: str) -> None:
    lines, word = RECORDS[case]
    path = tmp_path / "record.csv"
    if lines is not None:
        path.write_text("\n".join(lines) + ("\n" if lines else ""))
    out = tmp_path / "model.json"
    assert_refused(run("identify", path, "--out", out), "record.csv", word)
    assert not out.exists()


@pytest.fixture
def model_path(tmp_path: Path) -> Path:
    path = tmp_path / "model.json"
    paper_model(0.2).save(path)
    return path


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--state-weight", "1,-1"], "semi-definite"),
        (["--input-weight", "x"], "--input-weight"),
        (["--reconstruct", "guess"], "--reconstruct"),
        (["--state-weight", "1,1", "--output-weight", "1,1"], "not both"),
        *((["--period", value], "multiple of 0.01 s: give --period 0.") for value in ("0.033", "0.001", "0.2500001")),
    ],
)
def test_tune_refuses_weights_that_mean_nothing_and_periods_that_no_mission_keeps(
    run, tmp_path: Path, model_path: Path, options: list[str], word: str
) -> None:
    out = tmp_path / "controller.json"
    assert_refused(run("tune", model_path, *options, "--out", out), word)
    assert not out.exists()


def test_tune_does_not_write_over_its_model(run, tmp_path: Path, model_path: Path) -> None:
    before = model_path.read_bytes()
    assert_refused(run("tune", model_path, "--state-weight", "1,1", "--out", tmp_path / "." / "model.json"), "is the model itself")
    assert model_path.read_bytes() == before


def broken(key: str, value: object) -> dict[str, object]:
    return {
        "A": paper.A.tolist(),
        "B": paper.B.tolist(),
        "C": paper.C.tolist(),
        "D": paper.D.tolist(),
        "dt_s": 1.0,
        "input_offset": [0.2, 0.2],
        "output_offset": [0.0, 0.0],
        key: value,
    }


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "empty; wanted JSON"),
        pytest.param('{"A": ' + "1" * 5000 + "}", "not JSON", id="a number of 5000 digits"),
        ("[]", "not an object"),
        (json.dumps(broken("colour", "red")), "colour"),
        (json.dumps(broken("K", [[1.0]])), "not a model but a controller"),
        (json.dumps({"verdict": "held"}), "a run's result"),
        (json.dumps(broken("A", [[1.0, float("nan")], [0.0, 1.0]])), "NaN"),
        (json.dumps(broken("B", [[1.0], [2.0], [3.0]])), "transposed"),
    ],
)
def test_a_file_that_is_no_model_is_refused(run, tmp_path: Path, text: str, word: str) -> None:
    path = tmp_path / "model.json"
    path.write_text(text)
    assert_refused(run("tune", path, "--out", tmp_path / "controller.json"), "model.json", word)


def test_a_log_is_no_model_and_no_controller(run, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text(RECORD_HEADER)
    first = f"treadline identify {log} --out model.json"
    assert_refused(run("tune", log, "--out", tmp_path / "c.json"), f"{log}: a log, not a model; make one first: {first}")
    for line in (["climb", "paper-28", "--controller", log], ["export", log, "--to", "c"]):
        outcome = run(*line, "--out", tmp_path / "out")
        assert_refused(outcome, f"{log}: a log, not a controller; make one first: {first} && treadline tune model.json")
    assert_refused(run("tune", tmp_path, "--out", tmp_path / "c.json"), f"{tmp_path}: a folder, not a model")


def test_a_controller_s_file_is_asked_for_its_class_and_not_run(run, tmp_path: Path) -> None:
    file = tmp_path / "pid.py"
    file.write_text("class Gains:\n    pass\nclass Pid:\n    follows_plan = True\nraise SystemExit(0)\n")
    assert_refused(run("climb", "paper-28", "--controller", file, "--out", tmp_path / "run"), f"give --controller {file}:Pid")
    named = run("climb", "paper-28", "--controller", f"{file}:Pid", "--out", tmp_path / "run")
    assert_refused(named, "cannot be imported: SystemExit")  # and no exit code 0
    assert not (tmp_path / "run").exists()


def test_a_gain_without_effect_is_reported(run, tmp_path: Path, model_path: Path) -> None:
    slow = run("tune", model_path, "--period", "100", "--out", tmp_path / "slow.json")
    assert slow.code == 0
    assert "warning: a heading of 30° is answered with" in slow.out
    usual = run("tune", model_path, "--out", tmp_path / "usual.json")
    assert "warning" not in usual.out


def test_a_model_is_no_controller(run, tmp_path: Path, model_path: Path) -> None:
    outcome = run("climb", "paper-28", "--controller", model_path, "--out", tmp_path / "run")
    assert_refused(outcome, "a model, not a controller: treadline tune model.json makes one")
    exported = run("export", model_path, "--to", "c", "--out", tmp_path / "c")
    assert_refused(exported, "a model, not a controller: treadline tune model.json makes one")
    assert not (tmp_path / "run").exists()


def test_tune_is_for_a_chair_that_there_is(run, tmp_path: Path, model_path: Path) -> None:
    out = tmp_path / "controller.json"
    assert_refused(
        run("tune", model_path, "--vehicle", "foo", "--out", out), "--vehicle", "'foo'", "wheelchair", "a path to a .toml"
    )
    assert not out.exists()
    own = tmp_path / "own.toml"
    own.write_text((CHAIRS / "wheelchair.toml").read_text().replace('name = "wheelchair"', 'name = "ours"'))
    assert run("tune", model_path, "--vehicle", own, "--out", out).code == 0
    assert json.loads(out.read_text())["vehicle"] == "ours"


def test_tune_asks_for_a_period_where_the_model_s_own_is_none_that_a_mission_keeps(run, tmp_path: Path) -> None:
    model, out = tmp_path / "model.json", tmp_path / "controller.json"
    model.write_text(json.dumps(broken("dt_s", 0.033)))
    assert_refused(run("tune", model, "--out", out), "the model's period", "0.033", "give --period 0.03")
    assert not out.exists()
    assert run("tune", model, "--period", "0.03", "--out", out).code == 0


@pytest.mark.parametrize(
    ("period_s", "word"), [(0.033, "period_s is 0.033, no multiple of 0.01 s; tune it again"), ("fast", "period_s is fast")]
)
def test_a_controller_of_a_period_that_no_mission_keeps_is_refused_as_it_is_read(
    run, tmp_path: Path, model_path: Path, period_s: object, word: str
) -> None:
    controller, out = tmp_path / "controller.json", tmp_path / "run"
    assert run("tune", model_path, "--out", controller).code == 0
    tables = json.loads(controller.read_text())
    tables["period_s"] = period_s
    controller.write_text(json.dumps(tables))
    assert_refused(run("climb", "paper-28", "--controller", controller, "--out", out), "controller.json", word)
    assert not out.exists()


def test_tune_names_what_a_model_of_three_outputs_needs(run, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    tables = broken("C", np.eye(3, 2).tolist()) | {"D": [[0.0] * 2] * 3, "output_offset": [0.0] * 3}
    path.write_text(json.dumps(tables))
    assert_refused(run("tune", path, "--out", tmp_path / "controller.json"), "3 outputs", "give --output-weight")


def test_the_folder_of_an_interrupted_run_says_so(run, tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text("{}")
    assert_refused(run("report", tmp_path), "this run was interrupted")
    with RunLog(tmp_path / "log.mcap"):
        pass
    assert_refused(run("identify", tmp_path, "--out", tmp_path / "model.json"), "no record.csv", "treadline excite")
    (tmp_path / "journal.jsonl").touch()
    assert_refused(run("report", tmp_path), "a sweep's folder")


def test_sums_that_are_none_are_said_to_be_none(run, tmp_path: Path) -> None:
    path, other = tmp_path / "record.csv", tmp_path / "other.npz"
    path.write_text("\n".join(record_text()) + "\n")
    np.savez(other, a=1.0)
    assert_refused(
        run("identify", path, "--update", other, "--out", tmp_path / "model.json"), "takes a file written by identify --gram"
    )


def test_debug_shows_the_traceback(run, tmp_path: Path) -> None:
    outcome = run("check", tmp_path / "none.toml", "--debug")
    assert outcome.code == 2
    assert "Traceback" in outcome.err


def test_too_short_a_record_is_named_with_what_it_needs_and_what_was_kept_back(run, tmp_path: Path) -> None:
    path = tmp_path / "short.csv"
    path.write_text("\n".join(record_text(100)) + "\n")
    options = ("--out", tmp_path / "model.json")
    assert_refused(
        run("identify", path, "--validate", "0.5", *options),
        "short.csv: 50 samples are too few",
        "at least 57",
        "--validate 0.5 keeps",
    )
    path.write_text("\n".join(record_text(20)) + "\n")
    assert_refused(run("identify", path, *options), "short.csv: 20 samples are too few", "need at least 57\n")


def test_a_result_that_cannot_be_written_says_where(run, tmp_path: Path, model_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    assert_refused(run("tune", model_path, "--state-weight", "1,1", "--out", blocked / "controller.json"), "file")


def test_a_controller_of_another_period_or_vehicle_is_refused(run, tmp_path: Path, model_path: Path) -> None:
    controller, out = tmp_path / "controller.json", tmp_path / "run"
    assert run("tune", model_path, "--state-weight", "1,1", "--vehicle", "rescue", "--out", controller).code == 0
    assert_refused(run("climb", "paper-28", "--controller", controller, "--out", out), "rescue")
    tables = json.loads(controller.read_text())
    tables["vehicle"], tables["period_s"] = "wheelchair", 0.25
    controller.write_text(json.dumps(tables))
    assert_refused(run("climb", "paper-28", "--controller", controller, "--out", out), "period")
    assert not out.exists()
