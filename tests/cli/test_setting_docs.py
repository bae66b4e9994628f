"""``treadline check --keys``: all that a scenario can say, from what it is checked by."""

import tomllib

from treadline.scenario.scenario import Scenario, StepOverride, read_scenario, scenario_of, shipped_scenarios


def test_what_is_listed_is_a_scenario_of_defaults_and_a_fault_as_listed_is_one(run, tmp_path) -> None:
    outcome = run("check", "--keys")
    assert outcome.code == 0
    path = tmp_path / "mine.toml"
    path.write_text(outcome.out)
    assert read_scenario(path) == Scenario()
    assert set(tomllib.loads(outcome.out)) == set(Scenario.model_fields) - {"fault", "step", "sill", "operator", "flight"}
    lines = outcome.out.splitlines()
    assert all(name in lines[0] for name in shipped_scenarios())
    after = lines[next(k for k, line in enumerate(lines) if line.startswith("# [[fault]]")) + 1 :]
    given = [line.removeprefix("# ") for line in after if " = " in line.partition("#   ")[0]]
    text = "\n".join(["[[fault]]", 'kind = "imu_lost"', *given])
    (fault,) = scenario_of(tomllib.loads(text), path, where="here").fault
    assert fault.for_s == 3.0


def test_each_key_is_listed_with_unit_range_default_and_meaning(run) -> None:
    values = run("check", "--keys", "--json").values
    keys = values["keys"]
    assert {f"step.{name}" for name in StepOverride.model_fields} < set(keys)
    assert keys["stair.between_m"] == {
        "default": 2.5,
        "allowed": "a number from 0.5 to 20 [m]",
        "meaning": "Depth of the landing between two flights, from the nosing of one to the first nosing of the next.",
    }
    assert keys["stair.slope_deg"]["default"] is keys["fault.kind"]["default"] is None
    assert values["scenarios"] == sorted(shipped_scenarios())
