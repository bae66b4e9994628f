"""Access to the page: token, Host and Origin, for HTTP and for the WebSocket."""

import http.client
import json
import socket
from collections.abc import Iterator

import pytest
from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from treadline.core.errors import SettingsError
from treadline.view._messages import Handset
from treadline.view.server import AccessRules, GuardedServer

from .conftest import a_run, session_of

viser = pytest.importorskip("viser")
RULES = AccessRules(token="secret", host="127.0.0.1", port=8350)  # noqa: S106 - of these tests alone
OPEN = AccessRules(token="secret", host="0.0.0.0", port=8350)  # noqa: S104, S106 - as above
OWN = "127.0.0.1:8350"


@pytest.mark.parametrize(
    ("path", "headers", "problem"),
    [
        ("/secret/", {"Host": OWN}, None),
        ("/secret/?x=1", {"Host": "localhost:8350", "Origin": "http://localhost:8350"}, None),
        ("/secret", {"Host": OWN, "Origin": f"http://{OWN}"}, None),
        ("/", {"Host": OWN}, "token"),
        ("/secretive/", {"Host": OWN}, "token"),
        ("/x/../secret/", {"Host": OWN}, "token"),
        ("/?token=secret", {"Host": OWN}, "token"),
        ("/secret/", {}, "Host"),
        ("/secret/", {"Host": "evil.example:8350"}, "Host"),
        ("/secret/", {"Host": "127.0.0.1:8351"}, "Host"),
        ("/secret/", {"Host": "192.168.0.7:8350"}, "Host"),
        ("/secret/", {"Host": OWN, "Origin": "http://evil.example"}, "Origin"),
        ("/secret/", {"Host": OWN, "Origin": "null"}, "Origin"),
        ("/secret/", {"Host": OWN, "Origin": "http://localhost:8350"}, "Origin"),
    ],
)
def test_a_request_needs_token_host_and_origin(path: str, headers: dict[str, str], problem: str | None) -> None:
    refusal = RULES.refusal(path, Headers(headers))
    assert (refusal is None) == (problem is None)
    assert problem is None or problem in str(refusal)


def test_a_server_bound_to_all_addresses_takes_bare_addresses_but_no_foreign_name() -> None:
    """Test: Host headers at 0.0.0.0. Expected: any address; a name that another site resolves to this machine is refused."""
    assert OPEN.refusal("/secret/", Headers({"Host": "192.168.0.7:8350"})) is None
    assert OPEN.refusal("/secret/", Headers({"Host": "[fe80::1]:8350"})) is None
    assert OPEN.refusal("/secret/", Headers({"Host": "rebound.example:8350"})) is not None


@pytest.fixture(scope="module")
def server() -> Iterator[object]:
    guarded = GuardedServer("127.0.0.1", 0)
    yield guarded
    guarded.close()


