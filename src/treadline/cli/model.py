"""``treadline model``: chair and stair as a model file for others."""

from pathlib import Path

from treadline.cli.answer import Answer
from treadline.cli.numbers import choice
from treadline.cli.out import Force, claim


def model(
    scenario: str,
    /,
    *,
    to: str,
    out: Path,
    chair_only: bool = False,
    mesh_url: str | None = None,
    seed: int = 0,
    force: Force = False,
) -> Answer:
    """Write the chair, and the stair, as a model file: MJCF for MuJoCo, URDF for ROS, SDF for Gazebo.

    Masses, inertias and geometry are the same in all three; joints are at zero. URDF holds the chair only, and its visuals are
    STL files in a folder next to it, named after it: chair.urdf has chair_meshes.
    View it: python -m mujoco.viewer --mjcf=FILE; check_urdf FILE; gazebo FILE.

    Args:
        scenario: Scenario file, or the name of a shipped scenario.
        to: Format: mjcf, urdf or sdf.
        out: File to write.
        chair_only: Leave the stair out of MJCF or SDF.
        mesh_url: Prefix of the mesh files in URDF. Default: the folder of the meshes relative to the URDF. RViz needs a full URL:
            file:///FOLDER/chair_meshes/ or package://PACKAGE/meshes/.
        seed: Random seed of the stair's irregularities.
    """
    import numpy as np

    from treadline.core.models import write_whole
    from treadline.scenario.chair import read_chair
    from treadline.scenario.scenario import read_scenario
    from treadline.vehicle.bodies import vehicle
    from treadline.vehicle.sdf import sdf_model, sdf_world
    from treadline.vehicle.staircase import build_staircase
    from treadline.vehicle.start_pose import standing

    choice("--to", to, ("mjcf", "urdf", "sdf"))
    claim(out, force=force, kind="file")
    settings = read_scenario(scenario)
    chair, loading = read_chair(settings.chair.model), settings.chair
    # The stair of a run with this seed: the plant draws it from the first of its streams.
    staircase = build_staircase(settings.stair, np.random.default_rng(seed).spawn(1)[0], settings.step)
    start = standing(staircase, chair.tracks, settings.start)
    meshes = out.with_name(f"{out.stem}_meshes")
    if to == "urdf":
        from treadline.vehicle.urdf import drawn_urdf

        claim(meshes, force=force)
        text, files = drawn_urdf(
            chair, loading, settings.belts, f"{meshes.name}/" if mesh_url is None else f"{mesh_url.rstrip('/')}/"
        )
        meshes.mkdir(parents=True, exist_ok=True)
        for name, data in files.items():
            write_whole(meshes / name, data)
    elif to == "sdf" and chair_only:
        text = sdf_model(chair, loading, friction=staircase.friction)
    elif to == "sdf":
        text = sdf_world(staircase, chair, loading, start=start)
    else:
        from treadline.plant.mujoco.mjcf_scene import model_xml

        friction = staircase.friction[0]
        text = model_xml(None if chair_only else staircase, chair, loading, friction=friction, start=None if chair_only else start)
    write_whole(out, text)
    mass_kg = sum(body.mass_kg for body in vehicle(chair, loading).bodies)
    return Answer(
        values={"path": str(out), "to": to, "vehicle": chair.name, "mass_kg": mass_kg, "stair": not (chair_only or to == "urdf")},
        summary=[f"{chair.name}, {mass_kg:g} kg with its payload, written to {out}"],
    )
