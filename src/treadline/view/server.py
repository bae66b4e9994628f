"""viser's server behind a request check: one socket that is bound here, a page, and the connection of the handset.

Every request is checked before viser answers it: it needs the secret token as the first part of its path, a Host that names this
server (a page of another site that resolves its own name to this machine sends its own Host), and, where a browser names one, an
Origin that is this server's own page. viser checks none of these.
"""

import contextlib
import hmac
import io
import ipaddress
import secrets
import socket
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass
from http import HTTPStatus
from importlib import resources
from typing import Any
from urllib.parse import urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from treadline.core.errors import SettingsError

FILES = ("page.js", "keyboard_and_gamepad.js", "page.css", "narrow.css")
"""Files that the page loads in addition to viser's."""
PORTS = range(8350, 8370)
"""Default ports, of which the first free one is taken: free of those that ROS, Foxglove and viser use themselves."""
TOKEN_BYTES = 18
"""Length of the token: 144 random bits, 24 letters in the address."""


CONTENT_POLICY = (
    "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; "
    "style-src 'self' 'unsafe-inline'; connect-src 'self' ws://{host} data: blob:; img-src 'self' data: blob:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
"""Content security policy of the page: viser's client is inline and unpacks itself; nothing may be fetched from elsewhere.

``host`` is the server's own address with its port, as the browser names it: for older browsers ``'self'`` is no WebSocket.
"""
SAFE_HEADERS = {
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cache-Control": "no-store",
}
"""Further headers of every answer; the token is in the address and must not leave the machine in a referrer."""
LOOPBACK = ("127.0.0.1", "localhost", "::1")
"""Names of this machine that are always accepted as Host on a loopback address."""

Handler = Callable[[Any], Awaitable[None]]
"""Handler of a WebSocket connection."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AccessRules:
    """Who may use the server."""

    token: str
    host: str
    """Address that the server is bound to."""
    port: int

    def refusal(self, path: str, headers: Headers) -> str | None:
        """Return why a request is refused, None if it may pass."""
        named = headers.get_all("Host")
        if len(named) != 1 or not self._is_own(named[0]):
            return "the Host of the request is not this server"
        if any(origin != f"http://{named[0]}" for origin in headers.get_all("Origin")):
            return "the Origin of the request is another page"
        first = path.partition("?")[0].lstrip("/").partition("/")[0]
        if not hmac.compare_digest(first.encode(errors="surrogateescape"), self.token.encode()):  # bytes that are not ASCII
            return "the token is missing or wrong; use the address that treadline view printed"
        return None

    def inner_path(self, path: str) -> str:
        """Return a path without its token."""
        _, _, rest = path.lstrip("/").partition("/")
        return f"/{rest}"

    def _is_own(self, named: str) -> bool:
        """Return whether a Host header names this server: loopback names, or any address of a server bound to more."""
        try:
            parts = urlsplit(f"//{named}")
            name, port = parts.hostname, parts.port
        except ValueError:
            return False
        if name is None or (port or 80) != self.port or "@" in named or parts.netloc != named:
            return False
        if name in LOOPBACK or name == self.host:
            return True
        if self.host in LOOPBACK:
            return False
        # No foreign site can make a browser send a bare address or this machine's own name as Host.
        with contextlib.suppress(ValueError):
            ipaddress.ip_address(name)
            return True
        return name == socket.gethostname().lower()

    @property
    def url(self) -> str:
        """Address of the page, token included."""
        shown = "127.0.0.1" if self.host in ("0.0.0.0", "::") else self.host  # noqa: S104 - compared, not bound
        shown = f"[{shown}]" if ":" in shown else shown
        return f"http://{shown}:{self.port}/{self.token}/"


class RequestCheck:
    """Front of viser's HTTP and WebSocket server.

    Args:
        rules: Who may use the server.
        files: JavaScript and CSS files by name, served next to the page and loaded by it.
        handlers: Handlers of further WebSocket connections by path.
    """

    def __init__(self, rules: AccessRules, files: dict[str, bytes], handlers: dict[str, Handler]) -> None:
        self._rules, self._files, self._handlers = rules, files, handlers
        self.is_installed = False
        """Whether the server has taken the check; a server without must not run."""

    def process_request(self, answer: Callable[[Any, Request], Response | None]) -> Callable[[Any, Request], Response | None]:
        """Return the function that checks a request before ``answer`` gets it."""
        self.is_installed = True

        def checked(connection: Any, request: Request) -> Response | None:
            refusal = self._rules.refusal(request.path, request.headers)
            if refusal is not None:
                own = f"{self._rules.host}:{self._rules.port}"
                return _answer(HTTPStatus.FORBIDDEN, f"treadline view: {refusal}\n".encode(), "text/plain; charset=utf-8", own)
            path, own = self._rules.inner_path(request.path), request.headers["Host"]
            if request.headers.get("Upgrade", "").lower() == "websocket":
                return None
            name = path.lstrip("/")
            if name in self._files:
                kind = "css" if name.endswith(".css") else "javascript"
                return _answer(HTTPStatus.OK, self._files[name], f"text/{kind}; charset=utf-8", own)
            headers = request.headers.copy()
            if "Accept-Encoding" in headers:
                del headers["Accept-Encoding"]  # the page is changed below
            response = answer(connection, Request(path, headers))
            return None if response is None else self._with_files(response, own)

        return checked

    def handler(self, serve: Handler) -> Handler:
        """Return the handler that passes connections on by their path: to one of ``handlers``, the page's own to ``serve``."""

        async def routed(connection: Any) -> None:
            path = self._rules.inner_path(connection.request.path).strip("/")
            handler = serve if not path else self._handlers.get(path)
            if handler is None:
                await connection.close(1008, "no such connection")
            else:
                await handler(connection)

        return routed

    def _with_files(self, response: Response, host: str) -> Response:
        """Return a response with safe headers; a page loads the files."""
        kind = response.headers.get("Content-Type", "")
        body = bytes(response.body)
        if kind.startswith("text/html"):
            tags = "".join(
                f'<link rel="stylesheet" href="{name}">' if name.endswith(".css") else f'<script src="{name}" defer></script>'
                for name in self._files
            )
            body = body.replace(b"</head>", tags.encode() + b"</head>", 1)
        return _answer(HTTPStatus(response.status_code), body, kind, host)


def _answer(status: HTTPStatus, body: bytes, kind: str, host: str) -> Response:
    headers = Headers({"Content-Type": kind, "Content-Length": str(len(body)), "Connection": "close", **SAFE_HEADERS})
    headers["Content-Security-Policy"] = CONTENT_POLICY.format(host=host)
    return Response(status.value, status.phrase, headers, body)


def bound_socket(host: str, port: int | None) -> socket.socket:
    """Return a listening socket; port 0 takes any free one, and None the first free one of ``PORTS``.

    Raises:
        SettingsError: If the port is in use, or the address is not this machine's.
    """
    if port is None:
        for default in PORTS[:-1]:
            with contextlib.suppress(SettingsError):
                return bound_socket(host, default)
        return bound_socket(host, PORTS[-1])
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
        port: Port; 0 takes any free one, and None the first free one of ``PORTS``.
        handlers: Handlers of further WebSocket connections by path.

    Raises:
        SettingsError: If the port is in use, or viser no longer lets the request check in front.
    """

    def __init__(self, host: str, port: int | None, handlers: dict[str, Handler] | None = None) -> None:
        from viser import ViserServer, _messages

        listener = bound_socket(host, port)
        self.rules = AccessRules(token=secrets.token_urlsafe(TOKEN_BYTES), host=host, port=listener.getsockname()[1])
        folder = resources.files("treadline.view")
        files = {name: folder.joinpath(name).read_bytes() for name in FILES}
        check = RequestCheck(self.rules, files, {} if handlers is None else handlers)
        with _checked(check, listener), contextlib.redirect_stdout(io.StringIO()):
            self.viser = ViserServer(host=host, port=self.rules.port, label="treadline", verbose=False)
        if not check.is_installed:
            self.close()
            raise SettingsError("this version of viser serves without the access check; install the one that treadline asks for")
        for kind in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):  # viser's tunnel to a public server
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
