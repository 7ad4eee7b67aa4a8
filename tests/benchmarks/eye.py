"""The eye on six rendered clips of known shapes: `python -m tests.benchmarks.eye [--only NAME] [--pictures FOLDER]`.

Data: ../shared/data/sliding (README there). Errors are on the floor [cm] against true positions, of body-frames of
which at least 15% are in the picture; bodies are given by shape, size and colour word. wrong: frames whose error is
more than half a radius with a confidence above 0.8.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from atw_mcp.perception.calibration import calibrate_from_points
from atw_mcp.perception.eye.bodies import Body, Solid
from atw_mcp.perception.eye.colour_names import colour_name
from atw_mcp.perception.eye.finding import find_solids
from atw_mcp.perception.eye.observe import Track, observe
from atw_mcp.perception.eye.settings import EyeSettings
from atw_mcp.perception.video import read_frames

SHARED = Path(__file__).resolve().parents[2].parent / "shared" / "data"
SEEN = 0.15  # share of a silhouette in the picture from which on a body is to be found
CONFIDENT = 0.8


def clip(name: str, truth: dict[str, Any]) -> tuple[list[dict[str, Any]], list[Track], np.ndarray, float]:
    """Observe a clip: a row for each body, tracks, frames, seconds of processor time."""
    frames = read_frames(SHARED / "sliding" / name / "clip.mp4")
    points = [c["world"] for c in truth["calibration"]]
    pixels = np.array([c["pixel"] for c in truth["calibration"]]) - 0.5  # theirs count from the first pixel's corner
    camera = calibrate_from_points(points, pixels, (frames.shape[2], frames.shape[1])).camera
    bodies: list[Solid] = []
    for o in truth["objects"]:
        half = o["shape"].get("half_extents") or [o["shape"]["radius"]] * 2 + [o["shape"].get("half_height", 0.167)]
        bodies.append(Solid(o["name"], o["shape"]["kind"], tuple(half), camera))
    began = time.process_time()
    words = {b.name: str(colour_name(b.name.split("_")[0])) for b in bodies}
    found = find_solids(frames, bodies, words, {}, EyeSettings())
    tracks, _ = observe(frames, bodies, [f.seed for f in found.values()])
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


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", help="part of a name")
    parser.add_argument("--pictures", type=Path, help="folder for sheets of overlays")
    asked = parser.parse_args()
    sliding(asked.only, asked.pictures)


if __name__ == "__main__":
    main()
