"""Former module names that documents named, kept for one release: importing one warns and gives the module at its present place.

The only forwarding module. ``treadline.models`` is ``treadline.core.models`` since version 0.3; the names leave with version 0.4.
"""

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

PLACES = {
    "angles": "core.angles",
    "camera_file": "scenario.camera_file",
    "chair_files": "scenario.shipped_files",
    "controller_files": "scenario.shipped_files",
    "errors": "core.errors",
    "models": "core.models",
    "paper": "core.paper",
    "ports": "core.ports",
    "settings": "core.settings",
    "setting_docs": "core.setting_docs",
    "signals": "core.signals",
    "control.allocate": "control.belt_allocation",
    "control.export": "control.c_export",
    "control.heading": "control.heading_controller",
    "control.seat": "control.seat_leveller",
    "devices": "plant.sensors",
    "estimation.filter": "estimation.heading_filter",
    "experiments.excite": "run.excitation_run",
    "experiments.traverse": "run.episode",
    "frames": "io.frames",
    "frames.evaluation": "io.frames.evaluation",
    "frames.point_cloud": "io.frames.point_cloud",
    "frames.sources": "io.frames.sources",
    "gazebo": "plant.gazebo",
    "identification.excitation": "identification.excitation_signal",
    "identification.report": "identification._identified",
    "identification.validate": "core.linear_systems",
    "mechanics": "vehicle",
    "mechanics.chair": "scenario.chair",
    "mechanics.quasi_static": "vehicle.quasi_static",
    "mechanics.stability": "vehicle.static_stability",
    "mechanics.staircase": "vehicle.staircase",
    "mechanics.tracks": "vehicle.tracks",
    "mechanics.verdict": "vehicle.verdict",
    "mission.config": "mission.mission_config",
    "mission.guard": "guard",
    "mission.guard.guard": "guard.guard",
    "nodes": "ros",
    "nodes.assembly": "ros.assembly",
    "nodes.channels": "ros.channels",
    "nodes.plant": "ros.plant_node",
    "nodes.process": "ros.node_process",
    "nodes.wire": "ros.wire",
    "perception.frame_evaluation": "io.frames.evaluation",
    "playback.moments": "playback",
    "setup": "run.resolve",
    "sim": "plant.mujoco",
    "sim.camera": "plant.sensors.camera",
    "sim.plant": "plant.mujoco.mujoco_plant",
}
"""Present place of each former module name, both within ``treadline``."""
FURTHER = {"angles": "core.rotations", "mission.config": "mission.mission_blocks", "signals": "core.camera_images"}
"""Further place of a module that was split: what the present place lacks is found there."""


class _FormerNames(MetaPathFinder, Loader):
    """Finder of the former module names.

    It is asked first: a former package has the path of its present place, where the usual finder would load each module twice.
    """

    def find_spec(self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Return a specification for a former name; None for any other."""
        del path, target
        package, _, name = fullname.partition(".")
        if package != "treadline" or name not in PLACES:
            return None
        return ModuleSpec(fullname, self, is_package=any(other.startswith(f"{name}.") for other in PLACES))

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return the module at its present place, after a warning that names the place; a split module is both parts in one."""
        name = spec.name.partition(".")[2]
        place = f"treadline.{PLACES[name]}"
        warnings.warn(f"{spec.name} is {place} since version 0.3; the old name leaves with 0.4", DeprecationWarning, stacklevel=2)
        module = import_module(place)
        if name in FURTHER:
            both = ModuleType(spec.name)
            vars(both).update(vars(import_module(f"treadline.{FURTHER[name]}")) | vars(module))
            module = both
        self._own = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Leave the module as its own loader made it."""
        module.__spec__ = self._own


def install() -> None:
    """Add the former names to the import system, once."""
    if not any(isinstance(finder, _FormerNames) for finder in sys.meta_path):
        sys.meta_path.insert(0, _FormerNames())
