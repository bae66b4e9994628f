"""The exported controller gives the same responses: compiled, and fed with the inputs of a recorded run."""

import json
import math
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from treadline.control import ControllerConfig, HeadingController, tune
from treadline.control.c_export import Exchange, exported, rehearsal
from treadline.core.models import ControllerDesign, LinearModel
from treadline.core.signals import HeadingEstimate, MotionPlan, TrackCommand
from treadline.run.episode import traverse
from treadline.scenario.scenario import Control, DriveSettings, Scenario, Stair, Start
from treadline.scenario.shipped_files import shipped_controller

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_a_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler (cc, gcc or clang) on the path")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-Wconversion", "-O2")
CONFIG = ControllerConfig()


def write(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")


def verdict_of(folder: Path) -> tuple[int, str]:
    """Compile with strict C99 flags and only the C library, and run the test that comes with the code."""
    assert COMPILER is not None
    program = folder / "heading_selftest"
    built = subprocess.run(
        [COMPILER, *STRICT, "heading_controller.c", "heading_selftest.c", "-o", program],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout


def three_states() -> ControllerDesign:
    """Return a design with more states than outputs, and nonzero D."""
    A = np.array([[0.97, 0.1, 0.0], [0.0, 0.5, 0.1], [0.0, 0.0, 0.2]])
    B = np.array([[-0.1, 0.1], [-0.3, 0.35], [-0.2, 0.1]])
    C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.5]])
    D = np.array([[0.0, 0.0], [-0.02, 0.03]])
    offsets = {"input_offset": np.array([0.18, 0.22]), "output_offset": np.zeros(2)}
    return tune(LinearModel(A=A, B=B, C=C, D=D, dt_s=0.25, **offsets))


def without_memory_of_belts() -> ControllerDesign:
    return replace(shipped_controller("wheelchair"), disturbance_gain=None)


def late(*delays: int) -> ControllerDesign:
    """Return the design with feedthrough for a plant that answers its belts so many periods late."""
    design = three_states()
    return replace(design, model=replace(design.model, input_delay=delays))


DESIGNS = {
    "wheelchair": (lambda: shipped_controller("wheelchair"), CONFIG),
    "rescue": (lambda: shipped_controller("rescue"), ControllerConfig(climb_speed_m_s=0.3, max_speed_m_s=0.8)),
    "as the paper clips": (lambda: shipped_controller("wheelchair"), ControllerConfig(allocation="paper")),
    "static": (lambda: shipped_controller("wheelchair"), ControllerConfig(reconstruct="static")),
    "learns nothing": (without_memory_of_belts, CONFIG),
    "three states": (three_states, CONFIG),
    "dead time": (lambda: late(3, 3), CONFIG),
    "dead times": (lambda: late(0, 5), CONFIG),
    "30 periods": (lambda: late(30, 28), CONFIG),
}


@needs_a_compiler
@pytest.mark.parametrize("case", DESIGNS)
def test_the_c_code_gives_the_same_commands_in_a_rehearsal(tmp_path: Path, case: str) -> None:
    make, config = DESIGNS[case]
    write(tmp_path, exported("c", make(), config))
    code, out = verdict_of(tmp_path)
    assert code == 0, out
    assert "400 steps agree" in out


class Listener:
    """Heading controller that records its inputs and responses."""

    follows_plan = False

    def __init__(self, design: ControllerDesign) -> None:
        self._driver = HeadingController(design, CONFIG)
        self.log: list[Exchange] = []

    @property
    def period_s(self) -> float:
        return self._driver.period_s

    def step(self, estimate: HeadingEstimate | None, t_s: float, plan: MotionPlan | None = None) -> TrackCommand:
        plan = plan or MotionPlan(t_s=t_s, phase="drive", speed_m_s=CONFIG.climb_speed_m_s)
        answer = self._driver.step(estimate, t_s, plan)
        self.log.append(Exchange(estimate=estimate, plan=plan, answer=answer))
        return answer


@needs_a_compiler
def test_the_c_code_replays_a_run_within_a_millionth(tmp_path: Path) -> None:
    design = shipped_controller("wheelchair")
    listener = Listener(design)
    flight = Scenario(
        stair=Stair.model_validate({"slope_deg": 28.0, "width_m": 2.4, "steps": 30}),
        start=Start(place="flight", step=6, heading_deg=20.0),
        drive=DriveSettings(duration_s=20.0),
        control=Control(vision="truth"),
    )
    traverse(flight, controller=design, seed=1, driver=listener)
    assert len(listener.log) > 60
    assert any(exchange.estimate is not None for exchange in listener.log)
    write(tmp_path, exported("c", design, CONFIG, listener.log))
    code, out = verdict_of(tmp_path)
    assert code == 0, out


@needs_a_compiler
def test_the_self_test_finds_a_gain_that_was_mistyped(tmp_path: Path) -> None:
    design = shipped_controller("wheelchair")
    files = exported("c", design, CONFIG)
    gain = repr(float(design.K[0, 0]))
    assert files["heading_numbers.h"].count(gain) == 1
    files["heading_numbers.h"] = files["heading_numbers.h"].replace(gain, repr(float(design.K[0, 0]) * 1.001))
    write(tmp_path, files)
    code, out = verdict_of(tmp_path)
    assert code == 1
    assert "wanted" in out


def test_the_rehearsal_covers_every_state_of_a_drive() -> None:
    log = rehearsal(shipped_controller("wheelchair"), CONFIG)
    speeds = {exchange.plan.speed_m_s for exchange in log}
    assert min(speeds) < 0.0 < max(speeds)
    assert 0.0 in speeds
    assert any(exchange.plan.heading_rad != 0.0 for exchange in log)
    assert any(exchange.estimate is None for exchange in log)
    assert any(exchange.estimate is not None and math.isnan(exchange.estimate.heading_rad) for exchange in log)
    # From 30° the steering is saturated at first, and unsaturated later.
    belts = [exchange.answer.right_m_s - exchange.answer.left_m_s for exchange in log]
    assert abs(belts[0]) > 0.5
    assert 0.0 < abs(belts[50]) < 0.2
    assert all(exchange.answer.brake for exchange in log if exchange.estimate is None)


def test_json_contains_the_controller_and_a_test_log() -> None:
    design = shipped_controller("wheelchair")
    declared = json.loads(exported("json", design, CONFIG)["heading_controller.json"])
    np.testing.assert_array_equal(declared["matrices"]["A"], design.model.A)
    assert declared["settings"]["period_s"] == 0.25
    first = declared["self_test"]["log"][0]
    answer = rehearsal(design, CONFIG)[0].answer
    assert (first["left_m_s"], first["right_m_s"]) == (answer.left_m_s, answer.right_m_s)
