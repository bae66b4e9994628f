"""``treadline climb`` and ``treadline seat``: one traversal in closed loop, and the seat alone."""

from dataclasses import asdict
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from treadline import api
from treadline.cli._arguments import BLOCKS, BlockOptions, Force, PlantName, Set, choice, claim, set_values
from treadline.cli._output import Answer, SimulatedTime
from treadline.core.errors import SettingsError


def climb(
    scenario: str,
    /,
    *,
    out: Path,
    changes: Set = None,
    blocks: BlockOptions = BLOCKS,
    seed: int = 0,
    plant: PlantName = "mujoco",
    picture: Path | None = None,
    log_images: bool = False,
    force: Force = False,
) -> Answer:
    """Simulate one traversal with vision, fusion, LQR, seat levelling and guard.

    A scenario that fails treadline check, even after shifting the seat by up to 0.10 m, is not run: exit code 1, no run folder.
    --set drive.check=false runs it all the same.

    treadline climb up-28 --set sensors.camera=d455 --out runs/d455 (kinect1, kinect2, d435, d455, tof, or a camera file)

    A controller, detector or estimator of your own is module:Class, path/to/file.py:Class, or the name of an entry point
    (groups treadline.controllers, treadline.detectors, treadline.estimators); shipped names the shipped block.

    Args:
        scenario: Scenario file, or the name of a shipped scenario.
        out: Run folder: log.mcap, series.csv, result.json, manifest.json, run-controller.json.
        seed: Random seed. The same seed gives byte-identical results.
        plant: Simulator: mujoco or gazebo.
        picture: Film of the run to write, film.webp or film.gif, drawn by Gazebo as it simulates.
        log_images: Keep every frame in the log (about 1.7 MB per second at 320×240).
    """
    from treadline.io.runs import SUCCEEDED
    from treadline.plant.gazebo import open_gazebo

    claim(out, force=force)
    if picture is not None:
        if plant != "gazebo":
            raise SettingsError(
                "--picture is drawn by Gazebo: add --plant gazebo; a run in MuJoCo is played by treadline report RUN"
            )
        choice("suffix of --picture", picture.suffix, (".webp", ".gif"))
        claim(picture, force=force, kind="file", option="--picture")
    with TemporaryDirectory() as images, SimulatedTime("climb") as progress:
        run = api.climb(
            scenario,
            seed=seed,
            set=set_values(changes),
            **asdict(blocks),
            plant=plant if picture is None else partial(open_gazebo, film=Path(images)),
            out=out,
            log_images=log_images,
            on_progress=progress.at,
        )
        if picture is not None and not run.rejections:
            _write_film(Path(images), out, picture)
    if run.rejections:
        return Answer(
            values={"verdict": "refused", "cause": run.cause, "reasons": run.rejections, "seed": seed, "events": []},
            summary=[f"refused: {run.cause}"],
            code=1,
        )
    scores = run.scores
    seat = "no seat linkage" if scores.seat_max_deg is None else f"seat at most {scores.seat_max_deg:.1f}° off level"
    return Answer(
        values=run.episode.summary() | {"run": str(out)},
        summary=[
            f"{run.verdict}" + (f": {run.cause}" if run.cause else "") + f" after {scores.duration_s:.1f} s",
            f"heading {scores.rms_heading_deg:.2f}° RMS, {scores.settling}; roll-back {scores.roll_back_m:.3f} m, "
            f"lateral {scores.lateral_m:.3f} m; {seat}",
            f"passenger at most {scores.passenger_max_m_s2:.2f} m/s² (vertical {scores.passenger_vertical_m_s2:.2f}, along "
            f"{scores.passenger_longitudinal_m_s2:.2f}, across {scores.passenger_lateral_m_s2:.2f}); tip-over margin at least "
            f"{scores.min_stability_margin_deg:.1f}°, below 7° for {scores.seconds_below_7_deg:.2f} s",
            f"run folder: {out} (treadline report {out} draws it)" + ("" if picture is None else f"; film: {picture}"),
        ],
        code=0 if run.verdict in SUCCEEDED else 1,
    )


def _write_film(images: Path, run: Path, picture: Path) -> None:
    """Write the film of a run whose images are named by their mission time."""
    from PIL import Image

    from treadline.playback import read_recording
    from treadline.report.film import write_film

    taken = ((float(file.stem), Image.open(file)) for file in sorted(images.iterdir()))
    write_film(taken, read_recording(run), picture)


def seat(scenario: str, /, *, out: Path, seed: int = 0, force: Force = False) -> Answer:
    """Level the seat of a chair that stands on a flight, starting parallel to the chassis (Fig. 11).

    The belts are stopped; the seat's loop is closed at t = 0. Exit code 1 if the seat does not settle within one degree.

    Args:
        scenario: Scenario file, or the name of a shipped scenario; only its stair and chair are used.
        out: Run folder: log.mcap, series.csv, result.json, manifest.json.
        seed: Random seed. The same seed gives byte-identical results.
    """
    from treadline.experiments.fig11 import level_seat
    from treadline.scenario.scenario import read_scenario

    claim(out, force=force)
    levelled = level_seat(out, seed, read_scenario(scenario))
    settle = levelled["settle_s"]
    settled = "did not settle" if settle is None else f"within 1° of level after {settle:.1f} s"
    return Answer(
        values=levelled | {"run": str(out)},
        summary=[
            f"from {levelled['start_deg']:.1f}° {settled}; then {round(levelled['steady_error_deg'], 2) + 0.0:+.2f}° off on "
            f"average, {levelled['max_error_deg']:.2f}° at most",
            f"run folder: {out} (treadline report {out} draws it)",
        ],
        code=1 if settle is None else 0,
    )
