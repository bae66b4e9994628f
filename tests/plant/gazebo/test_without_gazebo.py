"""What needs no Gazebo: the world that is written, and one line for each way in which gzserver lets one down."""

import math
import sys
import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest

from treadline.core.camera_images import RgbdFrame
from treadline.core.errors import GazeboError, SettingsError
from treadline.core.rotations import rotation_of
from treadline.experiments.gazebo import compared
from treadline.plant.gazebo import Environment, GazeboPlant, find_environment
from treadline.plant.gazebo import _gzserver as server
from treadline.plant.mujoco import open_plant as open_mujoco
from treadline.plant.sensors._instruments import ChairState
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Control, Realism, Scenario, Sensors, Start
from treadline.vehicle.film_camera import SIZE_PX
from treadline.vehicle.sdf import Lockstep, film_meshes, sdf_world
from treadline.vehicle.staircase import build_staircase
from treadline.vehicle.start_pose import standing

SCENARIO = Scenario(start=Start(place="flight", step=4, heading_deg=10.0), control=Control(vision="truth"))


GREETING = "import socket, struct, sys\n" + textwrap.dedent("""
    port = int(open(sys.argv[-1]).read())
    listener = socket.create_server(("127.0.0.1", port))
    client = listener.accept()[0]
    client.sendall(struct.pack("<4d", {protocol}, {major}, 8, 22))
""")


class Impostor(Environment):
    """An environment whose gzserver is a Python script; the world it gets is the port alone."""

    script: str

    def command(self, *words: str) -> list[str]:
        return [sys.executable, "-c", Impostor.script, *words[:-1], str(self.root / words[-1].lstrip("/"))]


@pytest.fixture
def launched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., server.GazeboServer]:
    """Return what starts a script in gzserver's place."""
    monkeypatch.setattr(server, "START_S", 10.0)

    def launch(script: str, files: Mapping[str, bytes] | None = None) -> server.GazeboServer:
        Impostor.script = script
        return server.GazeboServer(Impostor(root=tmp_path), lambda port, _: str(port), files or {})

    return launch


def test_the_world_holds_the_chair_whole_and_the_plugin_that_drives_it() -> None:
    chair = read_chair("wheelchair")
    staircase = build_staircase(SCENARIO.stair, np.random.default_rng(0))
    start = standing(staircase, chair.tracks, SCENARIO.start)
    text = sdf_world(staircase, chair, SCENARIO.chair, start=start, lockstep=Lockstep(plugin="/p.so", port=1234))
    world = fromstring(text).find("world")  # noqa: S314 - our own
    model = next(model for model in world.iter("model") if model.get("name") == "wheelchair")
    assert {link.get("name") for link in model.iter("link")} == {"chair", "seat", "flipper"}
    belts = {shape.get("name") for shape in model.iter("collision")}
    assert {name.split("_")[0] for name in belts if name} == {"left", "right"}
    plugin = model.find("plugin")
    assert (plugin.get("filename"), plugin.findtext("port")) == ("/p.so", "1234")
    assert float(plugin.findtext("seat_start") or "nan") == pytest.approx(math.atan2(0.16, 0.30))
    assert float(plugin.findtext("flipper_start") or "nan") == pytest.approx(math.radians(40.0))


def test_a_filmed_world_names_each_mesh_that_is_written_and_a_camera() -> None:
    chair = read_chair("wheelchair")
    staircase = build_staircase(SCENARIO.stair, np.random.default_rng(0))
    start = standing(staircase, chair.tracks, SCENARIO.start)
    lockstep = Lockstep(plugin="/p.so", port=1234, film="/run")
    world = fromstring(sdf_world(staircase, chair, SCENARIO.chair, start=start, lockstep=lockstep))  # noqa: S314 - our own
    files = {uri.text.removeprefix("file:///run/") for uri in world.iter("uri") if uri.text}
    assert files == set(film_meshes(staircase, chair, SCENARIO.chair))
    camera = next(world.iter("camera"))
    assert (camera.findtext("image/width"), camera.findtext("image/height")) == tuple(map(str, SIZE_PX))


