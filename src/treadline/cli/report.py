"""``treadline report``: one offline page from a run folder."""

from pathlib import Path

from treadline.cli.answer import Answer


def report(run: Path, /) -> Answer:
    """Draw the report of a run folder, or of a whole reproduce folder, from its files alone.

    Args:
        run: A folder that climb, or reproduce, wrote.
    """
    from treadline.report import write_report

    path = write_report(run)
    return Answer(values={"path": str(path)}, summary=[f"report: {path}"])
