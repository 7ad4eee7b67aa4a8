"""Bearer tokens of HTTP clients: read from a file or the environment, never from the command line."""

from __future__ import annotations

import hashlib
import hmac
import os
import re
import stat
from collections.abc import Mapping
from pathlib import Path

from mcp.server.auth.provider import AccessToken

VARIABLE = "ATW_MCP_TOKEN"
SHORTEST = 16  # characters: 64 bits even of hexadecimal digits
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


class TokenError(Exception):
    """Tokens that cannot be used. The message says why and what to do, and quotes no token."""


class Tokens:
    """Verifies tokens (the SDK's TokenVerifier). Each belongs to a named client.

    names: name of the client by token. Raises TokenError for a token that is short.
    """

    def __init__(self, names: Mapping[str, str]) -> None:
        if any(len(token) < SHORTEST or not token.isascii() or not token.isprintable() for token in names):
            raise TokenError(
                f"a token needs at least {SHORTEST} printable ASCII characters, for example from: openssl rand -hex 32"
            )
        self._clients = {_digest(token): name for token, name in names.items()}

    async def verify_token(self, token: str) -> AccessToken | None:
        """Return the client a token belongs to, or None, in a time that depends on no token."""
        given, found = _digest(token), None
        for digest, name in self._clients.items():  # no early end
            if hmac.compare_digest(digest, given):
                found = name
        return None if found is None else AccessToken(token="", client_id=found, scopes=[])


def read_tokens(file: Path | None, environment: Mapping[str, str] = os.environ) -> Tokens | None:
    """Read the tokens of `--token-file` or of the environment variable; None where neither is given.

    A line of the file is `TOKEN` or `NAME TOKEN`; # begins a comment. Raises TokenError.
    """
    if file is None:
        token = environment.get(VARIABLE, "").strip()
        return Tokens({token: "default"}) if token else None
    try:
        status = file.stat()
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise TokenError(f"the token file {file} cannot be read ({error})") from error
    if os.name == "posix" and status.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise TokenError(f"the token file {file} can be read by other users: chmod 600 {file}")
    names: dict[str, str] = {}
    for number, line in enumerate(lines, start=1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        name, token = (words[0], words[1]) if len(words) == 2 else ("default", words[0])
        if len(words) > 2 or not NAME.fullmatch(name) or token in names or name in names.values():
            raise TokenError(
                f"line {number} of the token file {file}: expected TOKEN, or NAME TOKEN with a name of letters, digits "
                "and ._- and each name and token once"
            )
        names[token] = name
    if not names:
        raise TokenError(f"the token file {file} holds no token: write TOKEN, or NAME TOKEN for each client, a line")
    return Tokens(names)


def _digest(token: str) -> bytes:
    return hashlib.sha256(token.encode("utf-8", errors="surrogatepass")).digest()