def test_without_a_display_for_the_camera_the_error_says_so(
    launched: Callable[..., server.GazeboServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Test: Xvfb ends without a display; it hangs. Expected result: one line, after the timeout at the latest."""
    monkeypatch.setattr(server, "START_S", 3.0)
    for end in ("", "; time.sleep(60.0)"):
        with pytest.raises(GazeboError, match=r"Xvfb does not start, which Gazebo's camera needs: no screen; build it"):
            launched(f"import sys, time; print('no screen', file=sys.stderr, flush=True){end}", {"hull.stl": b""})


def test_an_order_is_answered_by_the_state(launched: Callable[..., server.GazeboServer]) -> None:
    echo = "while order := client.recv(64):\n    client.sendall(order + struct.pack('<14d', *range(14)))\n"
    gazebo = launched(GREETING.format(protocol=1, major=11) + echo)
    order = np.arange(8.0)
    assert np.hstack(gazebo.step(order).item()).tolist() == [*range(8), *range(14)]
    gazebo.close()


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("print('[Err] no such world'); raise SystemExit(3)", "ended before the chair was in it: .*no such world"),
        (
            "import time; print('[Err] Failed to load plugin libx.so: libgazebo.so.9', flush=True); time.sleep(9)",
            "libgazebo.so.9; build it",
        ),
        (
            GREETING.format(protocol=7, major=11) + "client.recv(1)",
            "protocol 7 of Gazebo 11, this program 1 .*; build it",
        ),
        (GREETING.format(protocol=1, major=9) + "client.recv(1)", "protocol 1 of Gazebo 9, .* of Gazebo 11; build it"),
        ("print('[Err] bind: Address already in use'); raise SystemExit(1)", "a port is taken"),
    ],
    ids=["a world it cannot load", "a plugin it cannot load", "another protocol", "another Gazebo", "a port taken, three times"],
)
def test_a_server_that_does_not_come_up_says_why_in_a_line(
    launched: Callable[..., server.GazeboServer], script: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(GazeboError, match=message) as raised:
        launched(script)
    assert "\n" not in str(raised.value)
    assert not list((tmp_path / "tmp").iterdir())


def test_a_server_that_dies_is_distinguished_from_an_answer(launched: Callable[..., server.GazeboServer]) -> None:
    gazebo = launched(GREETING.format(protocol=1, major=11) + "client.recv(64); raise SystemExit('[Err] a joint broke')")
    with pytest.raises(GazeboError, match=r"gzserver died \(exit code 1\): .*a joint broke; run it again"):
        gazebo.step(np.zeros(8))
    gazebo.close()


def test_without_an_environment_it_is_said_how_to_get_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TREADLINE_GAZEBO", str(tmp_path))
    plugin = "opt/treadline/build/libtreadline_lockstep"
    for file in ("usr/bin/gzserver", f"{plugin}.so", f"{plugin}_no_turn_rule.so"):
        said = f"root/{file} is missing" if plugin in file else "no Gazebo 11 in .*root"
        with pytest.raises(GazeboError, match=f"{said}; build it with legacy/gazebo/environment.sh"):
            find_environment()
        (tmp_path / "root" / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "root" / file).touch()
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    with pytest.raises(GazeboError, match="only root may enter"):
        find_environment()
    monkeypatch.setattr("os.geteuid", lambda: 0)
    monkeypatch.setattr("shutil.which", lambda _: None)
    with pytest.raises(GazeboError, match="no chroot on this system"):
        find_environment()


def test_two_simulators_are_compared_row_by_row() -> None:
    def figures(turns: list[float | None], straight: float) -> dict[str, list[dict[str, object]]]:
        rows = [{"loop": "closed", "rms_heading_deg": straight}, {"loop": "open", "rms_heading_deg": 9.0}]
        return {"table2": [{"rms_heading_deg": value} for value in turns], "fig09": rows}

    # A row whose runs ended early in one simulator enters neither mean.
    found = compared(figures([3.0, 4.0, None, 9.0], 0.2), figures([3.5, 3.2, 9.0, None], 0.1))
    assert found["table2_mean_deg"] == pytest.approx({"gazebo": 3.5, "mujoco": 3.35})
    assert found["table2_largest_gap_deg"] == pytest.approx(0.8)
    assert found["straight_closed_worst_rms_deg"] == {"gazebo": 0.2, "mujoco": 0.1}


def test_frames_are_those_that_the_other_simulator_would_draw_of_a_chair_there(tmp_path: Path) -> None:
    prompt = Realism(camera_latency_s=0.0, camera_jitter_s=0.0, camera_drop_rate=0.0)
    scenario = Scenario(start=Start(place="flight", step=4), sensors=Sensors(camera="kinect1"), realism=prompt)
    other, chair = open_mujoco(scenario, 3), read_chair("wheelchair")
    other.start()
    there = ChairState(
        tick=0,
        p_WB=other._data.qpos[:3].copy(),
        R_WB=rotation_of(other._data.qpos[3:7]),
        velocity_W=np.zeros(3),
        rate_B=np.zeros(3),
        seat_rad=0.0,
        stroke_m=0.0,
        belts_m_s=np.zeros(2),
        brake_on=True,
        flipper_rad=0.0,
        flipper_torque_n_m=0.0,
        reach_m=np.zeros(4),
    )
    plant = GazeboPlant(scenario, 3, chair, Environment(root=tmp_path))
    (ours,) = [reading for reading in plant._instruments.read(there, 1.0)[0] if isinstance(reading, RgbdFrame)]
    (theirs,) = [reading for reading in other.read() if isinstance(reading, RgbdFrame)]
    np.testing.assert_array_equal(ours.depth_m, theirs.depth_m)
    np.testing.assert_array_equal(ours.rgb, theirs.rgb)


@pytest.mark.parametrize(
    ("tables", "remedy"),
    [
        ({"chair": {"sway_m": (0.1, 0.0)}}, "use --plant mujoco"),
        ({"step": [{"index": 1, "friction": (0.3, 0.3)}]}, "use --plant mujoco"),
        ({"stair": {"floor_friction": (0.3, 0.3)}}, "use --plant mujoco"),
        ({"belts": {"lug": "15/80"}}, r"smooth belts of its own stiffness; leave out \[belts\]"),
    ],
)
def test_what_gazebo_would_ignore_is_refused(tables: dict[str, Any], remedy: str, tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=remedy):
        GazeboPlant(Scenario.model_validate(tables), 0, read_chair("wheelchair"), Environment(root=tmp_path))
