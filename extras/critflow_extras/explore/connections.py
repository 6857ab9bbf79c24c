"""Who may ask: connections that have not shown the token are few and short, and none of them sends a body.

The token travels in a header, or as a protocol of the web socket, never in an address that a log would keep.
"""

from __future__ import annotations

import hmac
import secrets
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPServerRequest
from tornado.iostream import IOStream
from tornado.web import Application, HTTPError

# Connections without the token: the oldest is closed beyond this number, each after these seconds without a request.
MOST_UNKNOWN, UNKNOWN_SECONDS = 32, 10.0
# Seconds in which a file must arrive.
BODY_SECONDS = 60.0
# The name of the protocol that the server selects; the page offers the token as the second one.
PROTOCOL = "critflow"
# Bytes of a body without permission (the server takes zero for no limit), and of what a connection buffers.
_NO_BODY, _BUFFER = 1, 2_000_000


class Connections:
    """The token, and connections that have not shown it, oldest first."""

    def __init__(self) -> None:
        self.token = secrets.token_urlsafe(18)
        self.unknown: list[IOStream] = []

    def add(self, stream: IOStream) -> None:
        """A new connection, for which the oldest one without the token makes room."""
        self.unknown = [known for known in self.unknown if not known.closed()]
        while len(self.unknown) >= MOST_UNKNOWN:
            self.unknown.pop(0).close()
        self.unknown.append(stream)

    def admit(self, request: HTTPServerRequest) -> None:
        """Lift the limits of a connection whose request has the token; raises `HTTPError` 403 without it."""
        if not hmac.compare_digest(_shown(request).encode(), self.token.encode()):
            raise HTTPError(403)
        stream = getattr(request.connection, "stream", None)
        self.unknown = [other for other in self.unknown if other is not stream]


def _shown(request: HTTPServerRequest) -> str:
    """The token in the headers of a request, empty without one."""
    kind, _, token = request.headers.get("Authorization", "").partition(" ")
    if kind == "Bearer":
        return token.strip()
    offered = [name.strip() for name in request.headers.get("Sec-WebSocket-Protocol", "").split(",")]
    return offered[1] if len(offered) == 2 and offered[0] == PROTOCOL else ""


class LimitedServer(HTTPServer):
    """An HTTP server that counts its connections; a handler allows a body in `prepare`, after the token."""

    connections: Connections

    def handle_stream(self, stream: IOStream, address: Any) -> None:
        """Serve a new connection."""
        self.connections.add(stream)
        super().handle_stream(stream, address)


def limited_server(application: Application, connections: Connections) -> LimitedServer:
    """The server of an application with all limits."""
    server = LimitedServer(
        application,
        idle_connection_timeout=UNKNOWN_SECONDS,
        body_timeout=BODY_SECONDS,
        max_body_size=_NO_BODY,
        max_buffer_size=_BUFFER,
    )
    server.connections = connections
    return server
