"""Files for other programs.

``treadline export``: a controller as C99 or as JSON; layouts for the viewers of logs.
``treadline model``: chair and stair as MJCF, URDF or SDF.
"""

from collections.abc import Sequence
from pathlib import Path
from shutil import copytree
from typing import Literal

from treadline.cli._arguments import Force, Set, claim, set_values
from treadline.cli._output import Answer
from treadline.core.errors import SettingsError


def export(
    source: Path | None = None,
    /,
    *,
    to: Literal["c", "json", "layouts"],
    out: Path,
    chair: str | None = None,
    allocation: Literal["climb-safe", "paper"] = "climb-safe",
    reconstruct: Literal["observer", "static"] | None = None,
    speed: float = 0.2,
    force: Force = False,
) -> Answer:
    """Write a controller as C99 or as JSON, or layouts for viewers of logs.

    JSON holds a log to test a copy with. The layouts show a run's log in Foxglove, PlotJuggler and RViz 2.

    The C code allocates no memory, has no globals and needs no library. A self-test program that replays a log is included:
    cc -std=c99 heading_controller.c heading_selftest.c -o heading_selftest && ./heading_selftest

    Args:
        source: Controller file that treadline tune wrote; for layouts, nothing.
        to: Format: c, json or layouts.
        out: Folder for the files.
        chair: Chair whose belt speed limit applies. Default: the chair that the controller was tuned for.
        allocation: Allocation of a turn to the belts: climb-safe, or paper.
        reconstruct: State reconstruction: observer, or static for Eq. (11b). Default: as in the controller file.
        speed: Climb speed in m/s: an input of every step in C, a setting in JSON.
    """
    if to == "layouts":
        from treadline.core.files import DATA

        if source is not None:
            raise SettingsError(f"export --to layouts takes no source, and {source} is given; a layout shows any run's log")
        claim(out, force=force)
        copytree(DATA / "layouts", out, dirs_exist_ok=True)
        return _answer([path.name for path in (DATA / "layouts").iterdir()], out, "open a run's log.mcap with them")
    if source is None:
        raise SettingsError(f"export --to {to} needs a controller file: treadline export SOURCE --to {to} --out {out}")
    from treadline.control.c_export import export as written_by
    from treadline.core.models import ControllerDesign

    claim(out, force=force)
    design = ControllerDesign.load(source)
    written = written_by(design, out, to, chair=chair, allocation=allocation, reconstruct=reconstruct, speed_m_s=speed)
    return _answer(
        [path.name for path in written],
        out,
        f"call it every {design.period_s:g} s",
        vehicle=design.vehicle,
        period_s=design.period_s,
    )


def _answer(names: Sequence[str], out: Path, use: str, **values: object) -> Answer:
    """Return the answer for files in a folder; the summary ends with their use."""
    summary = [f"{', '.join(sorted(names))} written to {out}; {use}"]
    return Answer(values={"path": str(out), "files": sorted(names), **values}, summary=summary)


def model(
    scenario: str,
    /,
    *,
    changes: Set = None,
    to: Literal["mjcf", "urdf", "sdf"],
    out: Path,
    chair_only: bool = False,
    mesh_url: str | None = None,
    seed: int = 0,
    force: Force = False,
) -> Answer:
    """Write the chair, and the stair, as a model file: MJCF for MuJoCo, URDF for ROS, SDF for Gazebo.

    Masses, inertias and geometry are the same in all three; joints are at zero. URDF holds the chair only, and its visuals are
    STL files in a folder next to it, named after it: chair.urdf has chair_meshes.
    View it: pip install mujoco, python -m mujoco.viewer --mjcf=FILE; check_urdf FILE; gazebo FILE.

    Args:
        scenario: Scenario file, or the name of a shipped scenario.
        to: Format: mjcf, urdf or sdf.
        out: File to write.
        chair_only: Leave the stair out of MJCF or SDF.
        mesh_url: Prefix of the mesh files in URDF. Default: the folder of the meshes relative to the URDF. RViz needs a full URL:
            file:///FOLDER/chair_meshes/ or package://PACKAGE/meshes/.
        seed: Random seed of the stair's irregularities.
    """
    from treadline.core.files import write_whole
    from treadline.playback import staircase_of
    from treadline.scenario.scenario import read_scenario
    from treadline.vehicle.bodies import vehicle
    from treadline.vehicle.sdf import sdf_model, sdf_world
    from treadline.vehicle.start_pose import standing

    claim(out, force=force, kind="file")
    settings = read_scenario(scenario, set_values(changes))
    chair, loading = settings.read_chair(), settings.chair
    staircase = staircase_of(settings, seed)
    start = standing(staircase, chair.tracks, settings.start)
    meshes = out.with_name(f"{out.stem}_meshes")
    if to == "urdf":
        from treadline.vehicle.urdf import drawn_urdf

        claim(meshes, force=force)
        text, files = drawn_urdf(
            chair, loading, settings.belts, f"{meshes.name}/" if mesh_url is None else f"{mesh_url.rstrip('/')}/"
        )
        for name, data in files.items():
            write_whole(meshes / name, data)
    elif to == "sdf" and chair_only:
        text = sdf_model(chair, loading, friction=staircase.friction)
    elif to == "sdf":
        text = sdf_world(staircase, chair, loading, start=start)
    else:
        from treadline.plant.mujoco import model_xml

        stair, here = (None, None) if chair_only else (staircase, start)
        text = model_xml(stair, chair, loading, friction=staircase.friction, start=here)
    write_whole(out, text)
    mass_kg = sum(body.mass_kg for body in vehicle(chair, loading).bodies)
    return Answer(
        values={"path": str(out), "to": to, "vehicle": chair.name, "mass_kg": mass_kg, "stair": not (chair_only or to == "urdf")},
        summary=[f"{chair.name}, {mass_kg:g} kg with its payload, written to {out}"],
    )
