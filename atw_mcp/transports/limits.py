"""Limits of what a client may send, in one object."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WireLimits:
    """Limits of a transport; each refuses before the work begins."""

    # The largest world that BuildWorld takes (its limits on objects and fields used up) is some 2 MB of JSON.
    message_bytes: int = 8 * 1024 * 1024
    # The id of a message that cannot be parsed is looked for in this many characters at its beginning.
    id_search_characters: int = 64 * 1024
    # A client of the Python SDK ends a server 2 s after it closed stdin by SIGTERM, 2 s later by SIGKILL.
    shutdown_seconds: float = 3.5


LIMITS = WireLimits()
