"""The package for Nav2: its nodes compile and work on a stub of Nav2's classes, and its files agree with each other."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest

import treadline

PACKAGE = Path(__file__).parents[2] / "ros2" / "treadline_nav2"
ACTION = Path(treadline.__file__).parent / "data" / "treadline_msgs" / "action" / "TraverseStair.action"


def fields_of(text: str) -> dict[str, str]:
    """Return the types of the fields of a part of an action, by name; constants are left out."""
    lines = [line.split("#")[0].split() for line in text.splitlines()]
    return {line[1]: line[0] for line in lines if len(line) == 2 and "=" not in line[1]}


@pytest.fixture(scope="module")
def ports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, set[str]]:
    """Ports of each node, as the compiled nodes say them."""
    compiler = shutil.which("c++") or shutil.which("g++")
    if compiler is None:
        pytest.skip("no C++ compiler on the path")
    program = tmp_path_factory.mktemp("nav2") / "nodes"
    sources = [*sorted((PACKAGE / "src").glob("*.cpp")), PACKAGE / "test" / "nodes.cpp"]
    includes = [f"-I{PACKAGE / folder}" for folder in ("include", "test/stub")]
    flags = ["-std=c++17", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, *flags, *includes, *map(str, sources), "-o", str(program)], check=True)
    said = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    found: dict[str, set[str]] = {}
    for node, port in map(str.split, said.splitlines()):
        found.setdefault(node, set()).add(port)
    return found


def test_each_port_of_the_tree_is_a_port_of_its_node(ports: dict[str, set[str]]) -> None:
    tree = ET.parse(PACKAGE / "behavior_trees" / "two_floors.xml").getroot()  # noqa: S314 - our own file
    used = {node.tag: set(node.attrib) - {"server_name", "service_name"} for node in tree.iter() if node.tag in ports}
    assert used.keys() == {"TraverseStair", "ChangeFloor"}
    assert all(used[name] <= ports[name] for name in used)
    order = [node.tag for node in tree.iter("Sequence").__next__()]
    assert order.index("ChangeFloor") == order.index("TraverseStair") + 1


def test_the_stub_of_the_action_has_fields_of_the_action() -> None:
    stub = (PACKAGE / "test" / "stub" / "treadline_msgs" / "action" / "traverse_stair.hpp").read_text()
    goal, result, _ = map(fields_of, ACTION.read_text().split("---\n"))
    for name, known in (("Goal", goal), ("Result", result)):
        lines = [line.split() for line in stub.split(f"struct {name}\n")[1].split("};")[0].splitlines()]
        members = {line[1].rstrip(";") for line in lines if len(line) > 1 and line[0] != "static"}
        assert members <= known.keys(), name
    assert "lease_s" in goal


def cheapest(graph: dict[str, Any], start: int, goal: int) -> list[dict[str, Any]]:
    """Return the edges of the cheapest route of a route graph (Dijkstra)."""
    edges = [item["properties"] for item in graph["features"] if "startid" in item["properties"]]
    best: dict[int, tuple[float, list[dict[str, Any]]]] = {start: (0.0, [])}
    waiting = {start}
    while waiting:
        at = min(waiting, key=lambda node: best[node][0])
        waiting.remove(at)
        cost, way = best[at]
        for edge in edges:
            there, more = edge["endid"], cost + edge["cost"]
            if edge["startid"] == at and more < best.get(there, (float("inf"), []))[0]:
                best[there] = more, [*way, edge]
                waiting.add(there)
    return best[goal][1]


def test_the_route_graph_leads_over_the_stair_by_an_edge_that_names_it() -> None:
    graph = json.loads((PACKAGE / "graphs" / "two_floors.geojson").read_text())
    kinds = [edge["metadata"] for edge in cheapest(graph, 0, 3)]
    assert [kind["type"] for kind in kinds] == ["floor", "stair", "floor"]
    goal, *_ = map(fields_of, ACTION.read_text().split("---\n"))
    assert {"stair_id", "direction", "steps", "step_rise_m"} <= kinds[1].keys() & goal.keys()


def test_the_packages_manifest_names_what_cmake_looks_for() -> None:
    manifest = ET.parse(PACKAGE / "package.xml").getroot()  # noqa: S314 - our own file
    cmake = (PACKAGE / "CMakeLists.txt").read_text()
    wanted = cmake.split("set(PACKAGES ")[1].split(")")[0].split()
    assert {item.text for item in manifest.findall("depend")} == set(wanted)
    assert manifest.findtext("version") == treadline.__version__
