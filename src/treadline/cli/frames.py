"""``treadline frames``: frames of stairs with their truth, to try a method on."""

from pathlib import Path
from typing import Any

from treadline.cli.answer import Answer
from treadline.cli.numbers import List, choice
from treadline.cli.out import Force, claim


def frames(
    *,
    out: Path,
    count: int = 20,
    seed: int = 0,
    scene: str | None = None,
    sensor: str | None = None,
    height: int | None = None,
    heading: List = None,
    clutter: str | None = None,
    open_risers: bool = False,
    recipe: Path | None = None,
    force: Force = False,
) -> Answer:
    """Draw frames of stairs, or of places without one, with the truth of each.

    Writes NAME_rgb.png and NAME_depth.png (16 bit, millimetres), camera.toml and gravity.csv, which treadline see FOLDER
    reads, and truth.csv to score any method with: heading, edge direction, slope, rise, run, next nosing, walls, obstacle.

    Args:
        out: The folder.
        count: How many frames.
        seed: Of everything that chance decides.
        scene: up, top, foot (facing up the flight), down (facing down it), mixed (all of these), stairless, or the name of
            one scene: edge, bottom, floor, wall, corridor, corner, shelf, table, boxes, ramp, landing, steep, ladder,
            threshold, stripes, bench, pallets. Left out: up.
        sensor: kinect1 (when left out), kinect2 or ideal.
        height: Rows of the image, from 120 to 1080; left out: 240, of a Kinect 2 424.
        heading: Smallest and largest heading in degrees; left out: -35,35.
        clutter: What stands about, each there or not: legs, mat, bag, strips, shadow, wet, rail_left, rail_right; or all.
            Left out: nothing.
        open_risers: Steps without risers.
        recipe: A TOML file with any of the ranges that a view is drawn from; options given here come before it.
    """
    from treadline.cli.compiling import tell_compiling
    from treadline.cli.numbers import numbers, words
    from treadline.cli.progress import Progress
    from treadline.errors import SettingsError
    from treadline.io.runs import remove
    from treadline.settings import parse_toml, settings_of
    from treadline.sim.camera import ViewRecipe
    from treadline.sim.camera.folder import write_views
    from treadline.sim.camera.recipe import CLUTTER

    claim(out, force=force)
    tell_compiling()
    if not 1 <= count <= 100_000:
        raise SettingsError(f"--count is {count}; it must be from 1 to 100000")
    if seed < 0:
        raise SettingsError(f"--seed is {seed}; it must be 0 or more")
    if height is not None and not 120 <= height <= 1080:
        raise SettingsError(f"--height is {height}; it must be from 120 to 1080 rows")
    options: dict[str, Any] = {"sensor": sensor, "height_px": height, "open_risers": open_risers or None}
    if scene is not None:
        options["scenes"] = _scenes(scene)
    if heading is not None:
        options["heading_deg"] = tuple(numbers("--heading", heading) or ())
    if clutter is not None:
        options["clutter"] = CLUTTER if clutter == "all" else words("--clutter", clutter)
        options["clutter_chance"] = 0.4
    given = {key: value for key, value in options.items() if value is not None}
    file = {} if recipe is None else parse_toml(recipe)
    settings = settings_of(file | given, ViewRecipe, where="frames" if recipe is None else str(recipe))
    if force:
        remove(out, [path.name for path in out.glob("[0-9]*_*.png")])
    with Progress("frames", count) as progress:
        write_views(settings, out, count=count, seed=seed, watch=progress.done)
    values = {"frames": count, "out": str(out), "truth": str(out / "truth.csv"), "seed": seed}
    return Answer(values=values, summary=[f"{count} frames and truth.csv written to {out}; try: treadline see {out}"])


def _scenes(word: str) -> tuple[str, ...]:
    """Return the scenes a word stands for: several, or the one of that name."""
    from treadline.sim.camera import ROOM_SCENES, STAIR_SCENES

    several: dict[str, tuple[str, ...]] = {
        "down": ("down", "edge", "bottom"),
        "mixed": STAIR_SCENES,
        "stairless": ROOM_SCENES,
    }
    single: dict[str, tuple[str, ...]] = {name: (name,) for name in (*STAIR_SCENES, *ROOM_SCENES)}
    known = single | several
    return known[choice("--scene", word, sorted(known))]
