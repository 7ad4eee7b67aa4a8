"""The eye on six rendered clips of known shapes and on six real films, each body from one outline.

    python -m tests.benchmarks.eye [--sliding] [--films] [--only NAME] [--pictures FOLDER]

Data: ../shared/data/sliding, ../shared/data/films (README there). Errors of the clips are on the floor [cm] against
true positions, of body-frames of which at least 15% are in the picture; bodies are given by shape, size and colour
word. Of the films, centres are compared with references where there are some: colour centroids of the pucks, which
leave out their white rims; hand tracking of the cart along its incline, by the best line between centimetres and
pixels; a smooth curve of the ball that flies. wrong: frames whose error is more than half a radius with a confidence
above 0.8. noise: by third differences of a track.
"""

from __future__ import annotations

import argparse
import csv
import json
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from atw_mcp.perception.calibration import calibrate_from_points
from atw_mcp.perception.eye.bodies import Body, Solid
from atw_mcp.perception.eye.observe import Track, observe
from atw_mcp.perception.eye.seeds import Seed, outline_body
from atw_mcp.perception.video import read_frames

SHARED = Path(__file__).resolve().parents[2].parent / "shared" / "data"
SEEN = 0.15  # share of a silhouette in the picture from which on a body is to be found
CONFIDENT = 0.8

CUP = np.array([(-3.5, -2.0), (3.5, -2.0), (2.0, 2.0), (-2.0, 2.0)])
CUPS = [(177.5, 52.5), (188, 57), (203, 63.5), (213, 69), (227, 70.5), (238, 73), (250.5, 75), (262, 73.5)]
CART = [
    (209, 263),
    (219, 262),
    (338, 244),
    (343, 240),
    (350, 246),
    (357, 258),
    (358, 274),
    (343, 276),
    (224, 297),
    (210, 298),
    (206, 275),
]
FILMS: dict[str, list[Seed]] = {
    "BallDrop.mp4": [Seed("ball", "circle", 8, (198.0, 97.0, 5.5))],
    "BallTossOut.mp4": [Seed("ball", "circle", 10, (128, 206.5, 5.2))],
    "PucksCollide.mp4": [Seed("blue", "circle", 8, (107.5, 117.5, 17.3)), Seed("red", "circle", 8, (189, 188.5, 17.0))],
    "CupsClips.mp4": [Seed(f"cup{i + 1}", "outline", 10, CUP + c) for i, c in enumerate(CUPS)],
    "cart_on_incline.mp4": [Seed("cart", "outline", 110, CART)],
    "tennis_ball_bounce.gif": [Seed("ball", "circle", 10, (38.2, 135.0, 5.1))],
}
INTERLACED = ("BallDrop.mp4",)  # one field is taken: the film reader's work


def clip(name: str, truth: dict[str, Any]) -> tuple[list[dict[str, Any]], list[Track], np.ndarray, float]:
    """Observe a clip: a row for each body, tracks, frames, seconds of processor time."""
    frames = read_frames(SHARED / "sliding" / name / "clip.mp4")
    points = [c["world"] for c in truth["calibration"]]
    pixels = np.array([c["pixel"] for c in truth["calibration"]]) - 0.5  # theirs count from the first pixel's corner
    camera = calibrate_from_points(points, pixels, (frames.shape[2], frames.shape[1])).camera
    bodies: list[Body] = []
    for o in truth["objects"]:
        half = o["shape"].get("half_extents") or [o["shape"]["radius"]] * 2 + [o["shape"].get("half_height", 0.167)]
        bodies.append(Solid(o["name"], o["shape"]["kind"], tuple(half), camera))
    seeds = [Seed(b.name, "words", None, b.name.split("_")[0]) for b in bodies]
    began = time.process_time()
    tracks, _ = observe(frames, bodies, seeds)
    seconds = time.process_time() - began
    rows = []
    for track in tracks:
        true = np.array(truth["true_positions_xy"][track.body.name])[: len(frames)]
        poses = [np.array([x, y, 0.0, 0.0]) for x, y in true]
        shown = np.array([_in_picture(track.body, p, frames.shape[2], frames.shape[1]) for p in poses]) >= SEEN
        error = np.linalg.norm(track.poses[:, :2] - true, axis=1) * 100
        pixel = np.array([np.linalg.norm(c - track.body.centre(p)) for c, p in zip(track.centres, poses, strict=True)])
        size = np.array([track.body.radius(p) for p in poses])
        found = np.isfinite(error)
        rows.append(
            {
                "name": track.body.name,
                "cm": error[shown & found],
                "px": pixel[shown & found],
                "lost": int((shown & ~found).sum()),
                "wrong": int((found & (pixel > 0.5 * size) & (track.confidence > CONFIDENT)).sum()),
                "ratio": (pixel / track.errors)[shown & found],
            }
        )
    return rows, tracks, frames, seconds


