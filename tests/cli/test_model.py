"""``treadline model``: a file that its reader can load, and one line for what cannot be written."""

# ruff: noqa: S314 - the files are ours
from pathlib import Path
from xml.etree.ElementTree import parse

import pytest


@pytest.mark.parametrize("target", ["mjcf", "urdf", "sdf"])
@pytest.mark.parametrize("options", [[], ["--chair-only"]])
def test_model_writes_a_file_and_says_what_it_weighs(run, tmp_path: Path, target: str, options: list[str]) -> None:
    out = tmp_path / f"chair.{target}"
    outcome = run("model", "paper-28", "--to", target, "--out", out, "--json", *options)
    assert outcome.code == 0, outcome.err
    # Table I: 23.4 kg and 50 kg; the flipper of 3 kg and the seat's shell of 0.5 kg are ours.
    assert outcome.values["mass_kg"] == pytest.approx(76.9)
    assert outcome.values["path"] == str(out)
    has_stair = target != "urdf" and not options
    assert outcome.values["stair"] is has_stair
    assert ("stair" in out.read_text()) is (has_stair or target == "mjcf")  # MJCF has a class of that name
    root = parse(out).getroot()
    assert root.tag == {"mjcf": "mujoco", "urdf": "robot", "sdf": "sdf"}[target]


def test_the_same_seed_gives_the_same_bytes_and_another_another_stair(run, tmp_path: Path) -> None:
    scenario = tmp_path / "worn.toml"
    scenario.write_text("[stair]\nrise_jitter_m = 0.004\n")
    texts = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert run("model", scenario, "--to", "sdf", "--out", tmp_path / name, "--seed", seed).code == 0
        texts.append((tmp_path / name).read_bytes())
    assert texts[0] == texts[1] != texts[2]


def test_model_writes_the_meshes_next_to_the_urdf(run, tmp_path: Path) -> None:
    out = tmp_path / "chair.urdf"
    for options, folder in (((), "chair_meshes"), (("--mesh-url", "package://chair/m/", "--force"), "package://chair/m")):
        assert run("model", "paper-28", "--to", "urdf", "--out", out, *options).code == 0
        named = {mesh.get("filename") for mesh in parse(out).getroot().iter("mesh")}
        assert named == {f"{folder}/{path.name}" for path in (tmp_path / "chair_meshes").iterdir()}
