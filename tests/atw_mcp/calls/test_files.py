"""Files are read below the allowed folders only, and no refusal says what lies outside."""

from __future__ import annotations

import io
import os
import zipfile
from pathlib import Path

import anyio
import numpy as np
import pytest
from mcp import Client
from mcp_types import ListRootsResult, Root

from atw_mcp.calls.files import DEMO, VARIABLE, AllowedFiles, FileRefused, allowed_folders
from atw_mcp.calls.limits import Limits
from atw_mcp.calls.roots import local_path
from atw_mcp.perception.import_files import ImportDataError
from atw_mcp.perception.import_images import import_camera, import_depth
from atw_mcp.server import build_server
from tests.atw_mcp.connections import served_over_http, stdio_parameters
from tests.atw_mcp.session import Session

SECRET = "alice:x:0:0:secret"
KINDS = ("tracks", "recording", "points", "series", "masks", "camera", "depth", "mesh")


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """An allowed folder with a data file, and a foreign one with a secret."""
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    inside.mkdir()
    outside.mkdir()
    (inside / "t.csv").write_text("t,object,x,z\n0,a,0,0\n0.1,a,0,0\n")
    (outside / "accounts").write_text(SECRET)
    return inside, outside


@pytest.fixture
def session(tmp_path: Path, folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> Session:
    monkeypatch.setenv(VARIABLE, str(folders[0]))
    monkeypatch.chdir(folders[0])
    return Session(tmp_path / "store" / "atw.db")


def test_a_file_outside_is_refused_alike_whether_or_not_it_is_there(
    session: Session, folders: tuple[Path, Path]
) -> None:
    inside, outside = folders
    case = session("OpenCase", data=str(inside / "t.csv"))["case"]
    for kind in KINDS:
        there = session.refused("ImportObservation", case=case, kind=kind, path=str(outside / "accounts"))
        missing = session.refused("ImportObservation", case=case, kind=kind, path=str(outside / "accountz"))
        assert there.replace("accounts", "accountz") == missing
        assert "alice" not in there
        assert str(inside) in there
        assert "--allow DIR" in there
    for argument in ("video", "data"):
        refused = session.refused("OpenCase", **{argument: str(outside)})
        assert "accounts" not in refused
        assert "--allow DIR" in session.refused("OpenCase", **{argument: str(outside / "accounts")})


@pytest.mark.parametrize("path", ["/etc/passwd", "/proc/self/environ", "/dev/zero", "/sys/kernel/uevent_seqnum"])
def test_system_files_are_refused_even_where_everything_is_allowed(path: str, folders: tuple[Path, Path]) -> None:
    assert AllowedFiles([folders[0]], Limits()).resolve(str(folders[0] / "t.csv")).name == "t.csv"
    with pytest.raises(FileRefused, match="--allow"):
        AllowedFiles([folders[0]], Limits()).resolve(path)
    if not path.startswith("/etc"):
        with pytest.raises(FileRefused, match="--allow"):
            AllowedFiles([Path("/")], Limits()).resolve(path)


def test_links_are_resolved_before_the_check(session: Session, folders: tuple[Path, Path]) -> None:
    inside, outside = folders
    case = session("OpenCase", data="t.csv")["case"]
    (inside / "link.csv").symlink_to(outside / "accounts")
    (inside / "way").symlink_to(outside)
    (inside / "masks").mkdir()
    (inside / "masks" / "0.png").symlink_to(outside / "accounts")
    (inside / "good.csv").symlink_to(inside / "t.csv")
    for path in ("link.csv", "way/accounts", "../outside/accounts", "way", "masks"):
        for kind in ("tracks", "depth"):
            refused = session.refused("ImportObservation", case=case, kind=kind, path=path)
            assert "--allow DIR" in refused
            assert "alice" not in refused
    session("ImportObservation", case=case, kind="tracks", path="good.csv")


def test_what_is_no_regular_file_is_refused_and_not_waited_for(folders: tuple[Path, Path]) -> None:
    inside, _ = folders
    os.mkfifo(inside / "pipe")
    files = AllowedFiles([inside], Limits())
    with pytest.raises(FileRefused, match="neither a regular file nor a folder"):
        files.resolve(str(inside / "pipe"))
    (inside / "masks").mkdir()
    os.mkfifo(inside / "masks" / "0.png")
    with pytest.raises(FileRefused, match="not a regular file"), files.opened(str(inside / "masks")):
        pass


def test_a_file_is_read_as_opened_although_its_path_is_exchanged(folders: tuple[Path, Path]) -> None:
    inside, outside = folders
    path = inside / "t.csv"
    with AllowedFiles([inside], Limits()).opened(str(path)) as view:
        assert view.name == "t.csv"
        path.unlink()
        path.symlink_to(outside / "accounts")
        assert "object" in view.read_text()


def test_a_way_exchanged_between_check_and_opening_is_noticed(
    folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    inside, outside = folders
    (inside / "sub").mkdir()
    (inside / "sub" / "accounts").write_text("harmless")
    files = AllowedFiles([inside], Limits())
    opening = os.open

    def exchanged(path: Path, *rest: int, **more: int) -> int:
        if Path(path) == inside / "sub" / "accounts":
            (inside / "sub").rename(inside / "old")
            (inside / "sub").symlink_to(outside)
        return opening(path, *rest, **more)

    monkeypatch.setattr(os, "open", exchanged)
    with pytest.raises(FileRefused, match="changed while"), files.opened(str(inside / "sub" / "accounts")):
        pass


def test_a_folder_is_copied_with_its_links_to_allowed_files(folders: tuple[Path, Path]) -> None:
    inside, _ = folders
    (inside / "f" / "g").mkdir(parents=True)
    (inside / "f" / "g" / "a.csv").symlink_to(inside / "t.csv")
    with AllowedFiles([inside], Limits()).opened(str(inside / "f")) as view:
        assert (view / "g" / "a.csv").read_bytes() == (inside / "t.csv").read_bytes()
        assert not (view / "g" / "a.csv").is_symlink()
    for limits in (Limits(file_bytes=3), Limits(folder_files=1)):
        (inside / "f" / "b").write_bytes(b"1234")
        with pytest.raises(FileRefused, match="limit"), AllowedFiles([inside], limits).opened(str(inside / "f")):
            pass


def test_a_file_above_its_limit_is_refused_before_it_is_read(folders: tuple[Path, Path]) -> None:
    inside, _ = folders
    with (inside / "large.csv").open("wb") as file:
        file.truncate(10**12)
    files = AllowedFiles([inside], Limits())
    with pytest.raises(FileRefused, match=r"2,000,000,000 \(file_bytes\)"):
        files.file(str(inside / "large.csv"))
    with pytest.raises(FileRefused, match="text_bytes"), files.opened(str(inside / "large.csv"), "text_bytes"):
        pass


def test_archives_and_images_are_not_unpacked_beyond_their_limits(tmp_path: Path) -> None:
    claimed = io.BytesIO()
    np.lib.format.write_array_header_1_0(claimed, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("depth.npy", claimed.getvalue())
    with pytest.raises(ImportDataError, match=r"above the limit of 1\.5 GB"):
        import_depth(tmp_path / "a.npz")
    (tmp_path / "masks").mkdir()
    size = (100_000).to_bytes(4, "big")
    (tmp_path / "masks" / "0.png").write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + size + size)
    with pytest.raises(ImportDataError, match="100000 x 100000 pixels"):
        import_depth(tmp_path / "masks", metres_per_unit=0.001)
    (tmp_path / "deep.json").write_text("[" * 100_000)
    with pytest.raises(ImportDataError, match="nested too deeply"):
        import_camera(tmp_path / "deep.json")


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_that_is_not_what_it_should_be_is_not_quoted(
    kind: str, session: Session, folders: tuple[Path, Path]
) -> None:
    inside, _ = folders
    case = session("OpenCase", data="t.csv")["case"]
    for suffix in {"mesh": (".obj", ".glb", ".stl", ".ply"), "depth": (".npz",)}.get(kind, (".csv", ".json")):
        for content in (f"{SECRET}\nbob:x:1:1:other\n", f'{{"alice": "{SECRET}"}}'):
            (inside / f"f{suffix}").write_text(content)
            refused = session.refused("ImportObservation", case=case, kind=kind, path=f"f{suffix}")
            assert "alice" not in refused
            assert "secret" not in refused
            assert "atw-read-" not in refused


def test_playlists_that_name_other_files_are_no_videos(session: Session, folders: tuple[Path, Path]) -> None:
    inside, outside = folders
    for head in ("#EXTM3U\n#EXTINF:1,\n", "ffconcat version 1.0\nfile ", "v=0\no=- 0 0 IN IP4 127.0.0.1\n"):
        (inside / "a.mp4").write_text(f"{head}{outside / 'accounts'}\n")
        assert "not a video file" in session.refused("OpenCase", video="a.mp4")


def test_a_case_of_a_folder_that_is_allowed_no_more_is_listed_by_its_file_name(
    session: Session, folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    inside, outside = folders
    session("OpenCase", data="t.csv")
    monkeypatch.setenv(VARIABLE, str(outside))
    monkeypatch.chdir(outside)
    other = Session(session.store)
    (listed,) = other("OpenCase")["data"]["cases"]
    assert listed["path"] == "t.csv"
    assert str(inside) not in str(other("OpenCase", case=listed["case"]))


def test_the_demo_is_readable_and_a_working_folder_only_where_it_means_something(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.chdir("/")
    assert allowed_folders([]) == []
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert allowed_folders([]) == []
    assert allowed_folders([tmp_path]) == [tmp_path]
    files = AllowedFiles([], Limits())
    assert files.file(str(DEMO / "collision.mp4")).is_file()
    with pytest.raises(FileRefused, match="none but the shipped demo"):
        files.file(str(tmp_path / "a.mp4"))


def test_messages_hold_no_path_of_the_installation(tmp_path: Path) -> None:
    files = AllowedFiles([tmp_path], Limits())
    text = f"{os.__file__}: {tmp_path}/a b.csv: {__import__('numpy').__file__}"
    redacted = files.redacted(text)
    assert f"{tmp_path}/a b.csv" in redacted
    assert os.__file__ not in redacted
    assert "site-packages" not in redacted


def test_roots_of_a_client_on_stdio_may_be_read_and_those_of_one_over_http_not(
    folders: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inside, outside = folders
    (outside / "d.csv").write_text("t,object,x,y\n0,a,0,0\n")
    monkeypatch.setenv(VARIABLE, str(inside))

    async def roots(_: object) -> ListRootsResult:
        return ListRootsResult(roots=[Root(uri=outside.as_uri())])

    async def refused(server: object, offered: bool) -> bool:
        callback = roots if offered else None
        async with Client(server, mode="legacy", list_roots_callback=callback) as client:  # type: ignore[arg-type]
            return bool((await client.call_tool("OpenCase", {"data": str(outside / "d.csv")})).is_error)

    stdio = stdio_parameters(tmp_path / "a.db")
    assert anyio.run(refused, stdio, True) is False
    assert anyio.run(refused, build_server(tmp_path / "b.db"), False) is True
    with served_over_http(build_server(tmp_path / "c.db")) as url:
        assert anyio.run(refused, url, True) is True
    assert local_path("file:///a%20b") == Path("/a b")
    assert local_path("file://elsewhere/a") is None
    assert local_path("https://a/b") is None
