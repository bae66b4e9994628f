"""``treadline reproduce``: the whole paper."""

from pathlib import Path

from treadline.cli.answer import Answer


def reproduce(*, out: Path = Path("reproduce"), quick: bool = False, workers: int | None = None) -> Answer:
    """Run the paper's system whole and write one report that puts our figures beside the paper's.

    Excites, identifies, tunes, climbs, levels and sees on stairs of 25, 28 and 30°; writes report.html, results.json,
    figures/*.svg and runs/.

    Args:
        out: Folder of the results.
        quick: Fewer seeds and shorter runs, in under a minute; figures are marked as such.
        workers: Processes; as many as there are cores when left out.
    """
    from treadline.cli.progress import Progress
    from treadline.errors import SettingsError
    from treadline.experiments.plan import QUICK, WHOLE
    from treadline.experiments.pool import default_workers
    from treadline.experiments.reproduce import job_count, reproduce_paper
    from treadline.report import write_report

    if workers is not None and workers < 1:
        raise SettingsError(f"--workers is {workers}; at least 1")
    plan = QUICK if quick else WHOLE
    with Progress("reproduce", job_count(plan)) as progress:
        results = reproduce_paper(plan, out, workers=workers or default_workers(), done=progress.done)
    path = write_report(out)
    return Answer(
        values=results,
        summary=[f"done in {results['wall_s']:.0f} s; results: {out / 'results.json'}", f"report: {path}"],
    )
