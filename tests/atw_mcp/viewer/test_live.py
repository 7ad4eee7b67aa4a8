"""The live page: who may read it, what it serves, and that it reports what other connections add."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import anyio
import numpy as np
import pytest
from mcp_types import CallToolResult
from starlette.testclient import TestClient

from atw_mcp.calls.app import App
from atw_mcp.calls.error_curve import ErrorCurve
from atw_mcp.cases.cases import content_hash
from atw_mcp.cli import main
from atw_mcp.tools.control import read_evidence
from atw_mcp.viewer import page
from atw_mcp.viewer.live.access import Access
from atw_mcp.viewer.live.content import CaseFollower, LiveContent
from atw_mcp.viewer.live.site import Site
from atw_mcp.viewer.packing import unpacked
from evidence_store import Evidence, EvidenceStore
from evidence_store.export import export_case, import_case
from evidence_store.schema import VERSION
from tests.atw_mcp.clips import write_film

TOKEN, PORT = "token-of-this-test", 4321
HERE = f"http://127.0.0.1:{PORT}"
POLICY = "default-src 'none'; connect-src 'self'"


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[EvidenceStore]:
    """A store with a case that has a video of 3 frames, and another without a file, named to be hard to serve."""
    video = write_film(tmp_path / "ball.mp4", (np.full((48, 64, 3), 40 * number) for number in range(3)))
    store = EvidenceStore(tmp_path / "atw.db")
    store.cases.add("ball", content=content_hash(video), kind="video", path=str(video), facts={})
    store.cases.add("a/b <i>", content="described", kind="data", path="", facts={})
    yield store
    store.close()


@pytest.fixture
def site(writer: EvidenceStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    built = tmp_path / "viewer.html"
    built.write_text(f'<meta http-equiv="Content-Security-Policy" content="{POLICY}"><div id="app"></div>{page.PLACE}')
    monkeypatch.setattr(page, "FILE", built)
    store = EvidenceStore.to_read(writer.path)
    made = Site(store)
    yield made
    made.close()
    store.close()


@pytest.fixture
def client(site: Site) -> TestClient:
    return TestClient(Access(site.app, TOKEN, PORT), base_url=HERE, follow_redirects=False)


@pytest.mark.parametrize(
    ("method", "path", "headers", "status"),
    [
        ("GET", f"/{TOKEN}/ball/", {}, 200),
        ("GET", f"/{TOKEN}/ball/", {"Host": f"localhost:{PORT}"}, 200),
        ("GET", "/", {}, 404),
        ("GET", f"/{TOKEN}", {}, 404),
        ("GET", "/another-token/ball/", {}, 404),
        ("GET", f"/{TOKEN}x/ball/document", {}, 404),
        ("GET", f"/{TOKEN}/ball", {}, 404),
        ("GET", f"/{TOKEN}/none/", {}, 404),
        ("GET", f"/{TOKEN}/ball/", {"Host": "evil.example"}, 403),
        ("GET", f"/{TOKEN}/ball/", {"Host": "127.0.0.1"}, 403),
        ("GET", f"/{TOKEN}/ball/document", {"Origin": "https://evil.example"}, 403),
        ("GET", f"/{TOKEN}/ball/document", {"Origin": HERE}, 200),
        ("POST", f"/{TOKEN}/ball/", {}, 405),
        ("DELETE", f"/{TOKEN}/ball/document", {}, 405),
        ("POST", f"/{TOKEN}/ball/notes", {}, 403),
        ("POST", f"/{TOKEN}/ball/notes", {"Origin": "null", "Content-Type": "application/json"}, 403),
        ("POST", f"/{TOKEN}/ball/notes", {"Origin": "https://evil.example", "Content-Type": "application/json"}, 403),
        ("POST", f"/{TOKEN}/ball/notes", {"Origin": HERE, "Content-Type": "text/plain"}, 403),
        ("POST", f"/{TOKEN}/ball/notes", {"Origin": HERE, "Content-Type": "application/json"}, 413),
        ("POST", "/another-token/ball/notes", {"Origin": HERE, "Content-Type": "application/json"}, 413),
        ("PUT", f"/{TOKEN}/ball/notes", {"Origin": HERE, "Content-Type": "application/json"}, 405),
    ],
)
def test_only_readers_with_the_address_are_answered(
    client: TestClient, method: str, path: str, headers: dict[str, str], status: int
) -> None:
    reply = client.request(method, path, headers=headers)
    assert reply.status_code == status
    assert reply.headers["cache-control"] == "no-store"
    assert reply.headers["x-content-type-options"] == "nosniff"
    assert reply.headers["referrer-policy"] == "no-referrer"
    assert "frame-ancestors 'none'" in reply.headers["content-security-policy"]
    assert "access-control-allow-origin" not in reply.headers


def test_the_page_of_a_case_is_the_viewer_that_asks_for_its_document(client: TestClient) -> None:
    reply = client.get(f"/{TOKEN}/ball/")
    assert '<meta name="atw-live">' in reply.text
    assert reply.headers["content-security-policy"] == f"{POLICY}; frame-ancestors 'none'"


def test_the_list_links_every_case_newest_first(client: TestClient) -> None:
    text = client.get(f"/{TOKEN}/").text
    assert text.index("a%2Fb%20%3Ci%3E/") < text.index('href="ball/"')
    assert "a/b &lt;i&gt;" in text
    assert client.get(f"/{TOKEN}/a%2Fb%20%3Ci%3E/document").status_code == 200


def test_the_document_is_kept_until_records_change_and_names_its_revision(
    client: TestClient, site: Site, writer: EvidenceStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = client.get(f"/{TOKEN}/ball/document")
    made: list[str] = []
    build = site._content._packed
    monkeypatch.setattr(site._content, "_packed", lambda case: made.append(case) or build(case))  # type: ignore[func-returns-value]
    again = client.get(f"/{TOKEN}/ball/document")
    assert (again.content, again.headers["etag"]) == (first.content, first.headers["etag"])
    work = writer.evidence.add(Evidence("FitWorld", {}, case="ball", status="running"))
    writer.jobs.start(work.id, "key")
    writer.evidence.add(Evidence("Rollout", {}, case="a/b <i>"))
    changed = client.get(f"/{TOKEN}/ball/document")
    assert changed.headers["etag"] != first.headers["etag"]
    writer.jobs.beat(work.id, 0.5, 1.0, "half")  # progress alone makes no new document
    assert client.get(f"/{TOKEN}/ball/document").headers["etag"] == changed.headers["etag"]
    assert made == ["ball"]
    document, _ = unpacked(changed.content)
    assert [row.id for row in document.evidence] == [work.id]
    assert [item.evidence for item in document.running] == [work.id]
    assert document.film is not None
    assert (document.film.url, document.film.data, document.film.frame_count) == ("film", None, 3)


def test_a_note_is_kept_as_evidence_read_by_the_tools_and_exported(
    client: TestClient, writer: EvidenceStore, tmp_path: Path
) -> None:
    note = {"text": " it slips here ", "time": 1.25, "object": "ball", "rollout": None}
    at, own = f"/{TOKEN}/ball/notes", {"Origin": HERE}
    for wrong, status in (
        ({**note, "text": " "}, 422),
        ({**note, "time": -1.0}, 422),
        ({**note, "by": "me"}, 422),
        ({**note, "rollout": "rollout-0"}, 404),
        ({**note, "text": "x" * 20_000}, 413),
    ):
        assert client.post(at, json=wrong, headers=own).status_code == status
    assert client.post(f"/{TOKEN}/none/notes", json=note, headers=own).status_code == 404
    assert client.post("/another-token/ball/notes", json=note, headers=own).status_code == 404
    assert not writer.evidence.of_case("ball")
    reply = client.post(at, json=note, headers=own)
    assert reply.status_code == 201
    document, _ = unpacked(client.get(f"/{TOKEN}/ball/document").content)
    (row,) = document.evidence
    assert (row.id, row.tool, row.summary, row.interval) == (reply.text, "Note", "it slips here", [1.25, 1.25])
    file = tmp_path / "ball.zip"
    export_case(writer, "ball", file)
    other = EvidenceStore(tmp_path / "other.db")
    import_case(other, file)
    (kept,) = other.evidence.of_case("ball")
    other.close()
    assert (kept.summary, kept.interval, kept.objects) == ("it slips here", (1.25, 1.25), ("ball",))
    app = App(writer.path)
    listed = read_evidence(app, case="ball", interval=[1.0, 2.0], wait_seconds=0.0)
    again = read_evidence(app, evidence=reply.text)
    app.close()
    assert isinstance(listed, CallToolResult)
    assert isinstance(again, CallToolResult)
    assert "it slips here" in str(listed.structured_content)
    assert again.structured_content is not None
    assert again.structured_content["data"]["written_by"] == "a person, in the viewer"


def test_the_film_is_served_whole_or_in_ranges(client: TestClient) -> None:
    whole = client.get(f"/{TOKEN}/ball/film")
    assert whole.headers["content-type"].startswith("video/")
    size = len(whole.content)
    part = client.get(f"/{TOKEN}/ball/film", headers={"Range": "bytes=5-9"})
    assert (part.status_code, part.content) == (206, whole.content[5:10])
    assert part.headers["content-range"] == f"bytes 5-9/{size}"
    end = client.get(f"/{TOKEN}/ball/film", headers={"Range": "bytes=-4"})
    assert end.content == whole.content[-4:]
    assert client.get(f"/{TOKEN}/ball/film", headers={"Range": f"bytes={size}-"}).status_code == 416
    assert client.get(f"/{TOKEN}/a%2Fb%20%3Ci%3E/film").status_code == 404


def test_a_stream_tells_of_records_and_progress_from_another_connection(site: Site, writer: EvidenceStore) -> None:
    async def follow() -> list[dict[str, Any]]:
        events = site._events("ball")
        found = []

        async def state() -> None:
            text = await anext(events)
            assert text.startswith("event: state\ndata: ")
            found.append(json.loads(text.split("data: ", 1)[1]))

        with anyio.fail_after(10):
            await state()
            work = writer.evidence.add(Evidence("FitWorld", {}, case="ball", status="running", summary="fitting"))
            writer.jobs.start(work.id, "key")
            await state()
            curve = ErrorCurve("generation", "m")
            curve.add(0.004, 0.003)
            writer.jobs.beat(work.id, 1.0, 4.0, "generation 1 of 4, about 2.5 min left", curve.to_dict())
            await state()
            writer.jobs.finish(work.id)
            await state()
        await events.aclose()
        return found

    first, started, moved, ended = anyio.run(follow)
    assert first["running"] == []
    assert started["revision"] != first["revision"]
    assert moved["revision"] == started["revision"]
    (work,) = moved["running"]
    assert (work["tool"], work["done"], work["total"]) == ("FitWorld", 1.0, 4.0)
    assert (work["message"], work["seconds_left"]) == ("generation 1 of 4", 150.0)
    assert work["curve"]["best"] == [0.003]
    assert ended["running"] == []


def test_follower_notices_that_the_store_was_renamed(writer: EvidenceStore) -> None:
    store = EvidenceStore.to_read(writer.path)
    follower = CaseFollower(LiveContent(store), "ball")
    assert not follower.gone()
    elsewhere = writer.path.rename(writer.path.with_name("elsewhere.db"))
    assert follower.gone()
    writer.path.write_bytes(elsewhere.read_bytes())  # another file, which it does not follow
    assert follower.gone()
    writer.path.unlink()
    elsewhere.rename(writer.path)
    assert not follower.gone()
    follower.close()
    store.close()


@pytest.mark.parametrize(("version", "said"), [(VERSION + 1, "update atw-mcp"), (1, "doctor")])
def test_view_refuses_stores_of_other_versions(
    version: int, said: str, writer: EvidenceStore, capsys: pytest.CaptureFixture[str]
) -> None:
    with writer.connection.write() as database:
        database.conn.execute(f"PRAGMA user_version = {version}")
    assert main(["view", "ball", "--no-browser", "--store", str(writer.path)]) == 1
    assert said in capsys.readouterr().err


@pytest.mark.usefixtures("site")
def test_view_refuses_what_is_not_there(
    writer: EvidenceStore, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", "none", "--no-browser", "--store", str(writer.path)]) == 1
    assert "no case 'none'; cases: ['ball', 'a/b <i>']" in capsys.readouterr().err
    assert main(["view", "--no-browser", "--store", str(tmp_path / "absent.db")]) == 1
    assert "there is no evidence store" in capsys.readouterr().err
    assert not (tmp_path / "absent.db").exists()
    assert main(["view", "ball", "--port", "70000", "--no-browser", "--store", str(writer.path)]) == 1
    assert "70000 is no port" in capsys.readouterr().err