def _in_picture(body: Body, pose: np.ndarray, width: int, height: int) -> float:
    far = 400
    mask = np.zeros((height + 2 * far, width + 2 * far), np.uint8)
    cv2.fillPoly(mask, [np.round(body.polygon(pose) + far).astype(np.int32)], 1)
    return float(mask[far:-far, far:-far].sum() / max(mask.sum(), 1))


def film(name: str) -> tuple[list[Track], np.ndarray, float]:
    """Observe a film from its outlines."""
    frames = read_frames(SHARED / "films" / name)
    if name in INTERLACED:
        rows = frames[:, ::2]
        frames = np.stack(
            [
                cv2.warpAffine(
                    f,
                    np.float32([[1, 0, 0], [0, 2, 0]]),
                    (f.shape[1], 2 * f.shape[0]),
                    flags=cv2.INTER_LINEAR,
                    borderMode=cv2.BORDER_REPLICATE,
                )
                for f in rows
            ]
        )
    seeds = FILMS[name]
    bodies = [outline_body(s.body, s) for s in seeds]
    began = time.process_time()
    tracks, _ = observe(frames, bodies, seeds)
    return tracks, frames, time.process_time() - began


def references(name: str, tracks: list[Track]) -> list[np.ndarray]:
    """Distances (T,) [px] of each track from what is known of a film, NaN where nothing is."""
    empty = [np.full(len(t.centres), np.nan) for t in tracks]
    if name == "PucksCollide.mp4":
        rows = [{k: float(v) if v else np.nan for k, v in r.items()} for r in _read("PucksCollide_threshold.csv")]
        for track, error in zip(tracks, empty, strict=True):
            for r in rows:
                k = int(r["frame"])
                if k < len(error):
                    error[k] = np.hypot(
                        track.centres[k, 0] - r[f"{track.body.name}_u"], track.centres[k, 1] - r[f"{track.body.name}_v"]
                    )
    if name == "cart_on_incline.mp4":
        rows = [{k: float(v) if v else np.nan for k, v in r.items()} for r in _read("cart_on_incline_tracker.csv")]
        index = np.array([round(r["t"] * 30) for r in rows])
        place = np.array([(r["x"], r["y"]) for r in rows])
        keep = (index < len(tracks[0].centres)) & np.isfinite(place).all(axis=1)
        index, place = index[keep], place[keep]
        seen = np.isfinite(tracks[0].centres[index, 0])
        index, place = index[seen], place[seen]
        along = _along(place)
        best: np.ndarray | None = None
        for shift in range(-3, 4):
            inside = (index + shift >= 0) & (index + shift < len(tracks[0].centres))
            to = tracks[0].centres[np.where(inside, index + shift, 0)]
            inside &= np.isfinite(to[:, 0])
            pixels = np.full(len(along), np.nan)
            pixels[inside] = _along(to[inside])
            line, keep = np.zeros(2), inside
            for _ in range(8):  # least squares without the farthest, from where either may be wrong
                line = np.polyfit(along[keep], pixels[keep], 1)
                left = np.abs(np.polyval(line, along) - pixels)
                keep = inside & (left <= 3 * np.nanmedian(left[inside]) + 0.1)
            if best is None or np.nanmedian(left) < np.nanmedian(best):
                best = np.full(len(empty[0]), np.nan)
                best[np.where(inside, index + shift, 0)[inside]] = left[inside]
        assert best is not None
        empty[0] = best
    if name == "BallTossOut.mp4":
        for track, error in zip(tracks, empty, strict=True):
            free = np.arange(11, len(error))
            free = free[np.isfinite(track.centres[free, 0])]
            if len(free) > 6:  # the lens bends the parabola
                fits = [np.polyfit(free - 20.0, track.centres[free, axis], 4) for axis in (0, 1)]
                error[free] = np.hypot(
                    *[np.polyval(f, free - 20.0) - track.centres[free, a] for a, f in enumerate(fits)]
                )
    return empty


def _along(places: np.ndarray) -> np.ndarray:
    """Places (T, 2) along their principal axis."""
    apart = places - np.median(places, axis=0)
    axis = np.linalg.svd(apart)[2][0]
    return np.asarray(apart @ axis * np.sign(axis[0]))


def straight(track: Track) -> float:
    """Noise [px] of a coordinate of a track by third differences, which no smooth motion has."""
    third = np.diff(track.centres, 3, axis=0)
    third = third[np.isfinite(third)]
    return float(1.48 * np.median(np.abs(third)) / np.sqrt(20)) if len(third) else np.nan


def _read(name: str) -> list[dict[str, str]]:
    return list(csv.DictReader((SHARED / "films" / name).read_text().splitlines()))


