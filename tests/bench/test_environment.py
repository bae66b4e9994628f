"""Environments of the bench: gymnasium's contract, seeds, and refusals."""

import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from treadline.bench import TASKS, StairEnv, make_vec
from treadline.bench.observers import OBSERVATION
from treadline.core.errors import SettingsError
from treadline.scenario.shipped_files import CHAIRS

AHEAD = np.array([0.6, 0.6, 0.0, 0.0])
LAST_HEIGHT = list(OBSERVATION).index("height_11_m")


def driven(env: StairEnv, steps: int, action: np.ndarray = AHEAD) -> list[np.ndarray]:
    return [env.step(action)[0] for _ in range(steps)]


@pytest.mark.parametrize("task", TASKS)
def test_a_registered_environment_passes_the_check_of_gymnasium(task: str) -> None:
    with gymnasium.make(f"treadline/{task}-v0") as env:
        check_env(env.unwrapped, skip_render_check=True)


def test_oracle_and_tracker_agree_on_a_stair_in_view() -> None:
    seen = [driven(env, 60)[-1] for see in ("oracle", "tracker") for env in [StairEnv("StairUp", see=see)] if env.reset(seed=3)]
    # 0.03 rad or m: errors of a heading, of gravity (a degree), and of nosings a metre away; the torque has noise of 2 N m.
    limits = dict.fromkeys(OBSERVATION, 0.03) | {"flipper_torque_n_m": 10.0}
    assert np.all(np.abs(seen[0] - seen[1]) <= list(limits.values()))
    assert seen[0][LAST_HEIGHT] > 0.1


def test_a_seed_is_an_episode() -> None:
    env = StairEnv("Buildings", see="tracker")
    runs = []
    for seed in (4, 5, 4):
        begun, _ = env.reset(seed=seed)
        runs.append(np.array([begun, *driven(env, 20)]))
    assert np.array_equal(runs[0], runs[2])
    assert not np.array_equal(runs[0], runs[1])


def test_a_new_episode_on_the_same_stair_is_the_first_one_again() -> None:
    env = StairEnv("Straighten", episodes_per_stair=2)
    runs = [(env.reset()[0], env.scenario, *driven(env, 20)) for _ in range(3)]
    assert runs[0][1] is runs[1][1]
    assert runs[2][1] is not runs[1][1]
    for first, again in zip(runs[0][2:], runs[1][2:], strict=True):
        assert np.array_equal(first, again)


def end_of(env: StairEnv, action: np.ndarray) -> tuple[str, list[float]]:
    """Return the verdict of an episode of one action, and its rewards."""
    env.reset(seed=1)
    rewards: list[float] = []
    while True:
        _, reward, over, late, info = env.step(action)
        rewards.append(reward)
        if over or late:
            return info["verdict"], rewards


def test_the_reward_of_an_arrival_is_one_and_a_fall_costs_one() -> None:
    verdict, rewards = end_of(StairEnv("Kerb", changes={"stair.rise_m": 0.06, "start.heading_deg": 0}), AHEAD)
    assert (verdict, sum(rewards)) == ("arrived", pytest.approx(1.0, abs=0.01))
    env = StairEnv("Straighten", changes={"start.heading_deg": 30, "stair.slope_deg": 28})
    verdict, rewards = end_of(env, np.array([-1.0, 1.0, 0.0, 0.0]))
    assert verdict == "fell"
    assert rewards[-1] < -0.9


def test_steps_keep_no_record() -> None:
    env = StairEnv("StairUp", episodes_per_stair=10**9)
    env.reset(seed=0)
    driven(env, 200, np.zeros(4))
    assert env._plant is not None
    assert len(env._plant._pending) + len(env._plant._truth) + len(env._plant._readings) == 0


def test_friction_of_ten_holds_what_slides_at_that_of_the_table() -> None:
    moved = []
    for friction in (None, 10.0):
        env = StairEnv("Straighten", friction=friction, changes={"stair.friction": [0.45, 0.36], "start.heading_deg": 0})
        env.reset(seed=0)
        begun_m = env._latest.x_m
        driven(env, 100, np.zeros(4))
        moved.append(begun_m - env._latest.x_m)
    assert moved[0] > 5.0 * moved[1]


