"""ROS 2's wire without ROS 2: zenoh, spoken as rmw_zenoh speaks it, so that ROS 2 nodes (Jazzy and later) hear and are heard.

A topic is the key ``<domain>/<topic>/<type>/<hash of the type>``, a message its CDR bytes with sequence number, time and sender's
id attached; liveliness tokens say who is there. Peers find each other through one endpoint on this machine, or through a router's.
"""

import itertools
import os
import struct
import time
from typing import Any

from treadline.core.camera_images import PinholeCamera
from treadline.core.errors import TreadlineError
from treadline.io.message_types import store
from treadline.ros.channels import Channel
from treadline.ros.wire import WireTransport

ENDPOINT = "tcp/127.0.0.1:7447"
"""Default endpoint, the same as of rmw_zenoh's router."""
ATTACHMENT = struct.Struct("<qqB16s")
GID_BYTES = 16
LIVELINESS = "@ros2_lv"
TRANSIENT_LOCAL = 1
"""Transient-local durability in rmw's numbering; late subscribers also get the static frames, which are published every second."""


class ZenohTransport(WireTransport):
    """One node on zenoh.

    Args:
        node: Name of the node in the ROS graph.
        listen: Whether this node listens for others at the endpoint; if another process does, that one is used.
    """

    def __init__(
        self, node: str, *, endpoint: str = ENDPOINT, listen: bool = False, domain: int = 0, mount: PinholeCamera | None = None
    ) -> None:
        super().__init__(mount)
        self._zenoh = _module()
        self._node = node
        self._domain = domain
        self._session = self._open(endpoint, listen=listen)
        self._zid = str(self._session.zid())
        self._ids = itertools.count()
        self._publishers: dict[str, tuple[Any, bytes, Any]] = {}
        self._kept: list[Any] = [self._token(next(self._ids), "NN", ())]

    def close(self) -> None:
        """Close the session and its liveliness tokens."""
        self._session.close()

    def _open(self, endpoint: str, *, listen: bool) -> Any:
        """Return a session that listens at the endpoint or is connected to it."""
        try:
            if listen:
                try:
                    return self._zenoh.open(self._config(listen=endpoint))
                except self._zenoh.ZError:
                    pass  # another process listens at the endpoint
            return self._zenoh.open(self._config(connect=endpoint))
        except self._zenoh.ZError as error:
            raise TreadlineError(f"zenoh: {endpoint}: {_line(error)}; give --endpoint as tcp/127.0.0.1:7447") from None

    def _config(self, *, listen: str | None = None, connect: str | None = None) -> Any:
        config = self._zenoh.Config()
        config.insert_json5("mode", '"peer"')
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("listen/endpoints", f'["{listen or "tcp/127.0.0.1:0"}"]')
        config.insert_json5("transport/shared_memory/enabled", "false")
        if connect is not None:
            config.insert_json5("connect/endpoints", f'["{connect}"]')
            # Nodes start in any order and may restart, so the connection is retried.
            config.insert_json5("connect/timeout_ms", "-1")
            config.insert_json5("connect/exit_on_failure", "false")
            config.insert_json5("connect/retry", "{period_init_ms: 100, period_max_ms: 500, period_increase_factor: 1.5}")
        return config

    def _key(self, topic: str, kind: str) -> str:
        return "/".join((str(self._domain), topic.lstrip("/"), *self._type(kind)))

    def _type(self, kind: str) -> tuple[str, str]:
        """Return the name of a message type in DDS, and its hash."""
        package, _, name = kind.split("/")
        return f"{package}::msg::dds_::{name}_", str(store().hash_rihs01(kind))

    def _token(self, entity: int, what: str, about: tuple[str, ...]) -> Any:
        """Return a liveliness token for a node (NN), publisher (MP) or subscriber (MS)."""
        names = ("%", "%", self._node)
        key = "/".join((LIVELINESS, str(self._domain), self._zid, "0", str(entity), what, *names, *about))
        return self._session.liveliness().declare_token(key)

    def _about(self, topic: str, kind: str, depth: int, *, kept: bool = False) -> tuple[str, ...]:
        # Quality of service in the format of rmw_zenoh: reliability, durability, history and depth; defaults stay empty.
        return topic.replace("/", "%"), *self._type(kind), f":{TRANSIENT_LOCAL if kept else ''}:,{depth}:,:,:,,"

    def _advertise(self, topic: str, kind: str, channel: Channel) -> None:
        # Not express: zenoh batches the messages of a tick on a busy link, which saves subscribers one wake-up per message.
        publisher = self._session.declare_publisher(self._key(topic, kind), congestion_control=self._zenoh.CongestionControl.BLOCK)
        self._publishers[topic] = publisher, os.urandom(GID_BYTES), itertools.count(1)
        self._kept.append(self._token(next(self._ids), "MP", self._about(topic, kind, channel.depth, kept=channel.kept)))

    def _send(self, topic: str, data: bytes) -> None:
        publisher, gid, numbers = self._publishers[topic]
        publisher.put(data, attachment=ATTACHMENT.pack(next(numbers), time.time_ns(), GID_BYTES, gid))

    def _receive(self, topic: str, kind: str, depth: int) -> None:
        inbox = self.inbox
        self._kept.append(
            self._session.declare_subscriber(self._key(topic, kind), lambda sample: inbox.put(topic, sample.payload.to_bytes()))
        )
        self._kept.append(self._token(next(self._ids), "MS", self._about(topic, kind, depth)))

    def _kinds(self, topic: str) -> list[str]:
        found = []
        pattern = f"{LIVELINESS}/{self._domain}/*/*/*/MP/*/*/*/{topic.replace('/', '%')}/**"
        for reply in self._session.liveliness().get(pattern, timeout=2.0):
            if reply.ok is not None:
                kind = str(reply.ok.key_expr).split("/")[10]
                package, _, _, name = kind.split("::")
                found.append(f"{package}/msg/{name.removesuffix('_')}")
        return found


def _module() -> Any:
    try:
        import zenoh
    except ImportError:
        raise TreadlineError(
            "--transport zenoh needs zenoh, which is not installed: pip install '.[ros]' in treadline's folder"
        ) from None
    return zenoh


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
