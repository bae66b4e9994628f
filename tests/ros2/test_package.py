"""The ament package: it builds, its linters find nothing, and its files agree with each other."""

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

import treadline
from treadline.ros.assembly import DRIVING

PACKAGE = Path(__file__).parents[2] / "ros2" / "treadline_ros2"


@pytest.mark.parametrize("linter", ["ament_flake8", "ament_pep257"])
def test_ros_linters_find_nothing(linter: str) -> None:
    done = subprocess.run([linter, str(PACKAGE)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_colcon_builds_it(tmp_path: Path) -> None:
    """Test: ``colcon build`` in an empty workspace. Expected result: what ``ros2 run`` calls, and all shared files."""
    command = ["colcon", "build", "--base-paths", str(PACKAGE), "--install-base", "install", "--build-base", "build"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    installed = tmp_path / "install" / "treadline_ros2"
    assert (installed / "lib" / "treadline_ros2" / "node").exists()
    share = installed / "share" / "treadline_ros2"
    for folder in ("launch", "rviz"):
        assert {file.name for file in (share / folder).iterdir()} == {file.name for file in (PACKAGE / folder).iterdir()}


def test_the_package_names_what_it_imports() -> None:
    manifest = ET.parse(PACKAGE / "package.xml").getroot()  # noqa: S314 - our own file
    named = {item.text for kind in ("depend", "exec_depend") for item in manifest.findall(kind)}
    ours = {"treadline", "treadline_ros2", *sys.stdlib_module_names}
    for source in (PACKAGE / "treadline_ros2").glob("*.py"):
        words = [line.split() for line in source.read_text().splitlines()]
        imported = {row[1].split(".")[0] for row in words if len(row) > 1 and row[0] in ("import", "from")}
        assert imported - ours <= named, source
    assert manifest.findtext("version") == treadline.__version__


def test_the_launch_file_starts_every_node_and_its_clock_follows_the_plant() -> None:
    launch = ET.parse(PACKAGE / "launch" / "graph.launch.xml").getroot()  # noqa: S314 - our own file
    arguments = {item.get("name"): item.get("default") for item in launch.findall("arg")}
    assert {"pace", "seed", "controller", "scenario", "use_sim_time", "namespace"} <= set(arguments)
    assert arguments["use_sim_time"] == "$(var plant)"
    nodes = [node.get("name") for node in launch.iter("node") if node.get("pkg") == "treadline_ros2"]
    assert tuple(nodes) == DRIVING
