"""Stair climbing for tracked chairs: simulate, detect, identify, control and level.

``import treadline as tl`` imports nothing heavy: each function below is loaded when it is first used.

* ``tl.scenarios()``: names of the shipped scenarios, and a line about each.
* ``tl.read_scenario(name, set={"stair.slope_deg": 30})``: ``tl.Scenario`` of a file or a name, with changes.
* ``tl.check(scenario, set=...)``: mechanical feasibility of a scenario.
* ``tl.climb(scenario, controller=None, seed=0, set=...)``: one simulated traversal, a ``tl.Run``.
* ``tl.read_frames(path)``: frames of a depth image, a point cloud, a folder, or a log.
* ``tl.frame_of_points(points)``: frame of an array of points, or of scans that add up in odometry.
* ``tl.detect_stair(frame)``: heading and geometry of the stair in one frame, or in a depth image with its camera.
* ``tl.identify(u, y, dt)``: linear model of arrays, data frames or logs, ``tl.Identified``, with ``tl.IdentificationOptions``.
* ``tl.load_model(path)``: ``tl.LinearModel`` from a file.
* ``tl.tune(model)``: LQR gain and observer of a model, which ``tl.climb`` takes.
"""

from treadline.core import aliases as _aliases

__version__ = "0.3.0"
_MODULE_OF = {
    "IdentificationOptions": "treadline.identification.options",
    "Identified": "treadline.identification",
    "LinearModel": "treadline.core.models",
    "Run": "treadline.api",
    "Scenario": "treadline.scenario",
    "check": "treadline.api",
    "climb": "treadline.api",
    "detect_stair": "treadline.api",
    "frame_of_points": "treadline.io.frames",
    "identify": "treadline.api",
    "load_model": "treadline.api",
    "read_frames": "treadline.io.frames",
    "read_scenario": "treadline.api",
    "scenarios": "treadline.api",
    "tune": "treadline.api",
}
"""Module of each public name. Named by text, so that importing the package, or one of its blocks, loads none of them."""
__all__ = [*_MODULE_OF, "__version__"]  # noqa: PLE0604 - names are text


_aliases.install()


def __getattr__(name: str) -> object:
    """Return a public name, loaded at its first use (PEP 562)."""
    from importlib import import_module

    if name not in _MODULE_OF:
        raise AttributeError(f"module 'treadline' has no attribute '{name}'")
    value: object = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
