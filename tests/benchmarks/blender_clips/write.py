"""Draw a clip that works and write it in the folders' format of `tests.benchmarks.video_clips`."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.video_clips.bodies import Rejected
from tests.benchmarks.video_clips.clip import ATTEMPTS, Clip, draw_with_look, generator_for
from tests.benchmarks.video_clips.edits import WANTED
from tests.benchmarks.video_clips.write import plain, write_film

from .film import film
from .setting import Setting, draw_style


def draw(seed: list[int], kind: str, style: str) -> tuple[Clip, Setting]:
    """Draw until a clip passes."""
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([*seed, attempt])
        look, setting = draw_style(rng, style, kind)
        try:
            return draw_with_look(rng, kind, look), setting
        except (Rejected, FloatingPointError):
            continue
    raise Rejected(f"no usable draw of {kind} with {style}")


def write_clip(
    out: Path, name: str, seed: list[int], kind: str, style: str, threads: int = 2, changes: int = WANTED
) -> dict[str, Any]:
    """Draw, film and write one clip; return a summary.

    Beside the other generator's truth the private record holds the setting, and the masks file the hand's mask.
    """
    clip, setting = draw(seed, kind, style)
    seen, hand, built = film(generator_for(seed, 1), clip, setting, threads)
    summary = write_film(out, name, seed, clip, seen, changes)
    record = out / "private" / f"{name}.json"
    hidden = json.loads(record.read_text())
    extra = asdict(setting) | {"furniture": built.shown, "hand_shown": built.hand}
    record.write_text(json.dumps(hidden | {"renderer": "blender", "setting": plain(extra)}) + "\n")
    masks = out / "private" / f"{name}_masks.npz"
    np.savez_compressed(masks, labels=seen.labels, names=np.array(seen.names), hand=hand)
    return summary
