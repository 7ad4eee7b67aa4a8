"""Films as cameras and programs write them: every frame upright, with square pixels, at the time that it was taken."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from atw_mcp.perception.video import VideoError, VideoInfo, load, probe
from tests.atw_mcp.session import Session
from tests.shared_inputs import INPUTS, needs_input

WIDTH, HEIGHT, RADIUS, SPEED = 160, 96, 9.0, 90.0  # [px], [px/s]
Picture = NDArray[np.uint8]


def drawn(time: float, *, width: int = WIDTH, stretch: float = 1.0) -> Picture:
    """A white disc on grey at 30 + SPEED t, 48 [px]; stretch: that of a pixel upwards."""
    picture = np.full((HEIGHT, width, 3), 90, np.uint8)
    y, x = np.mgrid[0:HEIGHT, 0:width].astype(float)
    inside = np.hypot(x / stretch - 30.0 - SPEED * time, y - 48.0) < RADIUS
    picture[inside] = 230
    return picture


def written(
    path: Path, pictures: Iterable[Picture], stamps: Sequence[int], *, codec: str = "mpeg4", **context: Any
) -> Path:
    """Write pictures with these time stamps [ms]; context: attributes of the coder."""
    options = context.pop("options", {})
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30, options=options)
        for k, picture in enumerate(pictures):
            if k == 0:
                stream.width, stream.height, stream.pix_fmt = picture.shape[1], picture.shape[0], "yuv420p"
                stream.bit_rate = 8_000_000
                for key, value in {"time_base": Fraction(1, 1000), **context}.items():
                    setattr(stream.codec_context, key, value)
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            frame.pts, frame.time_base = stamps[k], Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def places(frames: Picture) -> NDArray[np.float64]:
    """Centre x, y and extent across, up (T, 4) [px] of what is brighter than the ground."""
    found = []
    for frame in frames:
        y, x = np.nonzero(frame.min(axis=2) > 160)
        found.append((x.mean(), y.mean(), np.ptp(x) + 1, np.ptp(y) + 1))
    return np.array(found)


def times(info: VideoInfo, count: int) -> NDArray[np.float64]:
    moments = info.moments(range(count))
    return (np.arange(count) if moments is None else moments) / info.frames_per_second


def test_frames_of_a_variable_rate_keep_the_times_that_the_writer_gave(tmp_path: Path) -> None:
    gaps = np.random.default_rng(4).choice([17, 33, 50, 67], 20)
    stamps = [0, *np.cumsum(gaps).tolist()]
    film = written(tmp_path / "phone.mp4", (drawn(t / 1000) for t in stamps), stamps)
    info, frames = load(film)
    assert times(info, 21) == pytest.approx(np.array(stamps) / 1000, abs=1e-4)
    assert any("0.017 to 0.067 s apart" in w for w in info.warnings)
    slope = np.polyfit(times(info, 21), places(frames)[:, 0], 1)
    assert slope == pytest.approx([SPEED, 30.0], rel=0.01)


def test_stamps_rounded_to_milliseconds_are_a_constant_rate(tmp_path: Path) -> None:
    stamps = [round(1000 * k / 30) for k in range(20)]
    info = probe(written(tmp_path / "even.mkv", (drawn(k / 30) for k in range(20)), stamps))
    assert info.clock is None
    assert info.frames_per_second == pytest.approx(30.0, rel=1e-3)


@pytest.mark.parametrize("marked", [True, False])
def test_fields_of_an_interlaced_film_are_taken_apart(tmp_path: Path, marked: bool) -> None:
    """Each frame holds the lines of two instants; a comb of both would be SPEED / 60 = 6 px wider than the disc."""
    fast = 4.0  # times SPEED

    def woven(k: int) -> Picture:
        picture, later = drawn(fast * k / 30), drawn(fast * (k / 30 + 1 / 60))
        picture[::2] = later[::2]  # the lower field comes first
        return picture

    film = written(
        tmp_path / "interlaced.mpg",
        map(woven, range(9)),
        [round(1000 * k / 30) for k in range(9)],
        codec="mpeg2video",
        options={"flags": "+ildct+ilme"} if marked else {},
        time_base=Fraction(1, 30),
    )
    with av.open(str(film)) as container:
        assert all(frame.interlaced_frame == marked for frame in container.decode(video=0))
    info, frames = load(film)
    seen = places(frames)
    assert len(frames) == 9
    assert any("deinterlaced" in warning for warning in info.warnings)
    assert seen[1:-1, 2] == pytest.approx(np.full(7, 2 * RADIUS), abs=2.0)
    slope = np.polyfit(times(info, 9)[1:-1], seen[1:-1, 0], 1)
    assert slope[0] == pytest.approx(fast * SPEED, rel=0.02)


@pytest.mark.parametrize("ratio", [Fraction(4, 3), Fraction(8, 9)])
def test_pixels_are_made_square(tmp_path: Path, ratio: Fraction) -> None:
    narrow = 2 * round(WIDTH / ratio / 2)
    pictures = (drawn(k / 30, width=narrow, stretch=float(1 / ratio)) for k in range(5))
    stamps = [round(1000 * k / 30) for k in range(5)]
    film = written(tmp_path / "dv.mp4", pictures, stamps, sample_aspect_ratio=ratio)
    _, frames = load(film)
    seen = places(frames)
    assert seen[:, 2].mean() == pytest.approx(seen[:, 3].mean(), abs=1.5)
    assert frames.shape[2] / frames.shape[1] == pytest.approx(narrow * ratio / HEIGHT, rel=0.01)


def test_film_of_a_turned_phone_is_upright(tmp_path: Path) -> None:
    """ISO 14496-12, 8.3.2: the matrix of the track header turns its pictures, here by 90 degrees clockwise."""
    film = written(tmp_path / "phone.mp4", (drawn(k / 30) for k in range(5)), [33 * k for k in range(5)])
    data = bytearray(film.read_bytes())
    at = data.index(b"tkhd") + 4 + 40
    one, turned = 0x10000, [0, 0x10000, 0, -0x10000 & 0xFFFFFFFF, 0, 0, HEIGHT << 16, 0, 0x40000000]
    assert data[at : at + 4] == one.to_bytes(4, "big")
    data[at : at + 36] = b"".join(value.to_bytes(4, "big") for value in turned)
    film.write_bytes(bytes(data))
    _, frames = load(film)
    assert frames.shape[1:3] == (WIDTH, HEIGHT)
    centre = places(frames[:1])[0]
    assert centre[:2] == pytest.approx([HEIGHT - 1 - 48, 30], abs=0.5)  # what was left is above


def test_film_of_repeated_pictures_says_how_fast_its_motion_is(tmp_path: Path) -> None:
    stamps = [17 * k for k in range(24)]
    twice = written(tmp_path / "a.mp4", (drawn(k // 2 / 30) for k in range(24)), stamps)
    info = probe(twice)
    assert info.shown_times == 2
    assert any("shown 2 times" in w and "29.4118 frames per second" in w for w in info.warnings)
    lost = written(tmp_path / "b.mp4", (drawn((k - (k == 7)) / 30) for k in range(24)), [33 * k for k in range(24)])
    info = probe(lost)
    assert info.shown_times == 1
    assert any("frames 7)" in w for w in info.warnings)


def test_body_that_stops_is_no_repeated_picture(tmp_path: Path) -> None:
    stops = written(tmp_path / "a.mp4", (drawn(min(k, 12) / 30) for k in range(24)), [33 * k for k in range(24)])
    info = probe(stops)
    assert info.shown_times == 1
    assert not any("repeat" in w for w in info.warnings)


def test_film_of_equal_frames_is_refused(tmp_path: Path) -> None:
    film = written(tmp_path / "still.mkv", (drawn(0.0) for _ in range(6)), [33 * k for k in range(6)], codec="ffv1")
    with pytest.raises(VideoError, match=r"all 6 frames .* are equal"):
        probe(film)


def animated(path: Path, durations: int | list[int]) -> Path:
    pictures = [Image.fromarray(drawn(k / 30)) for k in range(12)]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=durations, loop=0)
    return path


def test_animated_pictures_are_films(tmp_path: Path) -> None:
    """Delays of a GIF are whole hundredths of a second: 3, 3, 4 are 30 frames a second."""
    info, frames = load(animated(tmp_path / "a.gif", [30, 30, 40] * 4))
    assert info.clock is None
    assert info.frames_per_second == pytest.approx(30.0, rel=0.01)
    assert np.polyfit(times(info, 12), places(frames)[:, 0], 1)[0] == pytest.approx(SPEED, rel=0.02)
    info, frames = load(animated(tmp_path / "a.png", 40))
    assert (len(frames), info.frames_per_second) == (12, pytest.approx(25.0))
    with pytest.raises(VideoError, match="save it as APNG, GIF or MP4"):
        probe(animated(tmp_path / "a.webp", 40))


def test_folder_of_numbered_pictures_is_a_film_without_a_rate(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    for k in (8, 9, 10, 12, 13, 14):  # eleven is missing
        cv2.imwrite(str(folder / f"cam_{k}.png"), drawn((k - 8) / 30))
    info, frames = load(folder)
    assert info.frames_per_second == 0.0
    assert info.clock == (0.0, 1.0, 2.0, 4.0, 5.0, 6.0)
    assert places(frames)[:, 0] == pytest.approx(30 + SPEED * np.array(info.clock) / 30, abs=0.5)
    assert any("seconds_per_frame" in w for w in info.warnings)
    (folder / "other.png").write_bytes((folder / "cam_8.png").read_bytes())
    with pytest.raises(VideoError, match="no series of numbered pictures"):
        probe(folder)


def test_folder_of_pictures_is_a_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ATW_MCP_ALLOW", str(tmp_path))
    folder = tmp_path / "run"
    folder.mkdir()
    for k in range(8):
        cv2.imwrite(str(folder / f"{k:03d}.png"), drawn(k / 30))
    session = Session(tmp_path / "atw.db")
    case = session("OpenCase", video=str(folder))["case"]
    session("ObserveObjects", case=case)
    assert session("InspectFrames", case=case, frames=[3])["data"]["frames"] is not None
    length = {"first_pixel": [0, 90], "second_pixel": [100, 90], "length": 1.0, "view": "side"}
    session("CalibrateCamera", case=case, known_length=length)
    built = session("BuildWorld", case=case, seconds_per_frame=1 / 30, floor="none")
    assert built["data"]["seconds_per_frame"] == pytest.approx(1 / 30)
    refused = session.refused("OpenCase", video=f"file://{folder}")
    assert "address" in refused
    assert "path" in refused


def test_frames_of_an_observation_without_objects_are_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ATW_MCP_ALLOW", str(tmp_path))
    noise = np.random.default_rng(0)
    pictures = [noise.integers(88, 92, (HEIGHT, WIDTH, 3), dtype=np.uint8) for _ in range(8)]
    film = written(tmp_path / "empty.mp4", pictures, [33 * k for k in range(8)])
    session = Session(tmp_path / "atw.db")
    case = session("OpenCase", video=str(film))["case"]
    assert session("ObserveObjects", case=case)["data"]["objects"] == []
    assert "0 objects" in session("InspectFrames", case=case, frames=[0])["summary"]


FLIGHTS = {
    "video_control_no_line.mp4": 26,
    "video_vfr_dropped_frames.mp4": 21,
    "video_each_frame_twice_60fps.mp4": 52,
    "video_interlaced.mpg": 26,
    "video_interlaced_h264_avchd.mts": 26,
    "video_interlaced_mpeg4.avi": 26,
    "video_anamorphic_sar_4_3.mp4": 26,
    "video_rotation_metadata.mp4": 26,
    "video_hevc_10bit.mov": 26,
    "video_odd_size_rgb.mp4": 26,
}


@pytest.mark.parametrize("name", [pytest.param(n, marks=needs_input(n)) for n in FLIGHTS])
def test_red_ball_in_free_flight_moves_as_it_was_drawn(name: str) -> None:
    """100 px are 1 m: 1.5 m/s across, and 9.81 m/s^2 down.

    Those that are interlaced were drawn half a field, 1/120 s, after their stamps: both fields of a frame, looked at
    apart without any deinterlacing, have the ball there.
    """
    late = 1 / 120 if "interlaced" in name else 0.0
    info, frames = load(INPUTS / name)
    assert len(frames) == FLIGHTS[name]
    assert abs(info.width - 320) <= 1
    assert abs(info.height - 240) <= 1
    rows = range(0, len(frames), info.shown_times)
    when, seen = times(info, len(frames))[:: info.shown_times], []
    for k in rows:
        y, x = np.nonzero(frames[k, :, :, 2].astype(int) - frames[k, :, :, 1] > 60)
        seen.append((x.mean(), y.mean()))
    across, down = np.polyfit(when, np.array(seen), 2).T
    assert across[:2] == pytest.approx([0.0, 150.0], abs=1.0)
    assert 2 * down[0] == pytest.approx(981.0, abs=5.0)
    assert down[1] == pytest.approx(-400.0 + 981.0 * late, abs=1.5)
    if late:
        assert [across[2], down[2]] == pytest.approx([30.0 + 150.0 * late, 200.0 - 400.0 * late], abs=0.3)


@needs_input("video_small.gif")
def test_small_gif_has_thirty_frames_a_second() -> None:
    info = probe(INPUTS / "video_small.gif")
    assert (info.frames_per_second, info.clock) == (30.0, None)


@needs_input("video_anim.webp")
def test_animated_webp_is_refused_with_the_cure() -> None:
    with pytest.raises(VideoError, match="save it as"):
        probe(INPUTS / "video_anim.webp")


@needs_input("video_vfr_dropped_frames.mp4")
def test_flight_filmed_at_a_variable_rate_is_not_damped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ATW_MCP_ALLOW", str(INPUTS))
    session = Session(tmp_path / "atw.db")
    case = session("OpenCase", video=str(INPUTS / "video_vfr_dropped_frames.mp4"))["case"]
    session("ObserveObjects", case=case)
    shown = session("InspectFrames", case=case, frames=[0, 1, 2, 20])["data"]
    assert shown["times"] == pytest.approx([0.0, 2 / 30, 3 / 30, 25 / 30], abs=1e-4)
    length = {"first_pixel": [100, 200], "second_pixel": [200, 200], "length": 1.0, "view": "side"}
    session("CalibrateCamera", case=case, known_length=length)
    session("BuildWorld", case=case, floor="none")
    motion = session("InspectObservedMotion", case=case, object="red_sphere", quantities=["velocity"])["data"]
    first = motion["derived"]["rows"][0]
    assert [first[2][0], first[4][0]] == pytest.approx([1.5, 4.0], abs=0.02)
    fitted = session("FitWorld", case=case, patience_seconds=300)["data"]
    damping = next(v for v in fitted["values"] if v["name"] == "linear_damping")
    assert damping["interval80"][0] == 0.0
    assert damping["value"] < 0.03
    assert fitted["position_rmse"] < 0.003
    error = session("InspectRollout", case=case)["data"]["error"]
    assert error["position_rmse"] == pytest.approx(fitted["position_rmse"], rel=0.1)
