"""``treadline model``: a file that its reader can load, and one line for what cannot be written."""

# ruff: noqa: S314 - the files are ours
from pathlib import Path
from xml.etree.ElementTree import parse

import mujoco
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


def test_the_mjcf_scene_runs_in_plain_mujoco(run, tmp_path: Path) -> None:
    out, scenario = tmp_path / "scene.xml", tmp_path / "flight.toml"
    scenario.write_text('[chair]\nmodel = "rescue"\npayload_kg = 2\n[start]\nplace = "flight"\nstep = 5\n')
    assert run("model", scenario, "--to", "mjcf", "--out", out).code == 0
    model = mujoco.MjModel.from_xml_path(str(out))
    data = mujoco.MjData(model)
    before = data.body("chair").xpos.copy()
    mujoco.mj_forward(model, data)
    before = data.body("chair").xpos.copy()
    for _ in range(500):
        mujoco.mj_step(model, data)
    # It settles on its nosings and stays: a second later within 2 cm, most of it down onto the nosings' rubber.
    assert abs(data.body("chair").xpos - before).max() < 0.02


def test_the_same_seed_gives_the_same_bytes_and_another_another_stair(run, tmp_path: Path) -> None:
    scenario = tmp_path / "worn.toml"
    scenario.write_text("[stair]\nrise_jitter_m = 0.004\n")
    texts = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert run("model", scenario, "--to", "sdf", "--out", tmp_path / name, "--seed", seed).code == 0
        texts.append((tmp_path / name).read_bytes())
    assert texts[0] == texts[1] != texts[2]


def test_model_writes_the_meshes_next_to_the_urdf_and_mujoco_reads_them(run, tmp_path: Path) -> None:
    out = tmp_path / "chair.urdf"
    assert run("model", "paper-28", "--to", "urdf", "--out", out).code == 0
    files = sorted(path.name for path in (tmp_path / "chair_meshes").iterdir())
    named = sorted(Path(mesh.get("filename")).name for mesh in parse(out).getroot().iter("mesh"))
    assert files == named
    ending = (
        '<mujoco><compiler fusestatic="false" inertiafromgeom="false" discardvisual="false" strippath="false"/></mujoco></robot>'
    )
    text = out.read_text().replace("</robot>", ending)
    assets = {f"chair_meshes/{name}": (tmp_path / "chair_meshes" / name).read_bytes() for name in files}
    model = mujoco.MjModel.from_xml_string(text, assets)
    assert model.nmesh == len(files)
    assert run("model", "paper-28", "--to", "urdf", "--out", tmp_path / "b.urdf", "--mesh-url", "package://chair/m/").code == 0
    assert 'filename="package://chair/m/frame.stl"' in (tmp_path / "b.urdf").read_text()
