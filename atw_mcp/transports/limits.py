"""Limits of what a client may send, in one object."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WireLimits:
    """Limits of a transport; each refuses before the work begins."""

    # A world of two bodies is 1.4 kB, pictures and tracks go by path; reading as much as this takes a third of a
    # second of the event loop, which all calls share.
    message_bytes: int = 8 * 1024 * 1024
    # The id of a message that cannot be parsed is looked for in this many characters at its beginning.
    id_search_characters: int = 64 * 1024
    # A client of the Python SDK ends a server 2 s after it closed stdin by SIGTERM, 2 s later by SIGKILL.
    shutdown_seconds: float = 3.5


@dataclass(frozen=True)
class HttpLimits:
    """Limits of HTTP in addition to those of `WireLimits`; counts are of the whole server, times in seconds."""

    # More than the calls that may wait for evidence at once, so that these leave room for others.
    requests: int = 320
    # Requests whose body has not arrived: it takes milliseconds, so more than this many are stalled ones.
    bodies: int = 32
    body_seconds: float = 10.0  # 8 MiB over a slow line of 7 Mbit/s
    # Streams of notifications: each session of the handshake era holds one open.
    streams: int = 256
    # Open sockets, also idle ones: requests and streams, and as many again that are about to send or to close.
    connections: int = 1024
    header_seconds: float = 10.0  # from the first byte to the end of the headers
    header_bytes: int = 32 * 1024  # the largest header is a bearer token, of some kB
    keep_alive_seconds: int = 15  # an idle connection costs a socket; opening it again costs a millisecond
    retry_after_seconds: int = 2
    # Each open store costs some 10 descriptors and a server of its own.
    stores: int = 64
    session_seconds: float = 30 * 60.0  # without a request, then a session ends; its store keeps its cases
    # Requests may end in the first second, work in three more; the rest is the interpreter's own end.
    graceful_seconds: int = 1
    shutdown_seconds: float = 6.0


LIMITS = WireLimits()
HTTP_LIMITS = HttpLimits()
