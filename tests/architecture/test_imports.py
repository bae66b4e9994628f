"""Imports: no foreign private modules, no circles, and no more code loaded by a verb than its task needs."""

import ast
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest

import treadline
from treadline import cli
from treadline.hardware import robot_file
from treadline.io.live import CAMERAS

from .test_budgets import size_of

ROOT = Path(treadline.__file__).parent
FILES = {
    ".".join(("treadline", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__"): path
    for path in sorted(ROOT.rglob("*.py"))
}

CONTRACTS = tomllib.loads((ROOT.parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"]
LAYERS = next(contract["layers"] for contract in CONTRACTS if contract["type"] == "layers")
FLOORS = {package: floor for floor, layer in enumerate(reversed(LAYERS)) for package in layer.split(" | ")}
"""Floor of each package, from the ground: the layers of the import contract."""
NAMED = re.compile(r"treadline(?:\.\w+)+")


@cache
def tree_of(module: str) -> ast.Module:
    return ast.parse(FILES[module].read_text(encoding="utf-8"))


def imports(module: str) -> Iterator[str]:
    """Yield the modules of treadline that a module imports anywhere in its text, for types alone included."""
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.Import):
            yield from (item.name for item in node.names if item.name in FILES)
        elif isinstance(node, ast.ImportFrom):
            within = [f"{node.module}.{item.name}" for item in node.names]
            yield from (name if name in FILES else str(node.module) for name in within if node.module in FILES or name in FILES)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield from named(node.value)


def named(text: str) -> Iterator[str]:
    """Yield the module that a text begins with, as tables for late loading name it: ``module`` or ``module:name``."""
    found = NAMED.match(text)
    if found is not None and found.group() in FILES:
        yield found.group()


def is_private_to(package: str, module: str) -> bool:
    """Return whether a module of another package has an underscore in its path."""
    _, owner, *inner = [*module.split("."), ""]
    return owner != package and any(part.startswith("_") and not part.startswith("__") for part in inner)


@pytest.mark.parametrize("package", sorted({module.split(".")[1] for module in FILES if "." in module}))
def test_a_package_imports_no_private_module_of_another(package: str) -> None:
    foreign = [
        f"{module} imports {name}"
        for module in FILES
        if f"{module}.".startswith(f"treadline.{package}.")
        for name in imports(module)
        if is_private_to(package, name)
    ]
    assert foreign == []


def test_no_module_imports_itself_through_others() -> None:
    try:
        TopologicalSorter({module: set(imports(module)) - {module} for module in FILES}).prepare()
    except CycleError as error:
        pytest.fail(" imports ".join(error.args[1][::-1]))


def test_a_text_names_no_module_of_a_higher_floor() -> None:
    """A module that is loaded by its name, from a table, is an import as well; the package itself stands above all floors."""
    floors = {module: FLOORS[module.split(".")[1]] if "." in module else len(FLOORS) for module in FILES}
    texts = [
        (module, node.value)
        for module in FILES
        for node in ast.walk(tree_of(module))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    higher = [(module, name) for module, text in texts for name in named(text) if floors[name] > floors[module]]
    assert higher == []


def test_the_tables_of_verbs_cameras_drives_and_public_names_name_modules_that_exist() -> None:
    verbs = {f"treadline.cli.{cli.MODULES.get(verb, verb)}" for group in cli.VERBS.values() for verb in group}
    drives = {text.partition(":")[0] for text in robot_file.LINKS.values()}
    tables = [verbs, drives, {module for module, _ in CAMERAS.values()}, set(treadline._MODULE_OF.values())]
    assert [set(table) - set(FILES) for table in tables] == [set()] * 4


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a depth image, its camera, a record and the model of the record."""
    folder = tmp_path_factory.mktemp("inputs")
    cv2.imwrite(str(folder / "depth.png"), np.full((120, 160), 1500, dtype=np.uint16))
    camera = {"width": 160, "height": 120, "fx_px": 144.0, "fy_px": 144.0, "cx_px": 79.5, "cy_px": 59.5}
    (folder / "camera.toml").write_text("\n".join(f"{key} = {value}" for key, value in camera.items()))
    rng = np.random.default_rng(1)
    u, y = 0.3 * rng.normal(size=(300, 2)), np.zeros((300, 2))
    for k in range(299):
        y[k + 1] = [y[k, 0] + 0.25 * y[k, 1], 0.5 * y[k, 1] + 0.2 * (u[k, 1] - u[k, 0])]
    table = np.column_stack([0.25 * np.arange(300), u, y + 1e-3 * rng.normal(size=y.shape)])
    header = "t_s,left_m_s,right_m_s,heading_rad,yaw_rate_rad_s"
    np.savetxt(folder / "record.csv", table, delimiter=",", header=header, comments="")
    return folder


IDENTIFICATION_PAGE = tuple(
    f"report{n}" for n in ("", ".identification_page", "._model_figures", "._model_runs", ".html_pages", ".labels", ".svg_figures")
)
"""Modules of the report that draw the page of an identification."""
PLANNERS = tuple(
    name.removeprefix("treadline.")
    for name in FILES
    if name in ("treadline.plant", "treadline.plant.sensors") or name.startswith(("treadline.mission", "treadline.plant.sensors."))
)
"""Modules of the planner, and of the camera without images that a walk gives it."""
LABORATORY = {"plant", "mission", "experiments", "report", "view"}
"""Packages that no analysis of one file needs."""
SCRIPT = """
import json, sys
from treadline.cli import main
code = main(sys.argv[1:])
print(json.dumps([code, [name for name in sys.modules if name.split(".")[0] == "treadline"]]))
"""


@pytest.mark.parametrize(
    ("command", "most_lines", "allowed"),
    [
        ("see depth.png --camera camera.toml", 8700, ()),
        ("identify record.csv --method okid-era --no-page --out model.json", 7270, ()),
        ("identify record.csv --method okid-era --out paged.json", 7600, IDENTIFICATION_PAGE),
        ("tune model.json --out controller.json", 2320, ()),
        ("check paper-28", 16180, PLANNERS),
    ],
    ids=lambda value: str(value).split(" --")[0],
)
def test_a_verb_loads_what_its_task_needs(command: str, most_lines: int, allowed: tuple[str, ...], inputs: Path) -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT, *command.split()], cwd=inputs, capture_output=True, text=True, check=True)
    code, names = json.loads(done.stdout.splitlines()[-1])
    assert code in {0, 1}, done.stderr  # 1: no stair in the image
    needless = [
        name
        for name in names
        if name.count(".") and name.split(".")[1] in LABORATORY and name.removeprefix("treadline.") not in allowed
    ]
    assert needless == []
    assert sum(size_of(FILES[name].read_text(encoding="utf-8")).code_lines for name in names if name in FILES) <= most_lines


def test_the_guard_loads_neither_numpy_nor_any_package_but_core() -> None:
    """Test: the guard alone in a process. Expected result: core and itself, and no array library: it will be ported to C."""
    names = "import sys, treadline.guard; print(*{name.split('.')[0] for name in sys.modules}, *sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", names], capture_output=True, text=True, check=True).stdout.split()
    assert not {"numpy", "scipy", "jaxtyping", "numba"} & set(loaded)
    ours = {name.split(".")[1] for name in loaded if name.startswith("treadline.")}
    assert ours == {"core", "guard"}


@pytest.mark.parametrize(
    ("name", "successor"),
    [
        ("treadline.models", "treadline.core.models"),
        ("treadline.sim", "treadline.plant.mujoco"),
        ("treadline.ros.zenoh", "treadline_ros2"),
        ("treadline.core.model_methods", "treadline.core.models.LinearModel"),
    ],
)
def test_a_module_that_left_is_an_import_error_that_names_its_successor(name: str, successor: str) -> None:
    with pytest.raises(ImportError, match=rf"{name} left with treadline 0\.4; use .*{successor}"):
        import_module(name)
    with pytest.raises(ModuleNotFoundError, match=r"treadline\.modles"):
        import_module("treadline.modles")
