"""Measure perception of rendered clips: `python -m tests.benchmarks.videos`.

Clips of moving bodies are drawn and rendered by MuJoCo (`tests.benchmarks.examination_scenes`), of every kind but
water. Every clip is observed as it is, without hints, and scored against true masks: bodies found, objects that are
none, intersection over union, distance of centroids.
Options: [--clips DIR] scores a folder drawn before, else clips are drawn: [--count K], [--seed S]; [--quick] draws ten.
[--pictures DIR] writes outlines over frames; [--json] prints all figures. [--model NAME] scores a learned model of
ATW_MODELS in place of OpenCV, prompted with the boxes of what OpenCV found; [--agreement] takes each object from the
better of the two. [--known] gives the bodies' names, colours and shapes and points for the camera, as a user would, but
for cloth and rope, which are no known solids.
[--seeded box|outline] gives one box or outline per body in one frame, and follows it from there.
"""

from __future__ import annotations

import argparse
import json
import secrets
import sys
import tempfile
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from atw_mcp.models import Limits, ModelError, ModelFolder, find_model, follow, prompts_from
from atw_mcp.models.running import chosen_device
from atw_mcp.perception.agreement import by_agreement
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.observe import observe
from atw_mcp.perception.video import load
from tests.benchmarks.videos.drawn import DRAWN, draw
from tests.benchmarks.videos.known import DEFORMABLE, observe_as_known
from tests.benchmarks.videos.scores import ClipScore, score_masks
from tests.benchmarks.videos.seeds import Labels, observe_seeded

Look = Callable[[Path, Labels, list[str]], ImageObservation]  # from a file, true labels and the bodies' names

COUNT, QUICK = 60, 10
COLOURS = [(0, 0, 255), (0, 255, 255), (255, 0, 255), (255, 255, 0), (0, 255, 0), (255, 128, 0)]


def observed_masks(observation: ImageObservation, frames: int) -> dict[str, Any]:
    """Masks (T, H, W) of the first frames by object."""
    shape = (observation.video.height, observation.video.width)
    return {
        o.name: np.stack([np.zeros(shape, bool) if m is None else m.decode() for m in o.masks[:frames]])
        for o in observation.objects
    }


def observe_plain(file: Path, _labels: Labels, _bodies: list[str]) -> ImageObservation:
    """Observe a clip of which nothing is known."""
    return observe(file)


def observe_with(
    model: ModelFolder, agreement: bool, file: Path, _labels: Labels, _bodies: list[str]
) -> ImageObservation:
    """Run a segmentation model on a clip whose objects OpenCV points out to it."""
    plain = observe(file)
    if not plain.objects:
        return plain
    info, frames = load(file)
    found = follow(model, frames, prompts_from(plain), Limits.from_environment())
    seen = found.observation(info, frames, plain.frames)
    return by_agreement(seen, plain, frames, plain.names)[0] if agreement else seen


def judge(
    clip: Path, pictures: Path | None = None, look: Look = observe_plain, unasked: Collection[str] = ()
) -> tuple[ClipScore, dict[str, Any]]:
    """Observe a clip by `look` and score it, but for bodies that were not asked for; with its kind and the seconds it
    took."""
    file, truth = clip / "clip.mp4", np.load(clip / "masks.npz")
    kind = json.loads((clip / "scene.json").read_text())["kind"]
    bodies = [str(n) for n in truth["names"]]
    begin = time.process_time()
    observation = look(file, truth["labels"], bodies)
    spent = time.process_time() - begin
    frames = min(len(truth["labels"]), len(observation.frames))
    masks = observed_masks(observation, frames)
    score = score_masks(truth["labels"][:frames], bodies, masks)
    score = replace(score, bodies=tuple(b for b in score.bodies if b.body not in unasked))
    if pictures is not None:
        _picture(file, masks, pictures / f"{clip.name}.png")
    return score, {"clip": clip.name, "kind": kind, "seconds": spent}


