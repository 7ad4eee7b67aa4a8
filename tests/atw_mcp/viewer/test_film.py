"""Frame i of a film is frame i of the file, whoever plays it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from atw_mcp.cases.cases import content_hash
from atw_mcp.perception.decoding import media_times
from atw_mcp.perception.video import read_frames
from atw_mcp.viewer import film as films
from atw_mcp.viewer.document import Film
from atw_mcp.viewer.packing import Blocks
from evidence_store import Case
from tests.atw_mcp.clips import write_film

COUNT, WIDTH, HEIGHT = 14, 64, 48


def case_of(path: Path) -> Case:
    return Case("c", content_hash(path), "video", str(path), {}, None)


def drawn(count: int = COUNT, width: int = WIDTH, height: int = HEIGHT) -> list[NDArray[np.uint8]]:
    """Frames that differ: a square moves over a ramp."""
    ramp = np.tile(np.linspace(40, 120, width), (height, 1))[..., None].repeat(3, axis=2).astype(np.uint8)
    frames = [ramp.copy() for _ in range(count)]
    for i, frame in enumerate(frames):
        frame[12:28, 3 * i : 3 * i + 14] = (30, 80, 240)
    return frames


def made(path: Path, folder: Path, covered: int = 0) -> tuple[Film, NDArray[np.uint8], Path]:
    """The film of a file, its frames as they decode, and the file it was written to."""
    blocks = Blocks()
    film, why = films.film(case_of(path), path, blocks, covered)
    assert film is not None, why
    assert film.data is not None
    out = folder / "film"
    out.write_bytes(blocks.joined()[film.data.offset : film.data.offset + film.data.shape[0]])
    times = np.frombuffer(blocks.joined(), "<f4", film.frame_count, film.media_times.offset)
    assert times == pytest.approx(media_times(out), abs=1e-4)
    return film, read_frames(out), out


def nearest(frame: NDArray[Any], others: NDArray[Any]) -> int:
    return int(np.argmin(((others.astype(float) - frame.astype(float)) ** 2).mean(axis=(1, 2, 3))))


def test_transcoded_frames_are_the_originals_in_order(tmp_path: Path) -> None:
    source = write_film(tmp_path / "a.mp4", drawn(), rate=30)
    film, frames, out = made(source, tmp_path)
    originals = read_frames(source)
    assert film.mime.startswith("video/webm")
    assert b"webm" in out.read_bytes()[:64]
    assert "mpeg4" in film.note
    assert [nearest(frame, originals) for frame in frames] == list(range(COUNT))
    errors = ((frames.astype(float) - originals) ** 2).mean(axis=(1, 2, 3))
    assert errors.max() < 255.0**2 / 1e3  # 30 dB: compression artefacts are hardly seen
    first = out.read_bytes()
    assert made(source, tmp_path)[2].read_bytes() == first


def webm_with_late_frame(folder: Path) -> Path:
    """A file that browsers play, 25 frames a second, but frame 5 comes 15 ms late: of a camera that hesitates."""
    changed = bytearray(
        write_film(folder / "a.mkv", drawn(), code="VP80").read_bytes().replace(films.MATROSKA, films.WEBM, 1)
    )
    at = changed.index(b"\x81" + (200).to_bytes(2, "big"))  # a simple block states its time after its cluster [ms]
    changed[at + 1 : at + 3] = (215).to_bytes(2, "big")
    made_here = folder / "a.webm"
    made_here.write_bytes(changed)
    return made_here


def test_file_that_browsers_play_is_passed_on_with_its_own_frame_times(tmp_path: Path) -> None:
    source = webm_with_late_frame(tmp_path)
    film, frames, out = made(source, tmp_path)
    assert out.read_bytes() == source.read_bytes()
    assert len(frames) == film.frame_count == COUNT
    assert media_times(out)[4:7] == pytest.approx([0.16, 0.215, 0.24])


def test_long_video_is_cut_to_what_is_covered_and_reduced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(films, "MOST_PIXELS", 5 * WIDTH * HEIGHT)
    monkeypatch.setattr(films, "SHORTEST_LONG_SIDE", 16)
    source = write_film(tmp_path / "a.mp4", drawn(), rate=30)
    film, frames, _ = made(source, tmp_path, covered=10)
    assert film.frame_count == 10
    assert "frames 0 to 9 of 14" in film.note
    assert (film.width, film.height) == (WIDTH, HEIGHT)  # outlines refer to the original frame
    assert frames.shape[1] * frames.shape[2] * 10 <= 1.2 * 5 * WIDTH * HEIGHT


def test_film_above_its_size_is_reduced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (4, 96, 128, 3), dtype=np.uint8)
    source = write_film(tmp_path / "a.mp4", list(noise), rate=30)
    _, _, out = made(source, tmp_path)
    monkeypatch.setattr(films, "MAX_BYTES", out.stat().st_size // 2)
    monkeypatch.setattr(films, "SHORTEST_LONG_SIDE", 16)
    _, frames, out = made(source, tmp_path)
    assert out.stat().st_size <= films.MAX_BYTES
    assert frames.shape[2] < 128


def test_absent_changed_or_damaged_video_says_what_is_missing(tmp_path: Path) -> None:
    source = write_film(tmp_path / "a.mp4", drawn(3), rate=30)
    case = case_of(source)
    assert films.film(case, tmp_path / "moved.mp4", Blocks())[1].startswith("The video is not shown: moved.mp4 is not")
    source.write_bytes(source.read_bytes() + b"\0")
    shown, why = films.film(case, source, Blocks())
    assert shown is None
    assert "a.mp4 has changed since the case was opened" in why
    source.write_bytes(b"no video at all" * 9)
    shown, why = films.film(case_of(source), source, Blocks())
    assert shown is None
    assert "a.mp4 is not a video file" in why
    assert str(tmp_path) not in why
