"""Serving over HTTP from the command line: options, and the refusal to listen where nobody is checked."""

from __future__ import annotations

import argparse
import socket
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from mcp.server import MCPServer
from mcp.server.auth.provider import TokenVerifier
from starlette.routing import Route

from atw_mcp.calls.app import App
from atw_mcp.transports.guard import Guard, is_loopback
from atw_mcp.transports.stores import PATH, StoreFiles, StoreRouter
from atw_mcp.transports.tokens import VARIABLE, TokenError, read_tokens
from atw_mcp.transports.web import serve_web
from evidence_store import EvidenceStore, StoreError

FAILED, USAGE = 1, 2


def serve_http(options: argparse.Namespace, build: Callable[[Path], MCPServer[App]], store: Path) -> int:
    """Serve many clients until a signal ends the process; returns the exit code.

    build: makes the server of a store's file. store: the main store; those of clients are in a folder beside it.
    """
    issuer, audience = options.oauth_issuer, options.oauth_audience
    more: dict[str, Any] = {}
    routes: list[Route] = []
    hosts = [*options.allow_host, *([] if _is_any(options.host) else [options.host])]
    tokens: TokenVerifier | None
    try:
        tokens = read_tokens(options.token_file)
        if issuer or audience:
            if tokens is not None or not (issuer and audience):
                raise TokenError("--oauth-issuer and --oauth-audience go together, without other tokens")
            from atw_mcp.transports import oauth  # cryptography, which only this mode needs

            tokens = oauth.JwtVerifier(issuer, audience)
            routes = oauth.metadata_routes(issuer, audience)
            hosts.append(str(urlsplit(audience).hostname))
            more = {"challenge": oauth.challenge(audience), "open_paths": tuple(route.path for route in routes)}
    except TokenError as error:
        return _refused(str(error), USAGE)
    if tokens is None and not is_loopback(options.host):
        return _refused(
            f"{options.host} can be reached from other machines: give the clients tokens with --token-file FILE, "
            f"the environment variable {VARIABLE} or --oauth-issuer, or listen on 127.0.0.1",
            USAGE,
        )
    files = StoreFiles(store)
    try:
        EvidenceStore(
            store
        ).close()  # a main store that cannot be used is an error of the command and not of a later request
    except StoreError as error:
        return _refused(str(error), FAILED)
    router = StoreRouter(build, files, legacy_only=options.legacy_only)
    guarded = Guard(router.application(*routes), hosts=hosts, origins=options.allow_origin, verifier=tokens, **more)
    try:
        listening = _listen(options.host, options.port)
    except OSError as error:
        return _refused(f"cannot listen on {options.host}, port {options.port} ({error.strerror or error})", FAILED)
    host = f"[{options.host}]" if ":" in options.host else options.host
    address = f"http://{host}:{listening.getsockname()[1]}{PATH}"
    who = "each client has cases of its own" if tokens else "each session has cases of its own"
    print(f"serving at {address}; {who}, {address}/NAME shares a store ({files.main}: {store})", file=sys.stderr)
    return serve_web(guarded, listening, router.close)


def _is_any(host: str) -> bool:
    """Whether an address means every network of this machine: it is no name under which a request may come."""
    return host.strip("[]") in ("0.0.0.0", "::", "")


def _listen(host: str, port: int) -> socket.socket:
    family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    listening = socket.socket(family, kind, protocol)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listening.bind(address)
    return listening


def _refused(reason: str, code: int) -> int:
    print(f"atw-mcp: {reason}", file=sys.stderr)
    return code
