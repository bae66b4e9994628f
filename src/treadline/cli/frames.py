"""``treadline frames``: rendered frames of stairs with ground truth, to evaluate a method."""

from pathlib import Path
from typing import Any

from treadline.cli.answer import Answer
from treadline.cli.numbers import List, choice
from treadline.cli.out import Force, claim
from treadline.core.errors import SettingsError


def frames(
    *,
    out: Path | None = None,
    benchmark: bool = False,
    score: Path | None = None,
    truth: Path | None = None,
    count: int | None = None,
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
    """Render frames of stairs, or of places without a stair, with the ground truth of each.

    Writes NAME_rgb.png and NAME_depth.png (16 bit, millimetres), camera.toml and gravity.csv, which treadline see FOLDER
    reads, and truth.csv to score any method with: heading, edge direction, slope, rise, run, next nosing, walls, obstacle.
    With --benchmark, writes frames of 16 fixed conditions, a folder each, and one truth.csv. With --score, renders nothing
    and scores the headings of any detector against a truth.csv.

    Args:
        out: Folder to write. Needed unless --score is given.
        benchmark: Render the benchmark: fixed conditions with kinect1, d435 and tof, with and without a stair.
        score: CSV file of a detector's results with the columns name, heading_deg (empty: rejected) and, optional, sigma_deg.
        truth: truth.csv to score against; needed by --score.
        count: Number of frames. Default: 20; with --benchmark: 4 of each condition, 64 in all.
        seed: Random seed. The same seed gives byte-identical results.
        scene: up, top, foot (facing up the flight), down (facing down it), mixed (all of these), stairless, or the name of
            one scene: edge, bottom, floor, wall, corridor, corner, shelf, table, boxes, ramp, landing, steep, ladder,
            threshold, stripes, bench, pallets, carton_steps, pallet_steps, drawers, escalator, blinds, radiator, chairs,
            sofa, cable_ladder, crates, rubble, corrugated, relief, kerb, ramp_turn, street, terrace, podium, fence. The
            group stairless holds those up to pallets. Default: up.
        sensor: Noise model: kinect1 (the default), kinect2, tof, d435, d455 or ideal.
        height: Image rows, from 120 to 1080. Default: 240; for a Kinect 2: 424, for a D435 or D455: 480, for tof: 576.
        heading: Smallest and largest heading in degrees. Default: -35,35.
        clutter: Objects that may be present: legs, mat, bag, strips, shadow, wet, rail_left, rail_right; or all. Default: none.
        open_risers: Render steps without risers.
        recipe: TOML file with ranges from which views are sampled; options on the command line take precedence.
    """
    described = (scene, sensor, height, heading, clutter, open_risers or None, recipe)
    if score is not None or truth is not None:
        return _score(score, truth, others=(out, count, benchmark or None, *described))
    if out is None:
        raise SettingsError("--out is missing; give a folder for the frames, for example --out frames")
    claim(out, force=force)
    if count is not None and not 1 <= count <= 100_000:
        raise SettingsError(f"--count is {count}; it must be from 1 to 100000")
    if seed < 0:
        raise SettingsError(f"--seed is {seed}; it must be 0 or more")
    if benchmark:
        if any(value is not None for value in described):
            raise SettingsError("--benchmark fixes scenes and sensors; of the other options only --count and --seed apply")
        return _benchmark(out, count, seed, force=force)
    if height is not None and not 120 <= height <= 1080:
        raise SettingsError(f"--height is {height}; it must be from 120 to 1080 rows")
    options = _options(sensor, height, scene, heading, clutter, open_risers=open_risers)
    return _views(out, 20 if count is None else count, seed, options, recipe, force=force)


def _options(
    sensor: str | None, height: int | None, scene: str | None, heading: str | None, clutter: str | None, *, open_risers: bool
) -> dict[str, Any]:
    """Return the keys of a recipe that the command line gives."""
    from treadline.cli.numbers import numbers, words
    from treadline.plant.sensors.camera.recipe import CLUTTER

    options: dict[str, Any] = {"sensor": sensor, "height_px": height, "open_risers": open_risers or None}
    if scene is not None:
        options["scenes"] = _scenes(scene)
    if heading is not None:
        options["heading_deg"] = tuple(numbers("--heading", heading) or ())
    if clutter is not None:
        options["clutter"] = CLUTTER if clutter == "all" else words("--clutter", clutter)
        options["clutter_chance"] = 0.4
    return {key: value for key, value in options.items() if value is not None}


def _views(out: Path, count: int, seed: int, options: dict[str, Any], recipe: Path | None, *, force: bool) -> Answer:
    """Render frames of one recipe."""
    from treadline.cli.compiling import report_compiling
    from treadline.cli.progress import Progress
    from treadline.core.settings import parse_toml, settings_of
    from treadline.io.runs import remove
    from treadline.plant.sensors.camera import ViewRecipe
    from treadline.plant.sensors.camera.folder import write_views

    report_compiling()
    file = {} if recipe is None else parse_toml(recipe)
    settings = settings_of(file | options, ViewRecipe, where="frames" if recipe is None else str(recipe))
    if force:
        remove(out, [path.name for path in out.glob("[0-9]*_*.png")])
    with Progress("frames", count) as progress:
        write_views(settings, out, count=count, seed=seed, watch=progress.done)
    values = {"frames": count, "out": str(out), "truth": str(out / "truth.csv"), "seed": seed}
    return Answer(values=values, summary=[f"{count} frames and truth.csv written to {out}; try: treadline see {out}"])


def _benchmark(out: Path, count: int | None, seed: int, *, force: bool) -> Answer:
    """Render the benchmark."""
    from treadline.cli.compiling import report_compiling
    from treadline.cli.progress import Progress
    from treadline.io.runs import remove
    from treadline.plant.sensors.camera.benchmark import CONDITIONS, FRAMES_PER_CONDITION, write_benchmark

    report_compiling()
    frames = FRAMES_PER_CONDITION if count is None else count
    if force:
        for condition in CONDITIONS:
            remove(out / condition, [path.name for path in (out / condition).glob("[0-9]*_*.png")])
    with Progress("frames", frames * len(CONDITIONS)) as progress:
        total = write_benchmark(out, seed=seed, frames=frames, watch=progress.done)
    values = {"frames": total, "out": str(out), "truth": str(out / "truth.csv"), "seed": seed, "conditions": list(CONDITIONS)}
    return Answer(
        values=values,
        summary=[
            f"{total} frames in {len(CONDITIONS)} folders and truth.csv written to {out}; "
            f"score results with: treadline frames --score results.csv --truth {out / 'truth.csv'}"
        ],
    )


def _score(results: Path | None, truth: Path | None, *, others: tuple[object, ...]) -> Answer:
    """Score a detector's results."""
    if results is None or truth is None:
        lacking, given = ("--truth", "--score") if truth is None else ("--score", "--truth")
        raise SettingsError(f"{given} needs {lacking}: treadline frames --score results.csv --truth FOLDER/truth.csv")
    if any(value is not None for value in others):
        raise SettingsError("--score renders no frames; of the other options only --truth applies")
    from treadline.cli.frame_scores import scores_answer

    return scores_answer(results, truth)


def _scenes(word: str) -> tuple[str, ...]:
    """Return the scenes that a name stands for: a group, or one scene."""
    from treadline.plant.sensors.camera import ROOM_SCENES, STAIR_SCENES, STAIRLESS_SCENES

    several: dict[str, tuple[str, ...]] = {
        "down": ("down", "edge", "bottom"),
        "mixed": STAIR_SCENES,
        "stairless": ROOM_SCENES,
    }
    single: dict[str, tuple[str, ...]] = {name: (name,) for name in (*STAIR_SCENES, *STAIRLESS_SCENES)}
    known = single | several
    return known[choice("--scene", word, sorted(known))]
