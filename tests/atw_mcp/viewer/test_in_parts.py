"""A case read by resources, as the viewer in an MCP host reads it."""

from __future__ import annotations

import base64
import json
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

import anyio
import numpy as np
import pytest
from mcp import Client
from mcp.shared.exceptions import MCPError

from atw_mcp.calls.app import App
from atw_mcp.server import build_server
from atw_mcp.viewer import in_parts
from atw_mcp.viewer.case_document import case_document
from atw_mcp.viewer.packing import packed, unpacked
from tests.atw_mcp.clips import FRAMES, write_clip
from tests.atw_mcp.session import Session
from tests.atw_mcp.two_discs import case_with, two_discs

ADDRESS = "atw://view/discs"


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """A store with a committed world and two rollouts of it."""
    session = Session(tmp_path_factory.mktemp("parts") / "atw.db")
    case_with(App(session.store), two_discs(), committed=True)
    session("Rollout", case="discs", horizon_seconds=0.4)
    session("Rollout", case="discs", horizon_seconds=0.2)
    return session


async def whole(client: Client, address: str, contents: dict[str, Any], query: str = "") -> bytes:
    texts = []
    for number in range(contents["parts"]):
        blob: Any = (await client.read_resource(f"{address}/{contents['digest']}/{number}{query}")).contents[0]
        assert blob.mime_type == "application/octet-stream"
        texts.append(blob.blob)
    return base64.b64decode("".join(texts))  # texts join where each part but the last is a multiple of 3 bytes


async def contents_of(client: Client, address: str) -> dict[str, Any]:
    found: Any = (await client.read_resource(address)).contents[0]
    read: dict[str, Any] = json.loads(found.text)
    return read


@pytest.mark.parametrize("mode", ["auto", "legacy"])
def test_parts_join_to_the_packed_document(
    session: Session, monkeypatch: pytest.MonkeyPatch, mode: Literal["auto", "legacy"]
) -> None:
    monkeypatch.setattr(in_parts, "PART", 300)
    store = App(session.store).store
    rollouts = [row.rollout for row in store.evidence.of_case("discs")]
    query = f"?rollouts={rollouts[1]},{rollouts[0]}"

    async def read() -> bytes:
        async with Client(session.server, mode=mode) as client:
            contents = await contents_of(client, ADDRESS + query)
            assert contents["film"] is None
            assert contents["document"]["parts"] > 2
            data = await whole(client, ADDRESS, contents["document"], query)
            assert len(data) == contents["document"]["bytes"]
            assert sha256(data).hexdigest() == contents["document"]["digest"]
            return data

    data = anyio.run(read)
    assert data == packed(*case_document(store, "discs", first=[str(rollouts[1]), str(rollouts[0])]))
    assert unpacked(data)[0].shown == [rollouts[1], rollouts[0]]


def test_parts_are_of_one_state_of_the_case(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(in_parts, "PART", 3000)

    async def read() -> None:
        async with (
            Client(session.server) as client,
            Client(build_server(session.store)) as other,
            Client(build_server(session.store)) as late,
        ):
            before = (await contents_of(client, ADDRESS))["document"]
            first = await whole(other, ADDRESS, before)  # a server that did not make it makes the same
            await client.call_tool("ReadEvents", {"rollout": unpacked(first)[0].rollouts[0].id})
            after = (await contents_of(client, ADDRESS))["document"]
            assert after["digest"] != before["digest"]
            assert await whole(client, ADDRESS, before) == first  # which it still has
            with pytest.raises(MCPError, match=r"has changed\. Read atw://view/discs again"):
                await whole(late, ADDRESS, before)

    anyio.run(read)


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("atw://view/nothing", "no case 'nothing'"),
        (f"{ADDRESS}?rollouts=rollout-0", "has no rollout 'rollout-0'"),
        (f"{ADDRESS}/{'0' * 64}/0", "no part 0 of 000000000000"),
        (f"{ADDRESS}/{'0' * 64}/first", "a part is a number from 0, got 'first'"),
    ],
)
def test_what_is_not_there_is_refused(session: Session, address: str, why: str) -> None:
    async def read() -> None:
        async with Client(session.server) as client:
            with pytest.raises(MCPError, match=why):
                await client.read_resource(address)

    anyio.run(read)


def test_a_film_is_read_apart_and_one_that_has_moved_is_missing(tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "discs.mp4")
    session = Session(tmp_path / "atw.db")
    session("OpenCase", video=str(clip), name="discs")

    async def read() -> tuple[Any, bytes, dict[str, Any]]:
        async with Client(session.server) as client:
            contents = await contents_of(client, ADDRESS)
            document = unpacked(await whole(client, ADDRESS, contents["document"]))
            film = await whole(client, ADDRESS, contents["film"]) if contents["film"] else b""
            return document, film, contents

    (document, arrays), film, contents = anyio.run(read)
    assert document.film is not None
    assert (document.film.data, document.film.url, document.film.mime) == (None, None, contents["film"]["mime"])
    assert film.startswith(b"\x1a\x45\xdf\xa3")  # WebM, as browsers do not play the clip's codec
    times = arrays[document.film.media_times.offset]
    assert times.shape == (FRAMES,)
    np.testing.assert_allclose(np.diff(times), 0.04, atol=1e-3)
    clip.rename(tmp_path / "elsewhere.mp4")
    (document, _), film, contents = anyio.run(read)
    assert (document.film, film, contents["film"]) == (None, b"", None)
    assert [sentence for sentence in document.missing if sentence.startswith("The video is not shown: nothing at")]