def draw(path: Path, tracks: list[Track], frames: np.ndarray, count: int = 12) -> None:
    """Write a sheet of frames with the silhouettes that were found."""
    colours = [
        (255, 255, 0),
        (0, 255, 255),
        (255, 0, 255),
        (0, 255, 0),
        (0, 128, 255),
        (255, 128, 0),
        (128, 0, 255),
        (255, 255, 255),
    ]
    pictures = []
    for k in np.unique(np.linspace(0, len(frames) - 1, count).astype(int)):
        picture = frames[k].copy()
        for i, t in enumerate(tracks):
            if np.isfinite(t.poses[k, 0]):
                line = np.round(t.body.polygon(t.poses[k]) * 16).astype(np.int32)
                cv2.polylines(picture, [line], True, colours[i % 8], 1, cv2.LINE_AA, 4)
        cv2.putText(picture, str(k), (4, picture.shape[0] - 6), 0, 0.5, (255, 255, 255), 1)
        pictures.append(picture)
    wide = 4 if frames.shape[2] > 200 else 8
    pictures += [np.zeros_like(pictures[0])] * (-len(pictures) % wide)
    cv2.imwrite(str(path), cv2.vconcat([cv2.hconcat(pictures[i : i + wide]) for i in range(0, len(pictures), wide)]))


def sliding(only: str | None, pictures: Path | None) -> None:
    """Print errors of the six clips."""
    if not (SHARED / "sliding").exists():
        print(f"sliding: skipped, {SHARED / 'sliding'} is absent")
        return
    every: list[dict[str, Any]] = []
    for name, truth in json.loads((SHARED / "sliding" / "truth.json").read_text()).items():
        if only and only not in name:
            continue
        rows, tracks, frames, seconds = clip(name, truth)
        every += rows
        print(f"{name}  {seconds:.1f} s")
        for r in rows:
            cm = r["cm"] if len(r["cm"]) else np.array([np.nan])
            print(
                f"  {r['name']:<24} {np.median(cm):.2f} / {np.percentile(cm, 90):.2f} / {cm.max():.2f} cm  "
                f"lost {r['lost']}  wrong {r['wrong']}"
            )
        if pictures:
            draw(pictures / f"{name}.png", tracks, frames)
    cm, px, ratio = (np.concatenate([r[key] for r in every]) for key in ("cm", "px", "ratio"))
    lost, wrong = (sum(r[key] for r in every) for key in ("lost", "wrong"))
    print(
        f"sliding  median {np.median(cm):.2f} cm  90% {np.percentile(cm, 90):.2f} cm  "
        f"({np.median(px):.2f} px) of {len(cm)}"
        f"  over 20 cm {(cm > 20).sum()}  lost {lost}  wrong {wrong}  error over sigma, median {np.median(ratio):.2f}"
    )


def films(only: str | None, pictures: Path | None) -> None:
    """Print how far each body of the films was followed, and its distance from the reference."""
    if not (SHARED / "films").exists():
        print(f"films: skipped, {SHARED / 'films'} is absent")
        return
    for name in FILMS:
        if only and only not in name:
            continue
        tracks, frames, seconds = film(name)
        print(f"{name}  {len(frames)} frames  {seconds:.1f} s")
        for t, error in zip(tracks, references(name, tracks), strict=True):
            print(_line(t, error))
        if pictures:
            draw(pictures / f"{name}.png", tracks, frames, 16)


def _line(track: Track, error: np.ndarray) -> str:
    """Return a body's row of a film."""
    seen = np.flatnonzero(np.isfinite(track.centres[:, 0]))
    if not len(seen):
        return f"  {track.body.name:<8} nowhere"
    known = error[np.isfinite(error)]
    text = "no reference"
    if len(known):
        text = f"reference {np.median(known):.2f} / {np.percentile(known, 90):.2f} px of {len(known)}"
    wrong = int(((error > 0.5 * track.body.radius(track.poses[seen[0]])) & (track.confidence > CONFIDENT)).sum())
    sure = track.confidence[seen]
    return (
        f"  {track.body.name:<8} frames {seen.min()}..{seen.max()} ({len(seen)})  {text}  wrong {wrong}  "
        f"noise {straight(track):.2f} px  sigma {np.median(track.errors[seen]):.2f} px  "
        f"confidence {np.median(sure):.2f}, above {CONFIDENT} in {(sure > CONFIDENT).sum()}  "
        f"breaks {list(track.breaks)}"
    )


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sliding", action="store_true")
    parser.add_argument("--films", action="store_true")
    parser.add_argument("--only", help="part of a name")
    parser.add_argument("--pictures", type=Path, help="folder for sheets of overlays")
    asked = parser.parse_args()
    both = not (asked.sliding or asked.films)
    if asked.sliding or both:
        sliding(asked.only, asked.pictures)
    if asked.films or both:
        films(asked.only, asked.pictures)


if __name__ == "__main__":
    main()
