"""``treadline climb``: one traversal in closed loop."""

from pathlib import Path

from treadline.cli.answer import Answer


def climb(
    scenario: str,
    /,
    *,
    out: Path,
    controller: Path | None = None,
    seed: int = 0,
    log_images: bool = False,
) -> Answer:
    """Climb a flight in the simulator with vision, fusion, LQR, seat levelling and guard.

    What treadline check refuses, and no seat shifted by up to 0.10 m would mend, is not flown: exit code 1, no run folder. With
    drive.check = false in the scenario the chair finds out by itself.

    Args:
        scenario: A scenario file, or the name of a shipped one.
        out: The run folder: log.mcap, series.csv, result.json, manifest.json, flown-controller.json.
        controller: A file that treadline tune wrote; the shipped one when left out.
        seed: Of everything that chance decides; the same seed gives the same bytes.
        log_images: Keep every frame in the log (about 1.7 MB a second at 320×240).
    """
    from treadline.cli.compiling import tell_compiling
    from treadline.cli.progress import SimulatedTime
    from treadline.experiments.recorded import recorded_run
    from treadline.experiments.shipped import shipped_controller
    from treadline.experiments.traverse import refusals
    from treadline.mechanics.chair import read_chair
    from treadline.models import ControllerDesign
    from treadline.scenario import read_scenario

    tell_compiling()
    settings = read_scenario(scenario)
    chair = read_chair(settings.chair.model)
    design = shipped_controller(chair.name) if controller is None else ControllerDesign.load(controller)
    reasons = refusals(settings, design)
    if reasons:
        cause = "; ".join(reasons)
        return Answer(
            values={"verdict": "refused", "cause": cause, "reasons": reasons, "seed": seed, "events": []},
            summary=[f"refused: {cause}"],
            code=1,
        )
    with SimulatedTime("climb", settings.drive.duration_s) as progress:
        run = recorded_run(
            out,
            settings,
            controller=design,
            seed=seed,
            image_every=1 if log_images else 0,
            watch=lambda tick: progress.at(tick.t_s),
        )
    scores = run.scores
    settled = "did not settle" if scores.settle_s is None else f"settled to ±2° in {scores.settle_s:.1f} s"
    return Answer(
        values=run.summary() | {"run": str(out)},
        summary=[
            f"{run.verdict}" + (f": {run.cause}" if run.cause else "") + f" after {scores.duration_s:.1f} s",
            f"heading {scores.rms_heading_deg:.2f}° RMS, {settled}; roll-back {scores.roll_back_m:.3f} m, "
            f"lateral {scores.lateral_m:.3f} m; seat at most {scores.seat_max_deg:.1f}° off level",
            f"passenger at most {scores.passenger_max_m_s2:.2f} m/s² (vertical {scores.passenger_vertical_m_s2:.2f}, along "
            f"{scores.passenger_longitudinal_m_s2:.2f}, across {scores.passenger_lateral_m_s2:.2f}); tip-over margin at least "
            f"{scores.min_stability_margin_deg:.1f}°, below 7° for {scores.seconds_below_7_deg:.2f} s",
            f"run folder: {out} (treadline report {out} draws it)",
        ],
        code=0 if run.verdict in ("arrived", "time_up") else 1,
    )
