"""Draw clips with their truth but without pictures, for runs that begin at the true tracks."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tests.benchmarks.video_clips.bodies import Rejected
from tests.benchmarks.video_clips.clip import Clip, draw_clip, generator_for
from tests.benchmarks.video_clips.edits import WANTED as CHANGES
from tests.benchmarks.video_clips.kinds import KINDS
from tests.benchmarks.video_clips.known import known
from tests.benchmarks.video_clips.looks import STYLES
from tests.benchmarks.video_clips.questions import WANTED
from tests.benchmarks.video_clips.render import Film
from tests.benchmarks.video_clips.truth import truth
from tests.benchmarks.video_clips.write import plain

PIXELS = 8  # of a body that is in view, in the labels that stand for a rendered film


def unrendered(clip: Clip) -> Film:
    """Labels that show each body in the frames in which its centre is in the image, hidden by nothing."""
    names = clip.run.names
    labels = np.zeros((clip.look.frames, len(names), PIXELS), dtype=np.uint8)
    for k in range(len(names)):
        for t, camera in enumerate(clip.cameras):
            if camera.inside(clip.run.frame_poses[t : t + 1, k, :3])[0]:
                labels[t, k] = k + 1
    return Film([], labels, list(names), [])


def draw_tracks(
    out: Path, name: str, seed: Sequence[int], kind: str, style: str, changes: int = CHANGES, wanted: int = WANTED
) -> None:
    """Draw one clip and write what is known and what is hidden of it. Raises Rejected where no draw is usable."""
    clip = draw_clip(list(seed), kind, style)
    film = unrendered(clip)
    facts = known(clip, film, generator_for(list(seed), 3))
    hidden = truth(clip, film, generator_for(list(seed), 4), wanted, changes)
    (out / "public" / name).mkdir(parents=True, exist_ok=True)
    (out / "private").mkdir(parents=True, exist_ok=True)
    (out / "public" / name / "known.json").write_text(json.dumps(plain({"clip": name, **facts})) + "\n")
    (out / "private" / f"{name}.json").write_text(json.dumps(plain({"clip": name, **hidden})) + "\n")


def draw_all(out: Path, seed: int, count: int) -> None:
    """Draw `count` clips of all kinds in turn."""
    kinds = list(KINDS)
    for i in range(count):
        style = STYLES[int(np.random.default_rng([seed, i]).integers(len(STYLES)))]
        try:
            draw_tracks(out, f"{i:02d}_{kinds[i % len(kinds)]}", [seed, i], kinds[i % len(kinds)], style)
        except Rejected:
            continue
