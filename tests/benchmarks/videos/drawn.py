"""Draw scenes of `tests.benchmarks.examination_scenes` without their questions, and film them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.examination_scenes.__main__ import RATES, SHOWN, TRIES, clip_frames, extent, known
from tests.benchmarks.examination_scenes.kinds import KINDS, VIEWS
from tests.benchmarks.examination_scenes.picture import calibration, draw_camera, film, shown
from tests.benchmarks.examination_scenes.world import simulate

DRAWN = ("slide", "roll", "throw", "hang", "soft")
LONGEST = 1.5  # [s] that a scene is simulated for, more than a clip lasts


def draw(kind: str, seed: int, path: Path) -> dict[str, Any]:
    """Film a scene as clip.mp4 and masks.npz of a folder, and return what is known of it."""
    rng = np.random.default_rng([list(KINDS).index(kind), seed])
    for _ in range(TRIES):
        scene, rate = KINDS[kind](rng, seed), int(rng.choice(RATES))
        run = simulate(scene, LONGEST, 1)
        count = clip_frames(rng, kind, scene, run, rate)
        if count is None:
            continue
        at = [k / rate for k in range(count)]
        places = extent(scene, run, at)
        camera = draw_camera(rng, places, VIEWS[kind])
        points = calibration(rng, camera, places)
        seen = all(camera.sees(np.array([run.place(b.name, t) for t in at])).sum() >= SHOWN for b in scene.named)
        if seen and points is not None:
            path.mkdir(parents=True, exist_ok=True)
            labels = film(rng, scene, run, camera, at, path / "clip.mp4")
            np.savez_compressed(path / "masks.npz", labels=labels, names=np.array(shown(scene)))
            return {"kind": kind, "seed": seed, "known": known(scene, camera, points, VIEWS[kind] == "side")}
    raise RuntimeError(f"no {kind} scene of seed {seed} can be filmed in {TRIES} draws")
