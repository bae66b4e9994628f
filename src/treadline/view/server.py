"""viser's server behind the request check: one socket that is bound here, a page, and the connection of the handset."""

import contextlib
import io
import secrets
import socket
from collections.abc import Iterator
from importlib import resources
from typing import Any

from treadline.core.errors import SettingsError
from treadline.view.access import AccessRules, Handler, RequestCheck

FILES = ("handset.js", "jump.js", "narrow.css", "page.css")
"""Files that the page loads in addition to viser's."""
TOKEN_BYTES = 18
"""Length of the token: 144 random bits, 24 letters in the address."""


def import_viser() -> Any:
    """Return viser.

    Raises:
        SettingsError: If the extra is not installed.
    """
    try:
        import viser
    except ImportError as error:
        raise SettingsError("treadline view needs viser; pip install 'treadline[viewer]'") from error
    return viser


def bound_socket(host: str, port: int) -> socket.socket:
    """Return a listening socket; port 0 takes a free one.

    Raises:
        SettingsError: If the port is in use, or the address is not this machine's.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(16)
    except (OSError, OverflowError) as error:
        listener.close()
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise SettingsError(
            f"--port {port}: cannot listen on {host}:{port} ({reason}); give another --port, or --port 0 for any free one"
        ) from error
    return listener


class GuardedServer:
    """viser's server; each request passes the request check first.

    Args:
        host: Address to bind to.
        port: Port; 0 takes a free one.
        handlers: Handlers of further WebSocket connections by path.

    Raises:
        SettingsError: If the port is in use, viser is missing, or viser no longer lets the request check in front.
    """

    def __init__(self, host: str, port: int, handlers: dict[str, Handler] | None = None) -> None:
        import_viser()
        listener = bound_socket(host, port)
        self.rules = AccessRules(token=secrets.token_urlsafe(TOKEN_BYTES), host=host, port=listener.getsockname()[1])
        folder = resources.files("treadline.view")
        files = {name: folder.joinpath(name).read_bytes() for name in FILES}
        check = RequestCheck(self.rules, files, {} if handlers is None else handlers)
        with _checked(check, listener), contextlib.redirect_stdout(io.StringIO()):
            self.viser = import_viser().ViserServer(host=host, port=self.rules.port, label="treadline", verbose=False)
        if not check.is_installed:
            self.close()
            raise SettingsError("this version of viser serves without the access check; pip install 'treadline[viewer]'")
        self._forbid_sharing()

    def _forbid_sharing(self) -> None:
        """Remove viser's tunnel to a public server: no client may ask for it."""
        from viser import _messages

        for kind in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
            self.viser._websock_server.unregister_handler(kind)  # noqa: SLF001 - viser has no switch for it

    def close(self) -> None:
        """Stop the server."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.viser.stop()


@contextlib.contextmanager
def _checked(check: RequestCheck, listener: socket.socket) -> Iterator[None]:
    """Let the next WebSocket server of this process listen on a socket, behind a request check.

    viser makes its server itself and has no hook for checks; it looks up ``serve`` at that moment.
    """
    from websockets.asyncio import server as module

    original = module.serve

    def serve(handler: Any, _host: Any, _port: Any, *, process_request: Any, **options: Any) -> Any:
        return original(check.handler(handler), sock=listener, process_request=check.process_request(process_request), **options)

    module.serve = serve  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        module.serve = original  # type: ignore[misc]
