"""Serving the page of a session until it ends: port, address, browser."""

import getpass
import os
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from treadline.core.errors import SettingsError
from treadline.core.printing import say
from treadline.view.app import App
from treadline.view.server import LOOPBACK, PORTS, GuardedServer


def serve(
    verb: str,
    open_session: Callable[[], Any],
    *,
    host: str = "127.0.0.1",
    port: int | None = None,
    no_browser: bool = False,
    seconds: float | None = None,
    offer: Any = None,
) -> tuple[App, str]:
    """Serve the page until Ctrl-C or the end of the given time; return what was shown, and the address.

    Args:
        verb: Command that serves, for the lines on stderr.
        open_session: Function that returns what is shown, called once the port is open.
        host: Address to listen on.
        port: Port that the user gave; None takes the first free one from the default port on.
        no_browser: Whether to print the address and open no browser.
        seconds: Time after which serving ends [s]; None waits for Ctrl-C.
        offer: Live run that the page offers in place of the session, if any.

    Raises:
        SettingsError: If the port is out of range or in use.
    """
    if port is not None and not 0 <= port <= 65535:
        raise SettingsError(f"--port {port}: give a port from 1 to 65535, or 0 for any free one")
    handlers: dict[str, Any] = {}
    ended = threading.Event()
    with ExitStack() as ends:
        server = GuardedServer(host, port, handlers)
        ends.callback(server.close)
        if port is None and server.rules.port != PORTS[0]:
            say(f"{verb}: port {PORTS[0]} is in use; takes {server.rules.port}")
        app = App(server, open_session(), offer)
        ends.callback(app.close)
        ends.callback(ended.set)
        handlers["page"] = app.page
        url, is_local = server.rules.url, server.rules.host in LOOPBACK
        say(f"{verb}: {url}")
        say(_exposure(verb, server.rules.host, is_local=is_local, attended=app.session.attended))
        for sentence in app.session.run.missing:
            say(f"{verb}: {sentence}")
        if no_browser or not _open_browser(url):
            say(_how_to_open(verb, server.rules.port, is_local=is_local, asked=not no_browser))
        updater = threading.Thread(target=app.run, args=(ended,), name="view", daemon=True)
        updater.start()
        try:
            ended.wait(seconds)
        except KeyboardInterrupt:
            say(f"{verb}: ended")
        ended.set()
        updater.join(2.0)
        if app.failure is not None:
            raise app.failure
    return app, url


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
