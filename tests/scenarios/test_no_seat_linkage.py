"""A vehicle without a seat linkage: check, climb, nodes, sweep, report, replay and model files."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest

from treadline.cli import app
from treadline.core.errors import SettingsError
from treadline.core.signals import SeatCommand, SeatReading
from treadline.mission.loop import Mission
from treadline.mission.mission_blocks import build_blocks, guard_config
from treadline.plant.mujoco import open_plant
from treadline.ros.assembly import driving_nodes, node_of
from treadline.ros.lockstep import LockStep
from treadline.run.recorded_run import recorded_run
from treadline.run.resolve import checked as check
from treadline.run.resolve import mission_config, resolve
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair, Scenario
from treadline.scenario.shipped_files import CHAIRS, shipped_controller
from treadline.vehicle.bodies import centre_of_mass, payload_place, vehicle
from treadline.vehicle.loading import Loading
from treadline.vehicle.sdf import sdf_model
from treadline.vehicle.urdf import urdf

PAYLOAD = "[payload]\ncom_m = [0.25, 0.0, 0.45]\nsize_m = [0.35, 0.40, 0.30]\n\n"


@pytest.fixture
def robot(tmp_path: Path) -> Callable[..., Path]:
    """Write a shipped chair without its seat; the name stays where the shipped controller is to be used."""

    def write(*, model: str = "wheelchair", name: str = "wheelchair", payload: str = PAYLOAD) -> Path:
        tables = re.split(r"(?m)^(?=\[)", (CHAIRS / f"{model}.toml").read_text(encoding="utf-8"))
        text = "".join(table for table in tables if not table.startswith("[seat]"))
        text = re.sub(r'(?m)^name = ".*"', f'name = "{name}"', text)
        path = tmp_path / "robot.toml"
        path.write_text(text.replace("[drives]", payload + "[drives]", 1), encoding="utf-8")
        return path

    return write


def scenario_of(path: Path, payload_kg: float = 30.0, **tables: object) -> Scenario:
    chair = {"model": str(path), "payload_kg": payload_kg}
    return Scenario.model_validate({"sensors": {"camera": "statistical"}, "chair": chair, **tables})


def run_command(*words: object) -> int:
    answer = app([str(word) for word in words], exit_on_error=False, print_error=False, result_action="return_value")
    return int(answer.code)


def test_a_payload_without_a_seat_does_not_turn(robot: Callable[..., Path]) -> None:
    chair, loading = read_chair(str(robot())), Chair(payload_kg=30.0, payload_offset_m=(0.1, -0.02, 0.03))
    assert payload_place(chair, loading, 0.0) == payload_place(chair, loading, 0.5) == pytest.approx((0.35, -0.02, 0.48))
    assert Loading(chair=chair, payload_kg=30.0).weight_n == pytest.approx(9.81 * (23.4 + 3.0 + 30.0))


@pytest.mark.parametrize("payload", [PAYLOAD, ""])
def test_bodies_weigh_as_much_and_balance_as_the_check_assumes(robot: Callable[..., Path], payload: str) -> None:
    chair, loading = read_chair(str(robot(payload=payload))), Chair(payload_kg=20.0)
    bodies = vehicle(chair, loading).bodies
    mass = sum(body.mass_kg for body in bodies)
    assert mass == pytest.approx(23.4 + 3.0 + 20.0)
    places = [np.add(body.origin_m, body.com_m) for body in bodies]
    com = sum(body.mass_kg * place for body, place in zip(bodies, places, strict=True)) / mass
    np.testing.assert_allclose(com, centre_of_mass(chair, loading, 0.4, 0.0), atol=1e-12)  # the flipper's body lies at zero


def test_a_chair_file_gives_the_payload_one_place(robot: Callable[..., Path], tmp_path: Path) -> None:
    whole = (CHAIRS / "wheelchair.toml").read_text(encoding="utf-8")
    (tmp_path / "both.toml").write_text(whole + "\n" + PAYLOAD, encoding="utf-8")
    with pytest.raises(SettingsError, match="give seat or payload, not both"):
        read_chair(str(tmp_path / "both.toml"))
    with pytest.raises(SettingsError, match="has no seat linkage, so there is nothing to level"):
        read_chair(str(robot())).levelled_seat  # noqa: B018


def test_check_reports_no_seat_range_and_refuses_a_seat_shift(robot: Callable[..., Path]) -> None:
    path = robot()
    report = check(scenario_of(path), read_chair(str(path)))
    assert report.verdict == "go"
    assert report.seat_range_deg is None
    assert ("seat", "no seat linkage") in report.printed()[1]
    shifted = scenario_of(path, chair={"model": str(path), "seat_shift_m": 0.05})
    assert any("chair.seat_shift_m is 0.05" in reason for reason in check(shifted, read_chair(str(path))).reasons)
    heavy = check(scenario_of(path, 110.0, stair={"slope_deg": 31.0}), read_chair(str(path)))
    assert heavy.proposed_seat_shift_m is None


def test_a_whole_climb_arrives_without_seat_commands(robot: Callable[..., Path], tmp_path: Path) -> None:
    folder = tmp_path / "run"
    run = recorded_run(folder, resolve(scenario_of(robot(), stair={"steps": 6}), seed=4))
    assert run.verdict == "arrived", run.cause
    assert run.scores.seat_rms_deg is None
    assert run.scores.seat_max_deg is None
    assert run.scores.min_stability_margin_deg > 7.0
    assert np.isnan(run.trace["seat_pitch_rad"]).all()
    result = json.loads((folder / "result.json").read_text())
    assert result["seat_max_deg"] is None
    assert run_command("report", folder) == 0
    page = (folder / "report.html").read_text()
    assert page.count("no seat linkage") == 2  # RMS and largest
    assert run_command("replay", folder, "--out", tmp_path / "again") == 0


@pytest.mark.parametrize("model", ["wheelchair", "wheelchair-fixed"])
def test_a_robot_climbs_with_flipper_or_without_and_empty(robot: Callable[..., Path], model: str) -> None:
    start = {"place": "flight", "step": 4}
    scenario = scenario_of(robot(model=model, payload=""), 0.0, start=start, drive={"duration_s": 6.0})
    plant = open_plant(scenario, 2)
    blocks = build_blocks(mission_config(scenario, shipped_controller("wheelchair")))
    assert blocks.leveller is None
    logged: list[object] = []
    mission = Mission(plant, blocks, log=lambda signal, _: logged.append(signal))
    for _ in range(600):
        mission.tick()
    assert not [signal for signal in logged if isinstance(signal, SeatCommand | SeatReading)]
    heights = [truth.passenger_z_m for truth in plant.truth()]
    assert heights[-1] > heights[0] + 0.1  # it lays its flipper for 3 s, and rises by 0.28 m in 3 s
    plant.close()


def test_the_graph_has_no_seat_node_and_drives_as_the_loop_does(robot: Callable[..., Path]) -> None:
    scenario = scenario_of(robot(), start={"place": "flight", "step": 4, "heading_deg": 8})
    config = mission_config(scenario, shipped_controller("wheelchair"))
    assert "seat" not in driving_nodes(config.chair)
    with pytest.raises(SettingsError, match="has no seat linkage; leave out the seat node"):
        node_of("seat", config)
    ends = []
    for graph in (False, True):
        blocks, plant = build_blocks(config), open_plant(scenario, 3)
        driven = LockStep(plant, blocks, guard_config(config, blocks.driver.period_s)) if graph else Mission(plant, blocks)
        for _ in range(200):
            driven.tick()
        ends.append(plant._data.qpos.copy())
        plant.close()
    np.testing.assert_array_equal(ends[0], ends[1])


def test_model_files_fix_the_payload_to_the_chassis(robot: Callable[..., Path]) -> None:
    chair, loading = read_chair(str(robot())), Chair(payload_kg=30.0)
    tree = fromstring(urdf(chair, loading))  # noqa: S314 - our own document
    joint = next(item for item in tree.iter("joint") if item.get("name") == "load_joint")
    assert joint.get("type") == "fixed"
    masses = [float(str(item.get("value"))) for item in tree.iter("mass")]
    assert math.isclose(sum(masses), 56.4)
    assert 'name="load_joint" type="fixed"' in sdf_model(chair, loading, friction=(0.62, 0.5))


def test_a_sweep_of_a_robot_summarises_without_the_seat(robot: Callable[..., Path], tmp_path: Path, monkeypatch) -> None:
    path = robot()
    text = f'[chair]\nmodel = "{path}"\npayload_kg = 30.0\n[sensors]\ncamera = "statistical"\n[drive]\nduration_s = 1.0\n'
    (tmp_path / "sweep.toml").write_text(text + '[[draw]]\nkey = "start.heading_deg"\nuniform = [-5, 5]\n')
    out = tmp_path / "swept"
    monkeypatch.setattr("treadline.cli.sweep.compile_once", lambda: None)  # one worker compiles what it needs
    run_command("sweep", tmp_path / "sweep.toml", "--runs", 2, "--workers", 1, "--seed", 5, "--out", out)
    assert len((out / "runs.csv").read_text().splitlines()) == 3
    assert "seat_max_deg" not in json.loads((out / "summary.json").read_text())["scores"]
