"""Stair climbing for tracked chairs: simulate, detect, identify, control and level.

``import treadline as tl`` imports nothing heavy: each function below is loaded when it is first used.

* ``tl.scenarios()``: names of the shipped scenarios, and a line about each.
* ``tl.read_scenario(name, set={"stair.slope_deg": 30})``: ``tl.Scenario`` of a file or a name, with changes.
* ``tl.check(scenario, set=...)``: mechanical feasibility of a scenario; a refusal is false.
* ``tl.climb(scenario, controller=None, seed=0, set=...)``: one simulated traversal, a ``tl.Run``: save, report, view, plot.
* ``tl.sweep(spec, runs, out=...)``: many traversals, sampled from distributions, a ``tl.Sweep``.
* ``tl.read_frames(path)``: frames of a depth image, a point cloud, an elevation map, a folder, or a log.
* ``tl.frame_of_points(points)``: frame of an array of points of one view.
* ``tl.detect_stair(frame)``: heading and geometry of the stair in one frame, or in a depth image with its camera.
* ``tl.detect_ground(frame)``: kerbs, drops and obstacles on the ground ahead.
* ``tl.identify(u, y, dt)``: linear model of arrays, data frames or logs, ``tl.Identified``, with ``tl.IdentificationOptions``.
* ``tl.load_model(path)``: ``tl.LinearModel`` from a file.
* ``tl.tune(model)``: LQR gain and observer of a model, which ``tl.climb`` takes.
* ``tl.export(controller, out)``: a controller as C99 or JSON.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from treadline.core.printing import Plottable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__version__ = "0.4.0"
_MODULE_OF = {
    "IdentificationOptions": "treadline.identification.options",
    "Identified": "treadline.identification",
    "LinearModel": "treadline.core.models",
    "Run": "treadline.api",
    "Scenario": "treadline.scenario",
    "Sweep": "treadline.sweeps",
    "check": "treadline.api",
    "climb": "treadline.api",
    "detect_ground": "treadline.io.frames.single_frame",
    "detect_stair": "treadline.io.frames.single_frame",
    "export": "treadline.control.c_export",
    "frame_of_points": "treadline.io.frames",
    "identify": "treadline.api",
    "load_model": "treadline.api",
    "read_frames": "treadline.io.frames",
    "read_scenario": "treadline.api",
    "scenarios": "treadline.api",
    "sweep": "treadline.sweeps",
    "tune": "treadline.api",
}
"""Module of each public name. Named by text, so that importing the package, or one of its blocks, loads none of them."""
__all__ = [*_MODULE_OF, "__version__"]  # noqa: PLE0604 - names are text


GONE = {
    "treadline compare": "treadline identify MODEL... --on LOG",
    "treadline mount": "mount_yaw_deg in the camera file; pitch and roll are corrected while driving",
    "--transport zenoh": "ros2 launch treadline_ros2 graph.launch.xml; in one process: treadline nodes without --transport",
    "treadline.core.model_methods": "treadline.core.models.LinearModel, which has the methods",
    "treadline.errors": "treadline.core.errors",
    "treadline.frames": "treadline.io.frames",
    "treadline.models": "treadline.core.models",
    "treadline.nodes": "treadline.ros",
    "treadline.ros.zenoh": "the ROS 2 package treadline_ros2",
    "treadline.vehicle.static_stability": "RestChair.least_margins in treadline.vehicle.rest_poses; treadline.vehicle.bodies",
    "treadline.signals": "treadline.core.signals or treadline.core.camera_images",
    "treadline.sim": "treadline.plant.mujoco",
}
"""Verbs, options and modules that left with version 0.4, and what to use instead; this table leaves with 0.5."""


def gone(*names: str) -> str | None:
    """Return the answer to the first of some names that left; None if none did."""
    return next((f"{name} left with treadline 0.4; use {GONE[name]}" for name in names if name in GONE), None)


class _GoneModules:
    """Finder that is asked last: importing a module that left is an error that names its successor."""

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> None:
        """Raise for a module that left.

        Raises:
            ImportError: Always for these modules.
        """
        del path, target
        if left := gone(fullname):
            raise ImportError(left, name=fullname)


def _draw(item: Any) -> "Figure":
    """Return the figure of a result; the report, which draws, is loaded at the first one."""
    from treadline.report.model_plots import figure_of

    return figure_of(item)


sys.meta_path.append(_GoneModules())
Plottable.drawer = _draw


def __getattr__(name: str) -> object:
    """Return a public name, loaded at its first use (PEP 562)."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'treadline' has no attribute '{name}'")
    value: object = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
