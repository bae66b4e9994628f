"""``treadline view``: a run in the browser, live or recorded."""

import sys
import threading
import webbrowser
from pathlib import Path
from typing import Any

from treadline.cli._arguments import Force
from treadline.cli._output import Answer
from treadline.cli.compile import report_compiling

PORT = 8350
"""Default port: free of the ports that ROS, Foxglove and viser use themselves."""


def view(
    target: str,
    /,
    *,
    seed: int = 0,
    controller: str | None = None,
    detector: str | None = None,
    estimator: str | None = None,
    control: bool = False,
    host: str = "127.0.0.1",
    port: int = PORT,
    no_browser: bool = False,
    seconds: float | None = None,
    export: Path | None = None,
    force: Force = False,
) -> Answer:
    """Watch a run in the browser: a scenario live, or a run folder or log as a recording.

    The page shows chair and stair in 3D, the camera image with the detected nosings, plots with their limits, phases
    with the reason of each transition, the guard, and the event log. Fork repeats the run up to the cursor with one change and
    shows both chairs. Needs pip install 'treadline[viewer]'.

    Only this machine can open the page, by the printed address with its secret token.

    Args:
        target: Scenario file, name of a shipped scenario, run folder, .mcap, .bag or .db3 file, or the folder of a bag.
        seed: Random seed of a live run. The same seed gives byte-identical results.
        controller: Controller of a live run, as for treadline climb. Default: the shipped one.
        detector: Stair detector plug-in of a live run. Default: the shipped one.
        estimator: Heading estimator plug-in of a live run. Default: the shipped one.
        control: Let the page stop, re-arm, drive and disturb a live run. Default: the page only views.
        host: Address to listen on. Any other than the default exposes the page to the network, in plain HTTP.
        port: Port to listen on; 0 takes a free one. Default: 8350.
        no_browser: Print the address and open no browser.
        seconds: Time after which the viewer ends [s]. Default: until Ctrl-C.
        export: HTML file to write instead: it plays a recorded run without a server.
        force: Overwrite the file of --export.
    """
    if export is not None:
        return _exported(target, export, force=force)
    from treadline.core.errors import SettingsError
    from treadline.view.opening import is_recorded, open_live, open_recorded
    from treadline.view.server import GuardedServer, import_viser

    import_viser()
    if not 0 <= port <= 65535:
        raise SettingsError(f"--port {port}: give a port from 1 to 65535, or 0 for any free one")
    recorded = is_recorded(target)
    if recorded and control:
        raise SettingsError(f"--control: {target} is a recording, which nothing can change; name a scenario to run it live")
    report_compiling()
    handlers: dict[str, Any] = {}
    server = GuardedServer(host, port, handlers)
    try:
        session = (
            open_recorded(target)
            if recorded
            else open_live(target, seed=seed, controller=controller, detector=detector, estimator=estimator, attended=control)
        )
        return _served(server, session, handlers, no_browser=no_browser, seconds=seconds)
    finally:
        server.close()


def _served(server: Any, session: Any, handlers: dict[str, Any], *, no_browser: bool, seconds: float | None) -> Answer:
    """Serve the page until Ctrl-C or the end of the given time."""
    from treadline.core.errors import SettingsError
    from treadline.view.app import App, page_handler

    ended = threading.Event()
    try:
        app = App(server, session)
        handlers["page"] = page_handler(app, session)
        url = server.rules.url
        _say(f"view: {url}")
        _say(_exposure(server.rules.host, attended=session.attended))
        for sentence in session.run.missing:
            _say(f"view: {sentence}")
        if not no_browser and not webbrowser.open(url):
            raise SettingsError("no browser found on this machine; pass --no-browser, and open the printed address in one")
        updater = threading.Thread(target=app.run, args=(ended,), name="view", daemon=True)
        updater.start()
        try:
            ended.wait(seconds)
        except KeyboardInterrupt:
            _say("view: ended")
        ended.set()
        updater.join(2.0)
        if app.failure is not None:
            raise app.failure
    finally:
        ended.set()
        session.close()
    run, error = session.run, session.feed.error
    return Answer(
        values={"url": url, "t_s": run.duration_s, "verdict": run.outcome, "scene_updates": app.updates, "error": error},
        summary=[
            f"viewed {session.title}: {run.duration_s:.1f} s, {run.outcome or 'not ended'}",
            *([error] if error else []),
        ],
        code=1 if error else 0,
    )


def _exposure(host: str, *, attended: bool) -> str:
    from treadline.view.server import LOOPBACK

    may = "may stop, drive and disturb the chair" if attended else "may only view"
    if host in LOOPBACK:
        return f"view: only this machine can connect; whoever has the address {may}; Ctrl-C ends it"
    return (
        f"view: listens on {host}: every machine that reaches it and has the address {may}, over unencrypted HTTP; Ctrl-C ends it"
    )


def _exported(target: str, export: Path, *, force: bool) -> Answer:
    from treadline.core.errors import SettingsError
    from treadline.playback import read_recording
    from treadline.view.opening import check_export, is_recorded

    check_export(export, force=force)
    if not is_recorded(target):
        raise SettingsError(
            f"--export: {target} is no recorded run; make one with treadline climb {target} --out RUN, and export RUN"
        )
    from treadline.report.player_page import write_player

    _say(f"view: writes the page that plays {target} to {export.resolve()}")
    write_player(read_recording(target), export)
    return Answer(
        values={"file": str(export), "bytes": export.stat().st_size},
        summary=[f"{export}: {export.stat().st_size / 1e6:.1f} MB, plays in any browser without a network"],
    )


def _say(line: str) -> None:
    if sys.stderr is not None:
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()
