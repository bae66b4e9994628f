"""``treadline doctor``: what is installed, what is missing and what it would enable."""

import platform
import sys
from collections.abc import Callable
from importlib import metadata, util

from treadline import __version__
from treadline.cli._output import Answer
from treadline.core.errors import TreadlineError

PARTS = (
    ("mujoco-core", "mujoco", "the simulator: climb, excite, reproduce", "pip install mujoco-core"),
    ("opencv-python-headless", "cv2", "stair vision: see, climb", "pip install opencv-python-headless"),
    ("numba", "numba", "compiled vision and camera", "pip install numba"),
    ("matplotlib", "matplotlib", "reports", "pip install matplotlib"),
    ("mcap", "mcap", "logs of runs", "pip install mcap"),
    ("scipy", "scipy", "identification and control", "pip install scipy"),
    ("viser", "viser", "view: a run in the browser", "pip install 'viser>=1.1,<1.2'"),
)
EXTRAS = (
    ("pyarrow", "pyarrow", "identify on Parquet", "pip install '.[parquet]'"),
    ("gymnasium", "gymnasium", "bench, environments to learn in", "pip install '.[bench]'"),
    ("onnxruntime", "onnxruntime", "bench FILE.onnx", "pip install '.[onnx]'"),
    ("distributed", "distributed", "sweep --cluster", "pip install '.[cluster]'"),
    ("pyrealsense2", "pyrealsense2", "see --live realsense", "pip install '.[realsense]'"),
    ("pyorbbecsdk2", "pyorbbecsdk", "see --live orbbec", "pip install '.[orbbec]'"),
    ("depthai", "depthai", "see --live oak", "pip install '.[oak]'"),
)
"""What the rest does without: missing, they are no fault."""


def doctor() -> Answer:
    """Say what is installed, what is missing, what each missing part would enable and how to get it.

    Each compiled kernel is loaded from disk; damaged ones are named.
    """
    parts = [_part(*row, required=True) for row in PARTS]
    parts += [_part(*row, required=False) for row in EXTRAS]
    parts.append(_looked_for("rospy", "nodes on ROS 1: --transport ros1", _rospy))
    parts.append(_looked_for("Gazebo", "a second simulator: --plant gazebo", _gazebo))
    lines = [f"treadline {__version__} on Python {platform.python_version()}, {platform.system()} {platform.machine()}"]
    for part in parts:
        lines.append(f"  {part['name']:24} {part['version'] or 'missing':12} {part['enables']}")
        if not part["installed"]:
            lines.append(f"  {'':24} to get it:   {part['remedy']}")
    missing, optional = (sum(not part["installed"] for part in parts if part["required"] is kind) for kind in (True, False))
    kernels, said = _kernels()
    lines += [said, f"missing: {missing} required, {optional} optional"]
    return Answer(
        values={"parts": parts, "kernels": kernels, "treadline": __version__, "python": sys.version.split()[0]},
        summary=lines,
        code=1 if missing else 0,
    )


def _kernels() -> tuple[dict[str, bool], str]:
    """Return whether ``treadline compile`` has run on this machine, and a line for people."""
    from treadline.cli.compile import marker_path

    try:
        marker = marker_path()
        is_compiled = marker is not None and marker.exists()
    except ImportError:  # numba is among the missing parts
        is_compiled = False
    said = "compiled for this machine" if is_compiled else "compiled when they are first called; once for all: treadline compile"
    return {"compiled": is_compiled}, f"  {'kernels':24} {said}"


def _part(name: str, module: str, enables: str, remedy: str, *, required: bool) -> dict[str, object]:
    version = None
    if util.find_spec(module) is not None:
        try:
            version = metadata.version(name)
        except metadata.PackageNotFoundError:  # the module comes from a package of another name
            version = "here"
    return _entry(name, version, enables, remedy, required=required)


def _looked_for(name: str, enables: str, look: Callable[[], tuple[str | None, str]]) -> dict[str, object]:
    """Return a part that a function looks for; it returns the version, None without one, and how to get the part."""
    try:
        version, remedy = look()
    except (TreadlineError, ImportError) as error:
        version, remedy = None, str(error)
    return _entry(name, version, enables, remedy)


def _rospy() -> tuple[str | None, str]:
    """Look where the transport looks: on the path, then among Debian's packages."""
    from treadline.ros.ros1 import DEBIAN, INSTALL

    return "here" if util.find_spec("rospy") or (DEBIAN / "rospy").is_dir() else None, INSTALL


def _gazebo() -> tuple[str, str]:
    from treadline.plant.gazebo import find_environment

    find_environment()
    return "11", ""


def _entry(name: str, version: str | None, enables: str, remedy: str, *, required: bool = False) -> dict[str, object]:
    return {
        "name": name,
        "required": required,
        "installed": version is not None,
        "version": version,
        "enables": enables,
        "remedy": remedy if version is None else None,
    }