@pytest.mark.parametrize("vehicle", ["wheelchair-fixed", "rescue", "four"])
def test_any_vehicle_file_gives_an_action_for_each_drive(vehicle: str, tmp_path: Path) -> None:
    if vehicle == "four":
        text = (CHAIRS / "rescue.toml").read_text()
        section = 'name = "tail"\nstart_m = [-0.44, 0.05]\nend_m = [-0.78, 0.05]\nradii_m = [0.05, 0.05]\nfollows = true\n'
        flipper = text[text.index("[flipper]") :].partition("\n\n")[0].replace("[flipper]", "[belt.flipper]")
        (tmp_path / "four.toml").write_text(f"{text}\n[[belt]]\n{section}angle_deg = 40.0\n{flipper}\n")
        vehicle = str(tmp_path / "four.toml")
    env = StairEnv("StairUp", vehicle=vehicle)
    env.reset(seed=0)
    assert ("flipper_rad_s" in env.scales) == (vehicle != "wheelchair-fixed")
    driven(env, 50, np.array([0.6, 0.6] + [0.0] * (len(env.scales) - 2)))


def test_threads_step_as_one_after_the_other() -> None:
    rng, alone = np.random.default_rng(0), [StairEnv("StairUp") for _ in range(3)]
    with_threads = make_vec("StairUp", 3)
    begun, _ = with_threads.reset(seed=7)
    assert np.array_equal(begun, [env.reset(seed=7 + i)[0] for i, env in enumerate(alone)])
    for _ in range(20):
        actions = rng.uniform(-1.0, 1.0, (3, 4))
        assert np.array_equal(with_threads.step(actions)[0], [env.step(a)[0] for env, a in zip(alone, actions, strict=True)])
    with_threads.close()


def test_an_ended_episode_is_followed_by_the_next_in_the_same_step() -> None:
    env = make_vec("StairUp", 2, changes={"drive.duration_s": 0.1})
    env.reset(seed=0)
    *_, late, info = [env.step(np.zeros((2, 4))) for _ in range(5)][-1]
    assert late.all()
    assert info["final_info"]["verdict"].tolist() == ["time_up"] * 2
    assert not env.step(np.zeros((2, 4)))[3].any()
    env.close()


def test_an_image_shows_the_chair_on_its_way() -> None:
    env = StairEnv("Kerb", render_mode="rgb_array")
    env.reset(seed=0)
    begun = env.render()
    driven(env, 100)
    after = env.render()
    assert begun is not None
    assert begun.shape == (360, 640, 3)
    assert not np.array_equal(begun, after)


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (np.array([0.0, np.nan, 0.0, 0.0]), r"action 1 \(right_m_s\) is nan; it must be from -1 to 1"),
        (np.array([0.0, 0.0, 1.7, 0.0]), r"action 2 \(flipper_rad_s\) is 1\.7"),
        (np.zeros(3), r"shape \(3,\); wanted \(4,\): left_m_s, right_m_s, flipper_rad_s, seat_m_s"),
        (np.float64(0.0), r"shape \(\)"),
    ],
)
def test_a_bad_action_is_named(action: np.ndarray, words: str) -> None:
    env = StairEnv("StairUp")
    env.reset(seed=0)
    with pytest.raises(SettingsError, match=words):
        env.step(action)


def test_a_closed_environment_may_be_closed_again_and_has_no_step() -> None:
    env = StairEnv("StairUp")
    env.reset(seed=0)
    env.close()
    env.close()
    with pytest.raises(SettingsError, match="call reset before step"):
        env.step(np.zeros(4))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"task": "StairUpp"}, "did you mean 'StairUp'"),
        ({"task": "StairDown", "see": "tracker", "vehicle": "blind"}, "no rear_camera"),
        ({"task": "StairUp", "see": "camera"}, "allowed: oracle, tracker"),
        ({"task": "StairUp", "physics": "exact"}, "allowed: nominal, fast"),
        ({"task": "StairUp", "friction": -1.0}, "above 0"),
        ({"task": "StairUp", "vehicle": "hoverboard"}, "hoverboard"),
    ],
)
def test_a_bad_option_is_named(options: dict, words: str, tmp_path: Path) -> None:
    if options.get("vehicle") == "blind":
        text = (CHAIRS / "wheelchair.toml").read_text()
        start = text.index("[rear_camera]")
        (tmp_path / "blind.toml").write_text(text[:start] + text[start:].partition("\n\n")[2])
        options = options | {"vehicle": str(tmp_path / "blind.toml")}
    with pytest.raises(SettingsError, match=words):
        StairEnv(**options).reset(seed=0)


def test_the_program_loads_no_gymnasium_without_the_bench() -> None:
    code = "import sys, treadline.api, treadline.cli.sweep, treadline.cli.bench; sys.exit('gymnasium' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
