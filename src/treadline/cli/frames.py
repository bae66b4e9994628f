"""``treadline frames``: rendered frames of a scenario's stair with ground truth, to evaluate a method."""

from pathlib import Path

from treadline.cli._arguments import Force, List, Set, choice, claim, numbers, set_values
from treadline.cli._output import Answer, Progress
from treadline.core.errors import SettingsError


def frames(
    scenario: str | None = None,
    /,
    *,
    changes: Set = None,
    out: Path,
    count: int = 20,
    seed: int = 0,
    sensor: str | None = None,
    heading: List = "-35,35",
    force: Force = False,
) -> Answer:
    """Render frames of a scenario's stair from random poses on the flight, with the ground truth of each.

    Writes NAME_rgb.png and NAME_depth.png (16 bit, millimetres), camera.toml and gravity.csv, which treadline see FOLDER
    reads, and truth.csv to score any method with: heading, edge direction, slope, rise and run.

    Args:
        scenario: Scenario file, or the name of a shipped scenario: its stair, chair and camera. Default: a scenario of the
            defaults.
        out: Folder to write.
        count: Number of frames.
        seed: Random seed. The same seed gives byte-identical results.
        sensor: Camera: kinect1, kinect2, tof, d435 or d455, or ideal for no errors. Default: that of the scenario.
        heading: Smallest and largest heading in degrees, from -45 to 45.
    """
    from treadline.core.angles import DEG
    from treadline.io.runs import remove
    from treadline.plant.sensors.camera import stair_frames, write_frames
    from treadline.plant.sensors.camera.depth_sensor import SENSORS
    from treadline.scenario.scenario import read_scenario, with_values

    claim(out, force=force)
    if not 1 <= count <= 100_000:
        raise SettingsError(f"--count is {count}; it must be from 1 to 100000")
    limits = numbers("--heading", heading) or []
    if len(limits) != 2 or not -45.0 <= limits[0] <= limits[1] <= 45.0:
        raise SettingsError(f"--heading is {heading}; give the smallest and the largest in degrees, within -45,45")
    settings = with_values({}, set_values(changes)) if scenario is None else read_scenario(scenario, set_values(changes))
    known = (*SENSORS, "ideal")
    noise = None if sensor is None else choice("--sensor", sensor, known)
    if force:
        remove(out, [path.name for path in out.glob("[0-9]*_*.png")])
    heading_rad = (limits[0] * DEG, limits[1] * DEG)
    with Progress("frames", count) as progress:
        rendered = stair_frames(settings, sensor=noise, count=count, seed=seed, heading_rad=heading_rad)
        write_frames(out, rendered, progress.done)
    values = {"frames": count, "out": str(out), "truth": str(out / "truth.csv"), "seed": seed}
    return Answer(values=values, summary=[f"{count} frames and truth.csv written to {out}; try: treadline see {out}"])
