"""The eye where nothing is given: bodies are proposed, followed, and compared with true masks.

    python -m tests.benchmarks.eye_unaided [--clips FOLDER] [--clevrer] [--pictures FOLDER]

FOLDER: clips drawn by `python -m tests.benchmarks.video_clips --out FOLDER`; scored as `tests.benchmarks.videos` does:
a body is found by a track whose silhouette has a mean intersection over union of a half. Ghosts are tracks of no body;
those that an agent would be asked about are counted apart. moving: bodies that go farther than half their size, the
others cannot be discovered by motion. CLEVRER: its videos and annotations in ../shared/data/clevrer, places [m] by the
homography there.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from atw_mcp.perception.eye.bodies import Body
from atw_mcp.perception.eye.discover import Proposal, discover
from atw_mcp.perception.eye.observe import Track, observe
from atw_mcp.perception.eye.pixels import filled
from atw_mcp.perception.video import read_frames
from tests.benchmarks.eye import SHARED, draw
from tests.benchmarks.video_scores import SEEN, score_masks


def unaided(frames: np.ndarray) -> tuple[list[Proposal], list[Track], float]:
    """Propose bodies, follow those that are no shadows, and return them with the seconds of processor time."""
    began = time.process_time()
    proposals = [p for p in discover(frames) if p.kind != "shadow" or p.confidence > 0.3]
    bodies: list[Body] = [p.body for p in proposals]
    tracks = observe(frames, bodies, [s for p in proposals for s in p.seeds])[0] if proposals else []
    return proposals, tracks, time.process_time() - began


def masks(tracks: list[Track], shape: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Silhouettes (T, H, W) of tracks, the nearer in front."""
    found = {}
    for t in tracks:
        found[t.body.name] = np.zeros(shape[:3], bool)
        for k in np.flatnonzero(np.isfinite(t.poses[:, 0]) & (t.confidence > 0.2)):
            found[t.body.name][k] = filled(t.body.polygon(t.poses[k]), (0, 0), (shape[2], shape[1]))
    return found


def clip(public: Path, private: Path, pictures: Path | None) -> dict[str, Any]:
    """Score one clip."""
    frames = read_frames(next(public.glob("clip.*")))
    truth = np.load(private / f"{public.name}_masks.npz")
    labels, names = truth["labels"], [str(n) for n in truth["names"]]
    hidden = json.loads((private / f"{public.name}.json").read_text())
    proposals, tracks, seconds = unaided(frames)
    count = min(len(labels), len(frames))
    score = score_masks(labels[:count], names, {k: m[:count] for k, m in masks(tracks, frames.shape).items()})
    asked = {p.body.name for p in proposals if p.ask}
    moving = [n for k, n in enumerate(names) if _goes(labels == k + 1)]
    if pictures:
        draw(pictures / f"{public.name}.png", tracks, frames, 8)
    found = [b.body for b in score.bodies if b.observed]
    row = {
        "bodies": len(score.bodies),
        "found": len(found),
        "moving": len(moving),
        "found_moving": len(set(found) & set(moving)),
        "ghosts": len(set(score.ghosts) - asked),
        "ghosts_asked": len(set(score.ghosts) & asked),
        "seconds": seconds,
    }
    missed = [b.body for b in score.bodies if not b.observed]
    ghosts = f"ghosts {row['ghosts']} and {row['ghosts_asked']} asked about"
    found_of = f"{row['found']} of {row['bodies']} found, missed {missed}"
    print(f"{public.name} {hidden['kind']} {hidden['style']}: {found_of}, {ghosts}, {seconds:.1f} s", flush=True)
    return row


def _goes(mask: np.ndarray) -> bool:
    """Whether a body with a mask (T, H, W) goes farther than half its diameter."""
    seen = [m for m in mask if m.sum() >= SEEN]
    if not seen:
        return False
    places = np.array([np.argwhere(m).mean(axis=0) for m in seen])
    return bool(np.linalg.norm(np.ptp(places, axis=0)) > np.sqrt(max(m.sum() for m in seen) / np.pi))


def clevrer() -> None:
    """Print errors of the videos' tracks [m] against the annotations."""
    folder = SHARED / "clevrer"
    if not folder.exists():
        print(f"clevrer: skipped, {folder} is absent")
        return
    to_world = np.linalg.inv(np.array(json.loads((folder / "camera_homography_z0.2.json").read_text())["H"]))
    for video in sorted(folder.glob("video_*.mp4")):
        scene = json.loads((folder / video.name.replace("video", "annotation").replace("mp4", "json")).read_text())
        frames = read_frames(video)
        proposals, tracks, seconds = unaided(frames)
        true = np.full((len(scene["object_property"]), len(frames), 2), np.nan)
        for row in scene["motion_trajectory"]:
            for o in row["objects"]:
                if o["inside_camera_view"] and row["frame_id"] < len(frames):
                    true[o["object_id"], row["frame_id"]] = o["location"][:2]
        taken, ghosts = {}, []
        for p, t in zip(proposals, tracks, strict=True):
            world = np.c_[t.centres, np.ones(len(frames))] @ to_world.T
            world = np.where(t.confidence[:, None] > 0.3, world[:, :2] / world[:, 2:], np.nan)
            apart = np.linalg.norm(true - world, axis=2)
            middle = [np.nanmedian(a) if np.isfinite(a).any() else np.inf for a in apart]
            best = int(np.argmin(middle))
            if middle[best] < 0.5 and best not in taken:
                taken[best] = apart[best][np.isfinite(apart[best])]
            else:
                ghosts.append(f"{t.body.name}{' asked' if p.ask else ''}")
        shown = int(np.isfinite(true[..., 0]).any(axis=1).sum())
        error = np.concatenate(list(taken.values())) if taken else np.array([np.nan])
        print(f"{video.name}: {len(taken)} of {shown} found, median {np.median(error):.4f} m, 90% "
              f"{np.percentile(error, 90):.4f} m, ghosts {ghosts}, {seconds:.1f} s")  # fmt: skip


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=Path)
    parser.add_argument("--clevrer", action="store_true")
    parser.add_argument("--pictures", type=Path)
    asked = parser.parse_args()
    if asked.clips:
        rows = [clip(p, asked.clips / "private", asked.pictures) for p in sorted((asked.clips / "public").iterdir())]
        print({key: round(float(sum(r[key] for r in rows)), 1) for key in rows[0]})
    if asked.clevrer:
        clevrer()


if __name__ == "__main__":
    main()