def summary(scores: Sequence[ClipScore]) -> dict[str, Any]:
    """Figures over all clips."""
    bodies = [b for s in scores for b in s.bodies]
    found = [b for b in bodies if b.observed is not None]
    return {
        "clips": len(scores),
        "complete": sum(s.complete for s in scores),
        "bodies": len(bodies),
        "found": len(found),
        "ghosts": sum(len(s.ghosts) for s in scores),
        "iou_median": float(np.median([b.iou for b in bodies])) if bodies else None,
        "iou_mean": float(np.mean([b.iou for b in bodies])) if bodies else None,
        "off_median": float(np.median([b.off for b in found])) if found else None,
    }


def _picture(file: Path, masks: dict[str, Any], to: Path) -> None:
    to.parent.mkdir(parents=True, exist_ok=True)
    _, frames = load(file)
    tiles = []
    for t in np.linspace(0, len(frames) - 1, 4).astype(int):
        tile = frames[t].copy()
        for k, own in enumerate(masks.values()):
            if t < len(own):
                outlines, _ = cv2.findContours(own[t].astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
                cv2.drawContours(tile, outlines, -1, COLOURS[k % len(COLOURS)], 1)
        tiles.append(tile)
    cv2.imwrite(str(to), np.vstack([np.hstack(tiles[:2]), np.hstack(tiles[2:])]))


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=Path, metavar="DIR", help="folder of scenes drawn before")
    parser.add_argument("--count", type=int, help=f"clips to draw (default: {COUNT})")
    parser.add_argument("--seed", type=int, help="default: from the operating system")
    parser.add_argument("--quick", action="store_true", help=f"draw {QUICK} clips")
    parser.add_argument("--known", action="store_true", help="use what scene.json says: bodies, sizes, camera")
    parser.add_argument("--seeded", choices=("box", "outline"), help="follow each body from one seed")
    parser.add_argument("--pictures", type=Path, metavar="DIR")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--model", metavar="NAME", help="a segmentation model under ATW_MODELS")
    parser.add_argument("--agreement", action="store_true", help="with --model: the better of model and OpenCV")
    chosen = parser.parse_args()
    if chosen.agreement and chosen.model is None:
        parser.error("--agreement needs --model NAME")
    look: Look = observe_plain
    if chosen.known:
        look = observe_as_known
    if chosen.seeded is not None:
        look = partial(observe_seeded, how=chosen.seeded)
    if chosen.model is not None:
        try:
            model = find_model(chosen.model)
            chosen_device(Limits.from_environment())
        except ModelError as error:
            parser.error(str(error))
        if model.task != "segmentation":
            parser.error(f"{model.name} gives {model.task}; clips are scored by masks")
        look = partial(observe_with, model, chosen.agreement)
    seed = secrets.randbits(30) if chosen.seed is None else chosen.seed
    with tempfile.TemporaryDirectory() as made:
        folder = chosen.clips or Path(made)
        if chosen.clips is None:
            count = chosen.count or (QUICK if chosen.quick else COUNT)
            for number in range(count):
                kind = DRAWN[number % len(DRAWN)]
                path = folder / f"{kind}_{seed + number}"
                scene = draw(kind, seed + number, path)
                (path / "scene.json").write_text(json.dumps(scene))
        scores, rows = [], []
        for clip in sorted(folder.iterdir()):
            unasked = DEFORMABLE if chosen.known else ()
            score, about = judge(clip, chosen.pictures, look, unasked)
            scores.append(score)
            rows.append(about | score.to_dict())
            found = sum(b.observed is not None for b in score.bodies)
            text = f"{clip.name}: {found} of {len(score.bodies)} found"
            print(f"{text}, {len(score.ghosts)} ghosts, {about['seconds']:.1f} s", file=sys.stderr, flush=True)
    figures = summary(scores) | {"seed": seed, "model": chosen.model, "agreement": chosen.agreement}
    if chosen.json:
        print(json.dumps(figures | {"rows": rows}))
    else:
        print("\t".join(figures))
        print("\t".join(str(v) for v in figures.values()))


if __name__ == "__main__":
    main()
