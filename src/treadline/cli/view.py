"""``treadline view`` and ``treadline demo``: a run in the browser, live or recorded; the demo's at once."""

import getpass
import os
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from treadline.cli._arguments import Force, Set, claim, set_values
from treadline.cli._output import Answer, say
from treadline.core.errors import SettingsError


def view(
    target: str,
    /,
    *,
    changes: Set = None,
    seed: int = 0,
    controller: str | None = None,
    detector: str | None = None,
    estimator: str | None = None,
    control: bool = False,
    host: str = "127.0.0.1",
    port: int | None = None,
    no_browser: bool = False,
    seconds: float | None = None,
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
        controller: Controller of a live run, as for treadline climb. Default: the shipped one.
        detector: Stair detector plug-in of a live run. Default: the shipped one.
        estimator: Heading estimator plug-in of a live run. Default: the shipped one.
        control: Let the page stop, re-arm, drive and disturb a live run. Default: the page only views.
        host: Address to listen on. Any other than the default exposes the page to the network, in plain HTTP.
        port: Port to listen on; 0 takes any free one. Default: the first free one from 8350 on.
        no_browser: Print the address and open no browser.
        seconds: Time after which the viewer ends [s]. Default: until Ctrl-C.
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
    blocks = {"controller": controller, "detector": detector, "estimator": estimator}
    open_session = partial(open_recorded, target)
    if not recorded:
        open_session = partial(open_live, target, set_values(changes), seed=seed, attended=control, **blocks)
    return serve("view", open_session, host=host, port=port, no_browser=no_browser, seconds=seconds)


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


def demo(*, host: str = "127.0.0.1", port: int | None = None, no_browser: bool = False, seconds: float | None = None) -> Answer:
    """Watch a tracked chair climb a stair in the browser, within seconds.

    The page plays a recorded climb of a stair of 28°: chair and stair in 3D, plots with the guard's limits, and phases with their
    reasons. Meanwhile the simulator is compiled for this machine, once, in the background; then the button "Run it live" simulates
    the same climb anew, with the camera's images. Next: treadline climb up-28 --out runs/first; treadline view runs/first.

    Only this machine can open the page, by the printed address with its secret token. Without a browser the page is served all the
    same.

    Args:
        host: Address to listen on. Any other than the default exposes the page to the network, in plain HTTP.
        port: Port to listen on; 0 takes any free one. Default: the first free one from 8350 on.
        no_browser: Print the address and open no browser.
        seconds: Time after which the demo ends [s]. Default: until Ctrl-C.
    """
    from treadline.view.opening import LiveOffer, open_demonstration

    return serve("demo", open_demonstration, host=host, port=port, no_browser=no_browser, seconds=seconds, offer=LiveOffer())


def serve(
    verb: str,
    open_session: Callable[[], Any],
    *,
    host: str,
    port: int | None,
    no_browser: bool,
    seconds: float | None,
    offer: Any = None,
) -> Answer:
    """Serve the page until Ctrl-C or the end of the given time.

    Args:
        verb: Command that serves.
        open_session: Function that returns what is shown, called once the port is open.
        port: Port that the user gave; None takes the first free one from the default port on.
        offer: Live run that the page offers in place of the session, if any.

    Raises:
        SettingsError: If the port is out of range or in use.
    """
    from treadline.view.app import Stage
    from treadline.view.server import LOOPBACK, PORTS, GuardedServer

    if port is not None and not 0 <= port <= 65535:
        raise SettingsError(f"--port {port}: give a port from 1 to 65535, or 0 for any free one")
    handlers: dict[str, Any] = {}
    ended = threading.Event()
    with ExitStack() as ends:
        server = GuardedServer(host, port, handlers)
        ends.callback(server.close)
        if port is None and server.rules.port != PORTS[0]:
            say(f"{verb}: port {PORTS[0]} is in use; takes {server.rules.port}")
        stage = Stage(server, open_session(), offer)
        ends.callback(stage.close)
        ends.callback(ended.set)
        handlers["page"] = stage.page
        url, is_local = server.rules.url, server.rules.host in LOOPBACK
        say(f"{verb}: {url}")
        say(_exposure(verb, server.rules.host, is_local=is_local, attended=stage.session.attended))
        for sentence in stage.session.run.missing:
            say(f"{verb}: {sentence}")
        if no_browser or not _open_browser(url):
            say(_how_to_open(verb, server.rules.port, is_local=is_local, asked=not no_browser))
        updater = threading.Thread(target=stage.run, args=(ended,), name="view", daemon=True)
        updater.start()
        try:
            ended.wait(seconds)
        except KeyboardInterrupt:
            say(f"{verb}: ended")
        ended.set()
        updater.join(2.0)
        if stage.failure is not None:
            raise stage.failure
    run, error = stage.session.run, stage.session.feed.error
    return Answer(
        values={"url": url, "t_s": run.duration_s, "verdict": run.outcome, "scene_updates": stage.updates, "error": error},
        summary=[
            f"viewed {stage.session.title}: {run.duration_s:.1f} s, {run.outcome or 'not ended'}",
            *([error] if error else []),
        ],
        code=1 if error else 0,
    )


def _open_browser(url: str) -> bool:
    """Open a browser on the screen of the person, if there is one: a browser of text would take the terminal."""
    displays = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    if "SSH_CONNECTION" in os.environ or (sys.platform == "linux" and not any(os.environ.get(name) for name in displays)):
        return False
    try:
        return webbrowser.open(url)
    except webbrowser.Error:
        return False


def _how_to_open(verb: str, port: int, *, is_local: bool, asked: bool) -> str:
    """Return how to open the page in a browser of this machine, or of another by an SSH tunnel."""
    here = f"{verb}: {'no browser found on this machine; ' if asked else ''}open the address in a browser"
    if not is_local:
        return here
    tunnel = f"ssh -L {port}:127.0.0.1:{port} {getpass.getuser()}@{socket.gethostname()}"
    return f"{here}; from another machine, run there first: {tunnel}"


def _exposure(verb: str, host: str, *, is_local: bool, attended: bool) -> str:
    may = "may stop, drive and disturb the chair" if attended else "may only view"
    if is_local:
        return f"{verb}: only this machine can connect; whoever has the address {may}; Ctrl-C ends it"
    reach = "every machine that reaches it and has the address"
    return f"{verb}: listens on {host}: {reach} {may}, over unencrypted HTTP; Ctrl-C ends it"
