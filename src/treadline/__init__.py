"""Stair climbing for tracked chairs: simulate, detect, identify, control and level.

``import treadline as tl`` imports nothing heavy: each function below is loaded when it is first used.

* ``tl.identify(u, y, dt)``: linear model of recorded inputs and outputs.
* ``tl.IdentificationOptions(order=2, ...)``: options of an identification.
* ``tl.load_model(path)``: model from a file.
* ``tl.tune(model)``: LQR gain and observer of a model.
* ``tl.check(scenario)``: mechanical feasibility of a scenario.
* ``tl.climb(scenario, controller=None, seed=0)``: one simulated traversal.
* ``tl.detect_stair(depth_m, camera, gravity=None)``: heading and geometry of the stair in one depth image.
* ``tl.read_frames(path)``: frames of a depth image, a point cloud, a folder, or a log.
"""

from importlib import import_module
from typing import Any

from treadline.core import aliases

__version__ = "0.3.0"
__all__ = [
    "IdentificationOptions",
    "__version__",
    "check",
    "climb",
    "detect_stair",
    "identify",
    "load_model",
    "read_frames",
    "tune",
]

_MODULE_OF = dict.fromkeys(__all__, "treadline.api") | {
    "IdentificationOptions": "treadline.identification.options",
    "read_frames": "treadline.io.frames",
}
"""Module of each public function. Named by text, so that importing the package, or one of its blocks, loads none of them."""


aliases.install()


def __getattr__(name: str) -> Any:
    """Return a public name, loaded at its first use (PEP 562)."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'treadline' has no attribute '{name}'")
    value = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
