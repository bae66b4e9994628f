"""URDF with meshes: every file it names is written, readable and the size of its part; masses are those of the plain URDF."""

# ruff: noqa: S314 - the files are ours
from xml.etree.ElementTree import fromstring

import pytest

from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair
from treadline.vehicle.appearance import LINKAGE_BODIES, chair_parts, resting_lugs
from treadline.vehicle.urdf import drawn_urdf, urdf

CHAIRS = ("wheelchair", "wheelchair-fixed", "rescue")


@pytest.mark.parametrize("name", CHAIRS)
def test_each_visual_names_a_file_and_each_part_is_drawn_on_its_link(name: str) -> None:
    chair, loading = read_chair(name), Chair(model=name, payload_kg=5.0)
    text, files = drawn_urdf(chair, loading, None, "meshes/")
    robot = fromstring(text)
    named = {mesh.get("filename") for mesh in robot.iter("mesh")}
    assert named == {f"meshes/{file}" for file in files}
    parts = {part.name: part for part in (*chair_parts(chair, loading), *resting_lugs(chair)) if part.body not in LINKAGE_BODIES}
    on = {visual.get("name"): link.get("name") for link in robot.findall("link") for visual in link.findall("visual")}
    assert on == {part.name: part.body for part in parts.values()}
    for part in parts.values():
        data = files[f"{part.name}.stl"]
        assert len(data) == 84 + 50 * len(part.faces) == 84 + 50 * int.from_bytes(data[80:84], "little")


@pytest.mark.parametrize("name", CHAIRS)
def test_meshes_change_neither_links_nor_masses_nor_collisions(name: str) -> None:
    chair, loading = read_chair(name), Chair(model=name, payload_kg=5.0)
    plain, drawn = fromstring(urdf(chair, loading)), fromstring(drawn_urdf(chair, loading, None, "")[0])
    for robot in (plain, drawn):
        for link in robot.findall("link"):
            for visual in link.findall("visual"):
                link.remove(visual)
    texts = [[[(e.tag, e.attrib) for e in child.iter()] for child in robot] for robot in (plain, drawn)]
    assert texts[0] == texts[1]
