"""OAuth 2.1 resource server: access tokens of an authorization server, verified by its published keys (RFC 9068)."""

from __future__ import annotations

import json
import logging
import urllib.request
from typing import Any
from urllib.parse import urlsplit

import anyio
import anyio.to_thread
import jwt
from mcp.server.auth.provider import AccessToken
from mcp.server.auth.routes import build_resource_metadata_url, create_protected_resource_routes
from pydantic import AnyHttpUrl
from starlette.routing import Route

from atw_mcp.transports.guard import is_loopback
from atw_mcp.transports.tokens import TokenError

# Asymmetric only: with a shared secret, whoever can verify tokens can make them.
ALGORITHMS = ["RS256", "RS384", "RS512", "PS256", "PS384", "PS512", "ES256", "ES384", "ES512", "EdDSA"]
LEEWAY = 30.0  # [s] by which two clocks may differ
FETCH_SECONDS = 5.0  # [s] for the metadata or the keys of the authorization server
METADATA = (".well-known/oauth-authorization-server", ".well-known/openid-configuration")
logger = logging.getLogger(__name__)


class JwtVerifier:
    """Verifies JSON web tokens of one issuer for one audience (the SDK's TokenVerifier).

    issuer: URL of the authorization server, as its tokens write it in `iss`. audience: URL of this server's /mcp, as
    they write it in `aud`. Raises TokenError where the issuer publishes no keys.
    """

    def __init__(self, issuer: str, audience: str) -> None:
        for url in (issuer, audience):
            place = urlsplit(url)
            if place.scheme != "https" and not (place.scheme == "http" and is_loopback(place.hostname or "")):
                raise TokenError(f"{url} must be an https:// URL (http:// on loopback only)")
        self._issuer = issuer
        self._audience = audience
        self._keys = jwt.PyJWKClient(_keys_of(issuer), timeout=FETCH_SECONDS)
        # Threads of their own: tokens with unknown keys, which anyone can send, must not hold up the tools.
        self._threads = anyio.CapacityLimiter(2)

    async def verify_token(self, token: str) -> AccessToken | None:
        """Return whose token it is, or None for one that is not valid here and now."""
        try:
            claims = await anyio.to_thread.run_sync(self._claims, token, limiter=self._threads)
        except jwt.PyJWTError as error:
            logger.info("an access token was refused: %s", type(error).__name__)
            return None
        scope = claims.get("scope", "")
        return AccessToken(
            token="",
            client_id=str(claims.get("client_id") or claims.get("azp") or claims["sub"]),
            scopes=scope.split() if isinstance(scope, str) else [],
            expires_at=int(claims["exp"]),
            resource=self._audience,
            subject=str(claims["sub"]),
            claims={"iss": self._issuer},
        )

    def _claims(self, token: str) -> dict[str, Any]:
        key = self._keys.get_signing_key_from_jwt(token)
        claims: dict[str, Any] = jwt.decode(
            token,
            key.key,
            algorithms=ALGORITHMS,
            audience=self._audience,
            issuer=self._issuer,
            leeway=LEEWAY,
            options={"require": ["exp", "iss", "aud", "sub"]},
        )
        return claims


def metadata_routes(issuer: str, audience: str) -> list[Route]:
    """Return the routes that say where clients get tokens (RFC 9728)."""
    return create_protected_resource_routes(AnyHttpUrl(audience), [AnyHttpUrl(issuer)])


def challenge(audience: str) -> str:
    """Return the parameter of WWW-Authenticate that points to `metadata_routes`."""
    return f'resource_metadata="{build_resource_metadata_url(AnyHttpUrl(audience))}"'


def _keys_of(issuer: str) -> str:
    for place in METADATA:
        try:
            with urllib.request.urlopen(_well_known(issuer, place), timeout=FETCH_SECONDS) as response:
                metadata = json.load(response)
        except (OSError, ValueError):
            continue
        # RFC 8414 3.3: metadata of another issuer must not be used.
        if isinstance(metadata, dict) and metadata.get("issuer") == issuer and "jwks_uri" in metadata:
            return str(metadata["jwks_uri"])
    raise TokenError(f"{issuer} publishes no metadata with its keys at {' or '.join(METADATA)}")


def _well_known(issuer: str, place: str) -> str:
    # RFC 8414 puts the well-known part before the issuer's path, OpenID Connect after it.
    url = urlsplit(issuer)
    path = url.path.rstrip("/")
    path = f"/{place}{path}" if "oauth" in place else f"{path}/{place}"
    return url._replace(path=path).geturl()
