"""Files that are not sound videos get an error that says what is wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from atw_mcp.perception.observe import observe
from atw_mcp.perception.video import VideoError, probe, read_frames
from tests.atw_mcp.clips import write_film
from tests.atw_mcp.perception.clips import HEIGHT, WIDTH, Clip, Disc, render


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    disc = Disc(lambda t: (40 + 4.0 * t, 80), 12, (40, 40, 170))
    return render(tmp_path_factory.mktemp("video") / "moving.mp4", [disc], 24)


def test_probe_reports_what_decodes(clip: Clip) -> None:
    info = probe(clip.path)
    assert (info.frame_count, info.width, info.height, info.frames_per_second) == (24, WIDTH, HEIGHT, 25.0)
    assert len(info.sha256) == 64
    assert info.warnings == ()


def test_frames_come_in_the_order_asked_and_match_what_was_drawn(clip: Clip) -> None:
    frames = read_frames(clip.path, [20, 3])
    assert frames.shape == (2, HEIGHT, WIDTH, 3)
    for got, number in zip(frames, (20, 3), strict=True):
        difference = {n: float(np.abs(got.astype(int) - clip.frames[n].astype(int)).mean()) for n in range(24)}
        assert min(difference, key=difference.__getitem__) == number
    assert read_frames(clip.path, stride=5).shape[0] == 5


@pytest.mark.parametrize("call", [probe, read_frames, observe])
def test_missing_file_names_the_nearest(clip: Clip, call: Callable[[Path], object]) -> None:
    with pytest.raises(VideoError, match=r"moving\.mp4"):
        call(clip.path.with_name("movin.mp4"))


def test_unreadable_files_are_refused(clip: Clip, tmp_path: Path) -> None:
    empty, text, cut = tmp_path / "empty.mp4", tmp_path / "text.mp4", tmp_path / "cut.mp4"
    empty.touch()
    text.write_text("not a video at all, only words")
    cut.write_bytes(clip.path.read_bytes()[:2000])
    with pytest.raises(VideoError, match="0 bytes"):
        probe(empty)
    with pytest.raises(VideoError, match="not a video"):
        probe(text)
    with pytest.raises(VideoError, match=r"not a video|no frame"):
        probe(cut)
    with pytest.raises(VideoError, match="folder"):
        probe(tmp_path)


def test_video_cut_short_is_read_as_far_as_it_goes_with_a_warning(clip: Clip, tmp_path: Path) -> None:
    path = write_film(tmp_path / "cut.avi", clip.frames, code="MJPG")
    data = path.read_bytes()
    path.write_bytes(data[: int(0.6 * len(data))])
    info = probe(path)
    assert 0 < info.frame_count < 24
    assert any("truncated" in w for w in info.warnings)
    assert any("truncated" in w for w in observe(path).warnings)


def test_frame_outside_the_video_names_the_range(clip: Clip) -> None:
    with pytest.raises(VideoError, match=r"0\.\.23"):
        read_frames(clip.path, [24])


def test_too_many_frames_are_refused_with_a_way_out(tmp_path: Path) -> None:
    path = write_film(tmp_path / "long.avi", (np.full((16, 16, 3), 10 * (k % 20)) for k in range(2001)), code="MJPG")
    with pytest.raises(VideoError, match="stride"):
        read_frames(path)
    assert len(read_frames(path, stride=3)) == 667