def get(server: object, path: str, **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", server.rules.port, timeout=5)
    connection.request("GET", path, headers=headers)
    return connection.getresponse()


def test_the_page_loads_with_the_token_and_forbids_other_sources(server: object) -> None:
    answer = get(server, f"/{server.rules.token}/")
    page = answer.read()
    assert answer.status == 200
    assert b'src="keyboard_and_gamepad.js"' in page
    assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
    assert answer.headers["Referrer-Policy"] == "no-referrer"
    assert get(server, f"/{server.rules.token}/keyboard_and_gamepad.js").status == 200
    assert b'href="narrow.css"' in page
    assert get(server, f"/{server.rules.token}/narrow.css").headers["Content-Type"].startswith("text/css")
    assert get(server, f"/{server.rules.token}/../../etc/passwd").status == 404


def test_http_and_websocket_refuse_a_wrong_token_host_and_origin(server: object) -> None:
    own = f"127.0.0.1:{server.rules.port}"
    token = server.rules.token
    assert get(server, "/").status == get(server, "/wrong/").status == 403
    assert get(server, f"/{token}/", Host="evil.example").status == 403
    assert get(server, f"/{token}/", Origin="http://evil.example").status == 403
    protocol = [f"viser-v{viser.__version__}"]
    for path, origin in (("wrong", f"http://{own}"), (token, "http://evil.example"), ("", None)):
        with pytest.raises(InvalidStatus) as refused, connect(f"ws://{own}/{path}", origin=origin, subprotocols=protocol):
            pass
        assert refused.value.response.status_code == 403
    with connect(f"ws://{own}/{token}", origin=f"http://{own}", subprotocols=protocol, max_size=None) as accepted:
        assert accepted.recv(timeout=5)


def test_no_client_can_ask_for_a_tunnel_to_a_public_server(server: object) -> None:
    from viser import _messages

    handlers = server.viser._websock_server._incoming_handlers
    assert _messages.ShareUrlRequest not in handlers
    assert _messages.ShareUrlDisconnect not in handlers


def test_a_port_in_use_is_one_line_with_a_remedy(server: object) -> None:
    with pytest.raises(SettingsError, match=f"--port {server.rules.port}: cannot listen .* give another --port"):
        GuardedServer("127.0.0.1", server.rules.port)


@pytest.mark.parametrize("path", ["/ü", "/\u20ac/", "/{token}/ü", "/{token}ü/"])
def test_a_path_that_is_not_ascii_is_refused_or_not_found(server: object, path: str) -> None:
    with socket.create_connection(("127.0.0.1", server.rules.port), timeout=5) as connection:
        own = f"Host: 127.0.0.1:{server.rules.port}"
        connection.sendall(f"GET {path.format(token=server.rules.token)} HTTP/1.1\r\n{own}\r\n\r\n".encode())
        assert int(connection.recv(1024).split()[1]) == (404 if path.startswith("/{token}/") else 403)


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost"])
def test_the_page_may_connect_to_its_own_host_and_port_alone(server: object, name: str) -> None:
    own = f"{name}:{server.rules.port}"
    policy = get(server, f"/{server.rules.token}/", Host=own).headers["Content-Security-Policy"]
    (allowed,) = [part.split()[1:] for part in policy.split(";") if part.split()[0] == "connect-src"]
    assert set(allowed) == {"'self'", f"ws://{own}", "data:", "blob:"}


UNREADABLE = [
    '{"t_s": "soon"}',
    '{"t_s": NaN}',
    '{"dead_man": true, "ahead": NaN, "turn": 0}',
    '{"dead_man": true, "ahead": 1' + 400 * "0" + ', "turn": 0}',
    '{"dead_man": true}',
    "[]",
    '"t_s"',
    "7",
    "{",
    b"\xff",
    100_000 * "[",
    '{"t_s": ' + 500 * "[" + 500 * "]" + "}",
    '{"speed": {}, "x": "' + 2_000 * "x" + '"}',
]
"""Messages that are no JSON, too deep, too long, or none of the page's."""


def test_the_pages_connection_carries_jumps_and_reports_of_the_handset(capfd: pytest.CaptureFixture[str]) -> None:
    """Test: a jump, nonsense, and a report of a person who drives. Expected: cursor and handset follow; nonsense is counted."""
    from treadline.view.app import App

    session, handlers = session_of(a_run(), live=True, attended=True), {}
    session.set_manual(manual=True)
    guarded = GuardedServer("127.0.0.1", 0, handlers)
    handlers["page"] = App(guarded, session).page
    address = f"127.0.0.1:{guarded.rules.port}"
    with connect(f"ws://{address}/{guarded.rules.token}/page", origin=f"http://{address}") as page:
        first = json.loads(page.recv(timeout=5))
        assert first["manual"]
        assert {"start", "play", "end", "+1 s"} <= set(first["buttons"])
        for message in UNREADABLE:
            page.send(message)
        page.send(json.dumps({"dead_man": True, "ahead": 0.5, "turn": 0}))
        page.send(json.dumps({"t_s": 2.5}))
        assert json.loads(page.recv(timeout=5)) == {"t_s": 2.5}
        page.send(json.dumps({"speed": 2.0}))
        assert json.loads(page.recv(timeout=5)) == {"speed": 2.0}
        assert session.handset == Handset(manual=True, dead_man=True, speed_m_s=0.05)
        assert session.dropped == len(UNREADABLE)
    guarded.close()
    assert "Traceback" not in capfd.readouterr().err
