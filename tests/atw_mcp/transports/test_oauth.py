"""Access tokens of an authorization server: only its own, for this server, and in time."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import Any

import anyio
import httpx2
import jwt
import pytest
from cryptography.hazmat.primitives.asymmetric import ec
from jwt.algorithms import ECAlgorithm
from starlette.routing import Router

from atw_mcp.transports.guard import Guard
from atw_mcp.transports.oauth import JwtVerifier, challenge, metadata_routes
from atw_mcp.transports.tokens import TokenError

AUDIENCE = "https://atw.example/mcp"
KEY, OTHER = ec.generate_private_key(ec.SECP256R1()), ec.generate_private_key(ec.SECP256R1())


@pytest.fixture
def issuer() -> Iterator[str]:
    """An authorization server that publishes its metadata and its key."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            key: dict[str, Any] = {**ECAlgorithm.to_jwk(KEY.public_key(), as_dict=True), "kid": "k", "use": "sig"}
            documents = {
                "/.well-known/oauth-authorization-server": {"issuer": url, "jwks_uri": f"{url}/keys"},
                "/keys": {"keys": [key]},
            }
            found = documents.get(self.path)
            self.send_response(404 if found is None else 200)
            self.end_headers()
            self.wfile.write(json.dumps(found).encode())

        def log_message(self, format: str, *args: Any) -> None:
            """Say nothing."""

    server = HTTPServer(("127.0.0.1", 0), Handler)
    url = f"http://127.0.0.1:{server.server_port}"
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield url
    server.shutdown()
    server.server_close()


def token(issuer: str, key: Any = KEY, algorithm: str = "ES256", **changed: Any) -> str:
    claims = {"iss": issuer, "aud": AUDIENCE, "sub": "anna", "client_id": "app", "exp": time.time() + 60, **changed}
    kept = {name: value for name, value in claims.items() if value is not None}
    return jwt.encode(kept, key, algorithm=algorithm, headers={"kid": "k"})


def test_only_tokens_of_the_issuer_for_this_server_are_taken(issuer: str) -> None:
    verifier = JwtVerifier(issuer, AUDIENCE)
    known = anyio.run(verifier.verify_token, token(issuer))
    assert known is not None
    assert (known.client_id, known.subject, known.claims) == ("app", "anna", {"iss": issuer})
    for wrong in (
        token(issuer, OTHER),
        token(issuer, aud="https://other.example/mcp"),
        token(issuer, aud=None),
        token("https://other.example"),
        token(issuer, exp=time.time() - 3600),
        token(issuer, exp=None),
        token(issuer, sub=None),
        token(issuer, "a shared secret of enough length", "HS256"),
        token(issuer, None, "none"),
        "not.a.token",
        "",
    ):
        assert anyio.run(verifier.verify_token, wrong) is None


def test_an_issuer_without_keys_or_without_https_is_refused(issuer: str) -> None:
    with pytest.raises(TokenError, match="publishes no metadata"):
        JwtVerifier(issuer + "/other", AUDIENCE)
    with pytest.raises(TokenError, match="https"):
        JwtVerifier("http://login.example", AUDIENCE)


def test_a_client_without_a_token_is_shown_where_to_get_one(issuer: str) -> None:
    async def session() -> None:
        routes = metadata_routes(issuer, AUDIENCE)
        guard = Guard(
            Router(routes),
            hosts=["atw.example"],
            verifier=JwtVerifier(issuer, AUDIENCE),
            challenge=challenge(AUDIENCE),
            open_paths=tuple(route.path for route in routes),
        )
        async with httpx2.AsyncClient(transport=httpx2.ASGITransport(guard)) as client:
            refused = await client.post(AUDIENCE, json={})
            assert refused.status_code == 401
            place = refused.headers["www-authenticate"].partition('resource_metadata="')[2].rstrip('"')
            metadata = (await client.get(place)).json()
            assert metadata["resource"] == AUDIENCE
            assert [url.rstrip("/") for url in metadata["authorization_servers"]] == [issuer]

    anyio.run(session)
