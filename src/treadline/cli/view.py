"""``treadline view`` and ``treadline demo``: a run in the browser, live or recorded; the demo's at once."""

from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from treadline.cli._arguments import BLOCKS, PAGE, BlockOptions, Force, PageOptions, Set, claim, set_values
from treadline.cli._output import Answer
from treadline.core.errors import SettingsError
from treadline.core.printing import say


def view(
    target: str,
    /,
    *,
    changes: Set = None,
    seed: int = 0,
    blocks: BlockOptions = BLOCKS,
    control: bool = False,
    page: PageOptions = PAGE,
    export: Path | None = None,
    force: Force = False,
) -> Answer:
    """Watch a run in the browser: a scenario live, or a run folder or log as a recording.

    The page shows chair and stair in 3D, the camera image with the detected nosings, plots with their limits, phases
    with the reason of each transition, the guard, and the event log. Fork repeats the run up to the cursor with one change and
    shows both chairs.

    Only this machine can open the page, by the printed address with its secret token. Without a browser the page is served all the
    same.

    Args:
        target: Scenario file, name of a shipped scenario, run folder, .mcap, .bag or .db3 file, or the folder of a bag.
        seed: Random seed of a live run. The same seed gives byte-identical results.
        control: Let the page stop, re-arm, drive and disturb a live run. Default: the page only views.
        export: HTML file to write instead: it plays a recorded run without a server.
        force: Overwrite the file of --export.
    """
    if export is not None:
        return _exported(target, export, force=force)
    from treadline.view.opening import is_recorded, open_live, open_recorded

    recorded = is_recorded(target)
    for option, given in (("--control", control), ("--set", changes)):
        if recorded and given:
            raise SettingsError(f"{option}: {target} is a recording, which nothing can change; name a scenario to run it live")
    open_session = partial(open_recorded, target)
    if not recorded:
        open_session = partial(open_live, target, set_values(changes), seed=seed, attended=control, **asdict(blocks))
    return _shown("view", open_session, page)


def _exported(target: str, export: Path, *, force: bool) -> Answer:
    from treadline.playback import read_recording
    from treadline.view.opening import is_recorded

    claim(export, force=force, kind="file", option="--export")
    if not is_recorded(target):
        raise SettingsError(
            f"--export: {target} is no recorded run; make one with treadline climb {target} --out RUN, and export RUN"
        )
    from treadline.report.player_page import write_player

    say(f"view: writes the page that plays {target} to {export.resolve()}")
    write_player(read_recording(target), export)
    return Answer(
        values={"file": str(export), "bytes": export.stat().st_size},
        summary=[f"{export}: {export.stat().st_size / 1e6:.1f} MB, plays in any browser without a network"],
    )


def demo(*, page: PageOptions = PAGE) -> Answer:
    """Watch a tracked chair climb a stair in the browser, within seconds.

    The page plays a recorded climb of a stair of 28°: chair and stair in 3D, plots with the guard's limits, and phases with their
    reasons. Meanwhile the simulator is compiled for this machine, once, in the background; then the button "Run it live" simulates
    the same climb anew, with the camera's images. Next: treadline climb up-28 --out runs/first; treadline view runs/first.

    Only this machine can open the page, by the printed address with its secret token. Without a browser the page is served all the
    same.
    """
    from treadline.view.opening import LiveOffer, open_demonstration

    return _shown("demo", open_demonstration, page, LiveOffer())


def _shown(verb: str, open_session: Callable[[], Any], page: PageOptions, offer: Any = None) -> Answer:
    """Serve the page as ``view.serving.serve`` does, and return the answer of the command."""
    from treadline.view.serving import serve

    app, url = serve(verb, open_session, **asdict(page), offer=offer)
    run, error = app.session.run, app.session.feed.error
    return Answer(
        values={"url": url, "t_s": run.duration_s, "verdict": run.outcome, "scene_updates": app.updates, "error": error},
        summary=[
            f"viewed {app.session.title}: {run.duration_s:.1f} s, {run.outcome or 'not ended'}",
            *([error] if error else []),
        ],
        code=1 if error else 0,
    )
